# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Bundles of messages of several topics, for receivers that tolerate a delay.

A bundle is a std_msgs/UInt8MultiArray in plain little-endian CDR. Its data are `_MARK`, the number
of topics (2 bytes), for each topic the length of its name (2) and the name, then for each message,
in order of sending, the system time in ns (8), the index of its topic (2), its length (4) and
bytes.
"""

from __future__ import annotations

import math
import struct
from collections import Counter, deque
from collections.abc import Iterable
from itertools import takewhile
from operator import itemgetter
from typing import Generic, TypeVar

from haptic_accel.core.sampling import NANOSECONDS

BUNDLE_PERIOD = 0.02
"""Maximum time from the first message of a bundle to its transmission while others follow, s. A
killed process loses these messages."""

LARGEST_BUNDLE = 48_000
"""Size above which a bundle is sent early, bytes. With one more message it is still below the
largest UDP datagram (65,507 bytes), so the middleware need not fragment it."""

LONGEST_BUNDLE = 2 * LARGEST_BUNDLE
"""Size above which a bundle is rejected, bytes; a valid one with its last message and table is
smaller."""

OLDEST = 1.0
"""Maximum age of a message when its bundle is received, s; larger ages are clipped."""

DUPLICATE_MEMORY = 5.0
"""Minimum time for which a message is remembered, to detect its duplicate on the other path, s."""

MOST_REMEMBERED = 100_000
"""Number of messages of one topic above which older ones are forgotten earlier."""

_MARK = b"hab1"
_BEFORE = struct.Struct("<4sIII")  # encapsulation; no dimension, no offset, length of the data
_ENCAPSULATION = b"\0\1\0\0"
_PADDING = 3  # maximum number of padding bytes added by the middleware
_COUNT = struct.Struct("<H")
_ENTRY = struct.Struct("<QHI")
_LATEST = 2**63 - 1

Item = TypeVar("Item")

Entry = tuple[str, int, bytes]
"""Topic, system time of sending in ns, and serialised message."""


class Bundle:
    """Collect messages, and pack them."""

    def __init__(self) -> None:
        self._topics: list[str] = []
        self._parts: list[bytes] = []
        self._size = self._since = 0

    def index(self, topic: str) -> int:
        """Return the index of a topic, by its full name, in this and all later bundles."""
        if topic not in self._topics:
            self._topics.append(topic)
        return self._topics.index(topic)

    def put(self, index: int, time: int, message: bytes) -> bool:
        """Add a message sent at a system time in ns; return whether the bundle is due."""
        if not self._parts:
            self._since = time
        self._parts += _ENTRY.pack(time, index, len(message)), message
        self._size += _ENTRY.size + len(message)
        return self.overdue(time) or self._size > LARGEST_BUNDLE

    def overdue(self, time: int) -> bool:
        """Return whether the first message's age at a time, ns, exceeds the period."""
        # A clock that is set back must not delay messages.
        return not 0 <= time - self._since < BUNDLE_PERIOD * NANOSECONDS

    def flush(self) -> bytes:
        """Return the packed bundle and start another; empty if there is no message."""
        if not self._parts:
            return b""
        names = [name.encode() for name in self._topics]
        table = [part for name in names for part in (_COUNT.pack(len(name)), name)]
        data = b"".join((_MARK, _COUNT.pack(len(names)), *table, *self._parts))
        self._parts, self._size = [], 0
        return _BEFORE.pack(_ENCAPSULATION, 0, 0, len(data)) + data


def unpack_bundle(data: bytes) -> list[Entry]:
    """Return the messages of a bundle, in order of sending.

    Raises
    ------
    ValueError
        The data are no complete bundle; then all of its messages are rejected.
    """
    if len(data) < _BEFORE.size + len(_MARK) + _COUNT.size:
        raise ValueError("too short")
    if len(data) > LONGEST_BUNDLE:
        raise ValueError("too long")
    encapsulation, dimensions, _, length = _BEFORE.unpack_from(data)
    offset = _BEFORE.size
    end = offset + length
    if encapsulation[:2] != _ENCAPSULATION[:2] or dimensions:
        raise ValueError("not a list of bytes in plain little-endian CDR")
    if not end <= len(data) <= end + _PADDING:
        raise ValueError("not of the length that it says")
    if data[offset : offset + len(_MARK)] != _MARK:
        raise ValueError(f"does not begin with {_MARK.decode()}")
    try:
        (count,) = _COUNT.unpack_from(data, offset + len(_MARK))
        offset += len(_MARK) + _COUNT.size
        topics = []
        for _ in range(count):
            (size,) = _COUNT.unpack_from(data, offset)
            offset += _COUNT.size + size
            topics.append(data[offset - size : offset].decode())
        entries = []
        while offset < end:
            time, index, size = _ENTRY.unpack_from(data, offset)
            offset += _ENTRY.size + size
            entries.append((topics[index], min(time, _LATEST), data[offset - size : offset]))
    except (struct.error, IndexError, UnicodeDecodeError):
        raise ValueError("not a table of topics and their messages") from None
    if offset != end:
        raise ValueError("ends within a message")
    return entries


def believed(time: int, received: int) -> int:
    """Return the corrected time of a message in a bundle; both arguments are system times in ns.

    The result is before the reception, by at most `OLDEST`, whatever the sender's clock shows.
    Messages of one sender stay in order.
    """
    return min(max(time, received - round(OLDEST * NANOSECONDS)), received)


class BothWays:
    """Filter of duplicates of messages that arrive directly and in bundles.

    A message is a duplicate if equal bytes arrived on the other path. Equal messages of two
    publishers, or sent twice by one publisher, are therefore recorded twice.
    """

    def __init__(self) -> None:
        self._generations = self._new(), self._new()
        self._until = -math.inf

    def repeats(self, message: bytes, *, bundled: bool, now: float) -> bool:
        """Return whether a message, received at a monotonic time in s, is a duplicate."""
        if now >= self._until or sum(map(len, self._generations[1])) > MOST_REMEMBERED:
            self._generations = self._generations[1], self._new()
            self._until = now + DUPLICATE_MEMORY
        for generation in self._generations:
            other = generation[not bundled]
            if message in other:
                other[message] -= 1
                if not other[message]:
                    del other[message]
                return True
        self._generations[1][bundled][message] += 1
        return False

    @staticmethod
    def _new() -> tuple[Counter[bytes], Counter[bytes]]:
        """Return empty records for direct messages and for bundled messages."""
        return Counter(), Counter()


class InOrder(Generic[Item]):
    """Sort items that arrive in rounds by their times.

    An item is returned after a fixed number of further rounds. Rounds are counted, not timed, so
    that a clock that is set back delays nothing.

    Parameters
    ----------
    rounds : int
    """

    def __init__(self, rounds: int) -> None:
        self._waiting: list[tuple[int, Item]] = []
        self._newest: deque[float] = deque([-math.inf] * rounds)

    def round(self, items: Iterable[tuple[int, Item]]) -> list[tuple[int, Item]]:
        """Add a round of times and items; return items that waited long enough, in order."""
        added = list(items)
        self._waiting += added
        self._waiting.sort(key=itemgetter(0))
        self._newest.append(max((time for time, _ in added), default=-math.inf))
        limit = self._newest.popleft()
        done = list(takewhile(lambda item: item[0] <= limit, self._waiting))
        del self._waiting[: len(done)]
        return done

    def rest(self) -> list[tuple[int, Item]]:
        """Return all waiting items, in order."""
        rest, self._waiting = self._waiting, []
        return rest

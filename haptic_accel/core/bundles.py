# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bundles: messages of several topics in one, for who need not have each at once.

A bundle is a std_msgs/UInt8MultiArray in plain little-endian CDR. Its data are `_MARK`, the
number of topics (2 bytes), for each topic the length of its name (2) and the name, then for each
message, in order of sending, the system time in ns (8), the index of its topic (2), its length (4)
and itself.
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
"""Longest time between the first message of a bundle and its sending while others follow, s: what
is lost with a process that is killed."""

LARGEST_BUNDLE = 48_000
"""Size above which a bundle is sent before its time, bytes: with one more message it is still
below the largest UDP datagram (65,507 bytes), so that the middleware need not cut it."""

LONGEST_BUNDLE = 2 * LARGEST_BUNDLE
"""Size above which a bundle is refused, bytes: one with its last message and table is below."""

OLDEST = 1.0
"""Greatest age of a message where its bundle is received, s; later times are not believed."""

MEMORY = 5.0
"""Shortest time for which a message is remembered that came one way and may come another, s."""

MOST_REMEMBERED = 100_000
"""Number of messages of one topic above which older ones are forgotten sooner."""

_MARK = b"hab1"
_BEFORE = struct.Struct("<4sIII")  # encapsulation; no dimension, no offset, length of the data
_ENCAPSULATION = b"\0\1\0\0"
_PADDING = 3  # bytes by which the middleware may fill a message up
_COUNT = struct.Struct("<H")
_ENTRY = struct.Struct("<QHI")
_LATEST = 2**63 - 1

Item = TypeVar("Item")

Entry = tuple[str, int, bytes]
"""Topic, system time of sending in ns, and serialised message."""


class Bundle:
    """Collects messages, and packs them."""

    def __init__(self) -> None:
        self._topics: list[str] = []
        self._parts: list[bytes] = []
        self._size = self._since = 0

    def index(self, topic: str) -> int:
        """Return the index of a topic, with its full name, in this and all further bundles."""
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
        """Return whether the first message has waited for a bundle's period at a time, ns."""
        # A clock that is set back must not hold messages back.
        return not 0 <= time - self._since < BUNDLE_PERIOD * NANOSECONDS

    def take(self) -> bytes:
        """Return the packed bundle, and begin another; nothing if there is no message."""
        if not self._parts:
            return b""
        names = [name.encode() for name in self._topics]
        table = [part for name in names for part in (_COUNT.pack(len(name)), name)]
        data = b"".join((_MARK, _COUNT.pack(len(names)), *table, *self._parts))
        self._parts, self._size = [], 0
        return _BEFORE.pack(_ENCAPSULATION, 0, 0, len(data)) + data


def unpack_bundle(data: bytes) -> list[Entry]:
    """Return the messages of a bundle, in the order of sending.

    Raises
    ------
    ValueError
        It is not a bundle, or not a whole one; then none of it is to be believed.
    """
    if len(data) < _BEFORE.size + len(_MARK) + _COUNT.size:
        raise ValueError("too short")
    if len(data) > LONGEST_BUNDLE:
        raise ValueError("too long")
    encapsulation, dimensions, _, length = _BEFORE.unpack_from(data)
    place = _BEFORE.size
    end = place + length
    if encapsulation[:2] != _ENCAPSULATION[:2] or dimensions:
        raise ValueError("not a list of bytes in plain little-endian CDR")
    if not end <= len(data) <= end + _PADDING:
        raise ValueError("not of the length that it says")
    if data[place : place + len(_MARK)] != _MARK:
        raise ValueError(f"does not begin with {_MARK.decode()}")
    try:
        (count,) = _COUNT.unpack_from(data, place + len(_MARK))
        place += len(_MARK) + _COUNT.size
        topics = []
        for _ in range(count):
            (size,) = _COUNT.unpack_from(data, place)
            place += _COUNT.size + size
            topics.append(data[place - size : place].decode())
        entries = []
        while place < end:
            time, index, size = _ENTRY.unpack_from(data, place)
            place += _ENTRY.size + size
            entries.append((topics[index], min(time, _LATEST), data[place - size : place]))
    except (struct.error, IndexError, UnicodeDecodeError):
        raise ValueError("not a table of topics and their messages") from None
    if place != end:
        raise ValueError("ends within a message")
    return entries


def believed(time: int, received: int) -> int:
    """Return the time of a message whose bundle was received at a time, both system time in ns.

    It is before the reception, and by `OLDEST` at most, whatever the sender's clock shows.
    Messages of one sender stay in order.
    """
    return min(max(time, received - round(OLDEST * NANOSECONDS)), received)


class BothWays:
    """Messages of one topic that come in bundles, by themselves, or both ways, and count once.

    Each message that came one way is taken for the same as one with equal bytes that comes the
    other way. So two publishers that send the same are recorded twice, as one that sends it twice.
    """

    def __init__(self) -> None:
        self._generations = self._new(), self._new()
        self._until = -math.inf

    def repeats(self, message: bytes, *, bundled: bool, now: float) -> bool:
        """Return whether a message that came at a steady time in s has come the other way."""
        if now >= self._until or sum(map(len, self._generations[1])) > MOST_REMEMBERED:
            self._generations = self._generations[1], self._new()
            self._until = now + MEMORY
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
        """Return what came by itself, and what came in bundles."""
        return Counter(), Counter()


class InOrder(Generic[Item]):
    """Puts items that come in rounds into the order of their times.

    An item waits until those of its round, and all rounds before, have waited for a number of
    rounds, counted and not timed: a clock that is set back holds nothing up.

    Parameters
    ----------
    rounds : int
    """

    def __init__(self, rounds: int) -> None:
        self._waiting: list[tuple[int, Item]] = []
        self._newest: deque[float] = deque([-math.inf] * rounds)

    def round(self, items: Iterable[tuple[int, Item]]) -> list[tuple[int, Item]]:
        """Add a round of times and items; return those that have waited, in order."""
        added = list(items)
        self._waiting += added
        self._waiting.sort(key=itemgetter(0))
        self._newest.append(max((time for time, _ in added), default=-math.inf))
        limit = self._newest.popleft()
        done = list(takewhile(lambda item: item[0] <= limit, self._waiting))
        del self._waiting[: len(done)]
        return done

    def rest(self) -> list[tuple[int, Item]]:
        """Return all that waits, in order."""
        rest, self._waiting = self._waiting, []
        return rest

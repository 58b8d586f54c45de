# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bundles of samples of several signals, for receivers that tolerate a delay.

A bundle is a std_msgs/UInt8MultiArray in plain little-endian CDR. Its data are `_MARK`, the
length of a list of topics (2 bytes), their names with a line feed between them, and for each
sample, in order of sending, 80 bytes: system time of sending in ns (8), index of the topic (8),
stamp as in a message (8), and seven doubles, vector and orientation. The receiver creates the
messages.
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
"""Maximum time from the first sample of a bundle to its transmission while others follow, s. A
killed process loses these samples."""

LARGEST_BUNDLE = 48_000
"""Size above which a bundle is sent early, bytes. With one more sample it is still below the
largest UDP datagram (65,507 bytes), so the middleware need not fragment it."""

LONGEST_BUNDLE = 2 * LARGEST_BUNDLE
"""Size above which a bundle is rejected, bytes; a valid one with its last sample and table is
smaller."""

OLDEST = 1.0
"""Maximum age of a sample when its bundle is received, s; larger ages are clipped."""

DUPLICATE_MEMORY = 5.0
"""Minimum time for which a message is remembered, to detect its duplicate on the other path, s."""

MOST_REMEMBERED = 100_000
"""Number of messages of one topic above which older ones are forgotten earlier."""

_MARK = b"hab2"
_BEFORE = struct.Struct("<4sIII")  # encapsulation; no dimension, no offset, length of the data
_ENCAPSULATION = b"\0\1\0\0"
_PADDING = 3  # maximum number of padding bytes added by the middleware
_LENGTH = struct.Struct("<H")
_SAMPLE = struct.Struct("<QQiI7d")
_PARTS = struct.Struct("<QQ8s56s")  # the same, with bytes for a message
_BETWEEN = "\n"

Item = TypeVar("Item")

Entry = tuple[str, int, bytes, bytes]
"""Topic, system time of sending in ns, bytes of the stamp, and of vector and orientation."""


class Bundle:
    """Collect samples, and pack them."""

    def __init__(self) -> None:
        self._topics: list[str] = []
        self._samples = bytearray()

    def index(self, topic: str) -> int:
        """Return the index of a topic, by its full name, in this and all later bundles."""
        if topic not in self._topics:
            self._topics.append(topic)
        return self._topics.index(topic)

    def put(self, time: int, index: int, stamp: int, *values: float) -> bool:
        """Add a sample: system times in ns, vector and orientation; return True if it is full."""
        self._samples += _SAMPLE.pack(time, index, *divmod(stamp, NANOSECONDS), *values)
        return len(self._samples) > LARGEST_BUNDLE

    def flush(self) -> bytes:
        """Return the packed bundle and start another; empty if there is no sample."""
        if not self._samples:
            return b""
        table = _BETWEEN.join(self._topics).encode()
        data = b"".join((_MARK, _LENGTH.pack(len(table)), table, self._samples))
        self._samples.clear()
        return _BEFORE.pack(_ENCAPSULATION, 0, 0, len(data)) + data


def unpack_bundle(data: bytes) -> list[Entry]:
    """Return the samples of a bundle, in order of sending.

    Raises
    ------
    ValueError
        The data are not a complete bundle; all of its samples are then rejected.
    """
    if len(data) < _BEFORE.size + len(_MARK) + _LENGTH.size:
        raise ValueError("too short")
    if len(data) > LONGEST_BUNDLE:
        raise ValueError("too long")
    encapsulation, dimensions, _, length = _BEFORE.unpack_from(data)
    offset = _BEFORE.size
    end = offset + length
    if encapsulation[:2] != _ENCAPSULATION[:2] or dimensions:
        raise ValueError("not a list of bytes in plain little-endian CDR")
    if not end <= len(data) <= end + _PADDING:
        raise ValueError("of another length than stated")
    if data[offset : offset + len(_MARK)] != _MARK:
        raise ValueError(f"does not begin with {_MARK.decode()}: another version?")
    offset += len(_MARK) + _LENGTH.size
    (size,) = _LENGTH.unpack_from(data, offset - _LENGTH.size)
    topics = data[offset : offset + size].decode().split(_BETWEEN)
    offset += size
    if offset > end or (end - offset) % _PARTS.size:
        raise ValueError("ends within a sample")
    entries = list(_PARTS.iter_unpack(data[offset:end]))
    if any(index >= len(topics) for _, index, _, _ in entries):
        raise ValueError("samples of unknown topics")
    return [(topics[index], sent, stamp, numbers) for sent, index, stamp, numbers in entries]


def believed(time: int, received: int) -> int:
    """Return the corrected time of a sample in a bundle; both arguments are system times in ns.

    The result is before the reception, by at most `OLDEST`, regardless of the sender's clock.
    Samples of one sender stay in order.
    """
    return min(max(time, received - round(OLDEST * NANOSECONDS)), received)


class BothWays:
    """Filter of duplicates of messages that arrive directly and in bundles.

    A message is a duplicate if equal bytes arrived on the other path. Equal messages of two
    publishers, or sent twice by one publisher, are therefore recorded twice.
    """

    def __init__(self) -> None:
        # In each generation, records of direct and of bundled messages.
        self._generations = [(Counter[bytes](), Counter[bytes]()) for _ in range(2)]
        self._until = -math.inf

    def repeats(self, message: bytes, *, bundled: bool, now: float) -> bool:
        """Return True if a message, received at a monotonic time in s, is a duplicate."""
        if now >= self._until or sum(map(len, self._generations[1])) > MOST_REMEMBERED:
            self._generations = [self._generations[1], (Counter(), Counter())]
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

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples and states as bytes: messages in ROS format, and bundles of several signals.

PoseStamped, TwistStamped, WrenchStamped, AccelStamped and Vector3Stamped are a header followed by
doubles, of which the first three are the signal. Filling and reading message objects would take a
node longer than all its other work. Packing the same bytes takes a microsecond. Format: OMG
DDS-RTPS 2.5, section 10.2 (CDR); times and doubles are aligned to their size.

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
from collections.abc import Iterable, Mapping
from itertools import takewhile
from operator import itemgetter
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from haptic_accel.core.model import IDENTITY, FloatArray, Quaternion, Vector
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, IntArray
from haptic_accel.core.topics import VECTORS, Topic

ByteArray = npt.NDArray[np.uint8]

Offset = TypeVar("Offset", int, IntArray)

STAMP_BYTES = slice(4, 12)
"""Byte range of the stamp in a message with a header: s and ns, four bytes each."""

_ENCAPSULATION = b"\0\1\0\0"  # plain little-endian CDR without options
_ORIGIN = len(_ENCAPSULATION)  # alignment counts from here
_BYTE_ORDERS = {0: ">", 1: "<"}  # second byte of plain CDR's encapsulation
_HEADERS = {code: struct.Struct(f"{mark}iII") for code, mark in _BYTE_ORDERS.items()}
_HEADER_SIZE = _HEADERS[1].size  # stamp, and length of the frame's name including its NUL
_STAMP = struct.Struct("<iI")
_LENGTH = struct.Struct("<I")
_VECTORS = {code: struct.Struct(f"{mark}3d") for code, mark in _BYTE_ORDERS.items()}
_VECTOR_SIZE = _VECTORS[1].size
_QUATERNIONS = {code: struct.Struct(f"{mark}4d") for code, mark in _BYTE_ORDERS.items()}
_BEHIND = {"pose.position": struct.pack("<4d", *IDENTITY), "vector": b""}
"""Bytes after the vector, by its path: an identity quaternion, nothing, or no rotation."""
_NO_ROTATION = bytes(24)


def _vector_offset(frame_length: Offset) -> Offset:
    """Return the offset of the doubles for a frame name's length, NUL included."""
    return _ORIGIN + (_HEADER_SIZE + frame_length + 7 & ~7)


class StampedVector:
    """Pack the messages of one signal.

    Parameters
    ----------
    topic : Topic
        Topic, which determines type and frame.
    """

    def __init__(self, topic: Topic) -> None:
        frame = topic.frame.encode() + b"\0"
        self._offset = _vector_offset(len(frame))
        header = _HEADERS[1].pack(0, 0, len(frame))
        behind = _BEHIND.get(VECTORS[topic.type], _NO_ROTATION)
        start = (_ENCAPSULATION + header + frame).ljust(self._offset, b"\0")
        self._bytes = bytearray(start + bytes(_VECTOR_SIZE) + behind)
        self._orientation = IDENTITY
        is_pose = VECTORS[topic.type] == "pose.position"
        end = self._offset + _VECTOR_SIZE + is_pose * _QUATERNIONS[1].size
        self._numbers, self._rest = end - self._offset, bytes(self._bytes[end:])
        self._frame = bytes(self._bytes[STAMP_BYTES.stop : self._offset])

    def pack(self, stamp: int, vector: Vector, orientation: Quaternion = IDENTITY) -> bytes:
        """Return the message for a stamp, system time in ns, and a vector.

        Only a pose has an orientation.
        """
        if orientation is not self._orientation:
            self._orientation = orientation
            _QUATERNIONS[1].pack_into(self._bytes, self._offset + _VECTOR_SIZE, *orientation)
        _STAMP.pack_into(self._bytes, _ORIGIN, *divmod(stamp, NANOSECONDS))
        _VECTORS[1].pack_into(self._bytes, self._offset, *vector)
        return bytes(self._bytes)

    def join(self, stamp: bytes, numbers: bytes) -> bytes:
        """Return the message for the bytes of a stamp, and of a vector with an orientation."""
        found = numbers[: self._numbers]
        return b"".join((_ENCAPSULATION, stamp, self._frame, found, self._rest))


def pack_diagnostics(
    stamp: int, level: int, name: str, message: str, hardware: str, values: Mapping[str, str]
) -> bytes:
    """Return a diagnostic_msgs/DiagnosticArray of one status.

    Filling a message object with some fifty values takes ten times longer, more than the rest of a
    period.

    Parameters
    ----------
    stamp : int
        System time, ns.
    level : int
        0 for OK, 1 for WARN.
    name, message, hardware : str
    values : mapping
    """
    data = bytearray(_ENCAPSULATION + _STAMP.pack(*divmod(stamp, NANOSECONDS)))
    _append_text(data, "")
    data += bytes(-(len(data) - _ORIGIN) % _LENGTH.size) + _LENGTH.pack(1) + bytes([level])
    for text in (name, message, hardware):
        _append_text(data, text)
    data += bytes(-(len(data) - _ORIGIN) % _LENGTH.size) + _LENGTH.pack(len(values))
    for pair in values.items():
        for text in pair:
            _append_text(data, text)
    return bytes(data)


def pack_text(text: str) -> bytes:
    """Return a std_msgs/String as little-endian CDR."""
    data = bytearray(_ENCAPSULATION)
    _append_text(data, text)
    return bytes(data)


def _append_text(data: bytearray, text: str) -> None:
    encoded = text.encode() + b"\0"
    data += bytes(-(len(data) - _ORIGIN) % _LENGTH.size) + _LENGTH.pack(len(encoded)) + encoded


def _unpacked(
    layouts: Mapping[int, struct.Struct], data: bytes, behind: int = 0
) -> tuple[int, Any]:
    """Return the stamp of a message and the numbers at an offset after its first vector."""
    try:
        order = data[1]
        sec, nanosec, frame_length = _HEADERS[order].unpack_from(data, _ORIGIN)
        numbers = layouts[order].unpack_from(data, _vector_offset(frame_length) + behind)
    except KeyError:
        raise ValueError("not plain CDR") from None
    except (IndexError, struct.error):
        raise ValueError("too short") from None
    return sec * NANOSECONDS + nanosec, numbers


def unpack_stamped_vector(data: bytes) -> tuple[int, Vector]:
    """Return stamp (system time, ns) and vector of a message.

    Raises
    ------
    ValueError
        The message is not a header with three doubles in plain CDR.
    """
    # The usual message passes without a check, as ten of them arrive per millisecond.
    return _unpacked(_VECTORS, data)


def unpack_orientation(data: bytes) -> tuple[float, ...]:
    """Return the orientation (x, y, z, w) of a pose.

    Raises
    ------
    ValueError
        The message is not a pose in plain CDR.
    """
    orientation: tuple[float, ...] = _unpacked(_QUATERNIONS, data, _VECTOR_SIZE)[1]
    return orientation


def unpack_state(data: bytes) -> bool:
    """Return the value of a std_msgs/Bool.

    Raises
    ------
    ValueError
        The message is not a byte in plain CDR.
    """
    if len(data) <= _ORIGIN:
        raise ValueError("too short")
    if data[1] not in _BYTE_ORDERS:
        raise ValueError("not plain CDR")
    return bool(data[_ORIGIN])


def unpack_text(data: bytes, offset: int) -> str:
    """Return the text at an offset of a message, in bytes from its start.

    Raises
    ------
    ValueError
        The bytes are not a text in plain CDR.
    """
    if len(data) < offset + _LENGTH.size:
        raise ValueError("too short")
    if data[1] not in _BYTE_ORDERS:
        raise ValueError("not plain CDR")
    (length,) = struct.unpack_from(f"{_BYTE_ORDERS[data[1]]}I", data, offset)
    begin = offset + _LENGTH.size
    if not 0 < length <= len(data) - begin:
        raise ValueError("too short")
    return data[begin : begin + length - 1].decode(errors="replace")  # without its NUL


def unpack_stamped_vectors(
    block: ByteArray, starts: IntArray, ends: IntArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Return stamps and vectors of the well-formed messages in a block of bytes.

    Parameters
    ----------
    block : ndarray of uint8
    starts, ends : ndarray of int64, shape (n,)
        Start and end of each message in the block.

    Returns
    -------
    stamps : ndarray of int64, shape (m,)
        System time, ns.
    values : ndarray of float, shape (m, 3)
    formed : ndarray of bool, shape (n,)
        True for the m messages that consist of a header and three doubles in plain CDR.
    """
    stamps = np.empty(len(starts), dtype=np.int64)
    values = np.empty((len(starts), 3))
    formed = np.zeros(len(starts), dtype=bool)
    long_enough = np.flatnonzero(ends - starts >= _ORIGIN + _HEADER_SIZE)
    order = block[starts[long_enough] + 1]
    for code, mark in _BYTE_ORDERS.items():
        chosen = long_enough[order == code]
        header = _gathered(block, starts[chosen] + _ORIGIN, _HEADER_SIZE)
        words = header.view(f"{mark}u4").astype(np.int64)
        seconds = header.view(f"{mark}i4")[:, 0].astype(np.int64)
        stamps[chosen] = seconds * NANOSECONDS + words[:, 1]
        offsets = starts[chosen] + _vector_offset(words[:, 2])
        fits = offsets + _VECTOR_SIZE <= ends[chosen]
        formed[chosen] = fits
        values[chosen[fits]] = _gathered(block, offsets[fits], _VECTOR_SIZE).view(f"{mark}f8")
    return stamps[formed], values[formed], formed


def unpack_stamps(stamps: bytes) -> IntArray:
    """Return stamps, ns, from the joined `STAMP_BYTES` of little-endian messages."""
    words = np.frombuffer(stamps, "<u4").astype(np.int64)
    return words[::2] * NANOSECONDS + words[1::2]


def _gathered(block: ByteArray, offsets: IntArray, size: int) -> ByteArray:
    """Return the bytes at several offsets, each with the same size, shape (n, size)."""
    gathered: ByteArray = block[offsets[:, None] + np.arange(size)]
    return gathered


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
_PADDING = 3  # maximum number of padding bytes added by the middleware
_TABLE_LENGTH = struct.Struct("<H")
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
        data = b"".join((_MARK, _TABLE_LENGTH.pack(len(table)), table, self._samples))
        self._samples.clear()
        return _BEFORE.pack(_ENCAPSULATION, 0, 0, len(data)) + data


def unpack_bundle(data: bytes) -> list[Entry]:
    """Return the samples of a bundle, in order of sending.

    Raises
    ------
    ValueError
        The data are not a complete bundle; all of its samples are then rejected.
    """
    if len(data) < _BEFORE.size + len(_MARK) + _TABLE_LENGTH.size:
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
    offset += len(_MARK) + _TABLE_LENGTH.size
    (size,) = _TABLE_LENGTH.unpack_from(data, offset - _TABLE_LENGTH.size)
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

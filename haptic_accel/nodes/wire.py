"""Stamped vectors as the bytes that ROS sends: one packing for all of the graph's signals.

PoseStamped, TwistStamped, WrenchStamped and AccelStamped all are a header followed by doubles,
of which the first three are what the graph is about. Filling and reading message objects would
cost a node more than everything else it does; packing the same bytes costs a microsecond.
Format: OMG DDS-RTPS 2.5, section 10.2 (CDR); times and doubles are aligned to their size.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import NANOSECONDS

LITTLE_ENDIAN_CDR = b"\x00\x01"
"""First bytes of plain little-endian CDR; the two after them are options."""


_ORIGIN = 4  # alignment counts from behind the encapsulation
_HEADER = struct.Struct("<iII")  # stamp, and length of the frame's name
_STAMP = struct.Struct("<iI")
_VECTOR = struct.Struct("<3d")


def _vector_offset(frame_length: int) -> int:
    """Return where the doubles start behind a frame's name of a length with its NUL."""
    return _ORIGIN + (_HEADER.size + frame_length + 7 & ~7)


class StampedVector:
    """Writes messages of one type and frame.

    Parameters
    ----------
    message : ROS message
        One of the four types, with everything but stamp and vector as it is to be sent.
    """

    def __init__(self, message: Any) -> None:
        self._bytes = bytearray(serialize_message(message))
        if self._bytes[:2] != LITTLE_ENDIAN_CDR:
            raise RuntimeError("only little-endian machines are supported")
        self._offset = _vector_offset(len(message.header.frame_id.encode()) + 1)

    def pack(self, stamp: int, vector: Vector) -> bytes:
        """Return the message with a stamp, system time in ns, and a vector."""
        _STAMP.pack_into(self._bytes, _ORIGIN, *divmod(stamp, NANOSECONDS))
        _VECTOR.pack_into(self._bytes, self._offset, *vector)
        return bytes(self._bytes)


def reader(message_type: Any, field: str) -> Callable[[bytes], tuple[int, Vector]]:
    """Return a function that reads stamp (ns) and vector of a message type's bytes.

    Parameters
    ----------
    message_type : type
        One of the four types.
    field : str
        Path of the vector in it, for senders that write something else than plain CDR.
    """

    def read(data: bytes) -> tuple[int, Vector]:
        if data[:2] != LITTLE_ENDIAN_CDR:
            return _read_slowly(deserialize_message(data, message_type), field)
        sec, nanosec, frame_length = _HEADER.unpack_from(data, _ORIGIN)
        vector = _VECTOR.unpack_from(data, _vector_offset(frame_length))
        return sec * NANOSECONDS + nanosec, vector

    return read


def _read_slowly(message: Any, field: str) -> tuple[int, Vector]:
    stamp = message.header.stamp
    vector = message
    for name in field.split("."):
        vector = getattr(vector, name)
    return stamp.sec * NANOSECONDS + stamp.nanosec, (vector.x, vector.y, vector.z)

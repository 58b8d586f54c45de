"""Bytes and frames of the serial protocol (docs/serial_protocol.md): no port, no clock.

A frame is version, type, sequence number, sender's clock, payload and CRC-16, all little-endian,
stuffed by COBS and ended by a zero. `firmware/haptic_handle/protocol.cpp` is the same in C++.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, NamedTuple, Protocol

from cobs import cobs  # type: ignore[import-untyped]

VERSION = 1
"""Of the protocol."""

CRC_START = 0xFFFF
"""CRC-16/CCITT-FALSE (CRC-16/IBM-3740): polynomial 0x1021, not reflected, check value 0x29B1."""

DELIMITER = b"\0"
"""Ends a frame; COBS leaves no other zero."""

LONGEST_PAYLOAD = 240
"""Bytes: header, payload and CRC stay below the 254 that COBS stuffs with one byte."""

FULL_SCALE = 32767
"""Counts of the full-scale current either way."""

SEQUENCES = 1 << 16
"""A sequence number begins anew after as many frames."""

AXES = "xyz"
"""Of an accelerometer, in the order of the bits that stand for them."""

_HEADER = struct.Struct("<BBHI")
_CRC = struct.Struct("<H")
_OVERHEAD = _HEADER.size + _CRC.size
LONGEST_ENCODED = _OVERHEAD + LONGEST_PAYLOAD + 1
"""Bytes between two delimiters."""


class FrameType(IntEnum):
    """What a frame is; those from the device have the highest bit."""

    IDENTIFY = 0x01
    CONFIGURE = 0x02
    ARM = 0x03
    DISARM = 0x04
    SET_CURRENT = 0x05
    IDENTITY = 0x81
    CONFIGURATION = 0x82
    SAMPLES = 0x83
    STATUS = 0x84
    ERROR = 0x85


class State(IntEnum):
    """Of the device; a current flows only while it is armed."""

    DISARMED = 0
    ARMED = 1
    TIMED_OUT = 2
    FAULT = 3


class ErrorCode(IntEnum):
    """Why the device refused a frame."""

    VERSION = 1
    TYPE = 2
    LENGTH = 3
    VALUE = 4
    NO_ACTUATOR = 5
    FAULT = 6


class PayloadError(ValueError):
    """A payload that its type of frame cannot have."""


class Frame(NamedTuple):
    """One frame with an intact CRC; its payload may still be nonsense.

    Attributes
    ----------
    version, type : int
    sequence : int
        The sender's count of frames, modulo `SEQUENCES`.
    clock : int
        The sender's clock, us modulo 2**32; of samples, when the first was taken.
    payload : bytes
    """

    version: int
    type: int
    sequence: int
    clock: int
    payload: bytes


class Message(Protocol):
    """The meaning of a payload."""

    TYPE: ClassVar[FrameType]

    def pack(self) -> bytes:
        """Return the payload."""


@dataclass(frozen=True)
class Identify:
    """Asks for the identity."""

    TYPE: ClassVar = FrameType.IDENTIFY

    def pack(self) -> bytes:
        """Return the payload."""
        return b""


@dataclass(frozen=True)
class Arm:
    """Allows a current."""

    TYPE: ClassVar = FrameType.ARM

    def pack(self) -> bytes:
        """Return the payload."""
        return b""


@dataclass(frozen=True)
class Disarm:
    """Takes the current off until the device is armed again."""

    TYPE: ClassVar = FrameType.DISARM

    def pack(self) -> bytes:
        """Return the payload."""
        return b""


@dataclass(frozen=True)
class SetCurrent:
    """A set-point of the current.

    Attributes
    ----------
    counts : int
        Of `FULL_SCALE`: no pattern of its bits is beyond the range, or no number.
    """

    TYPE: ClassVar = FrameType.SET_CURRENT
    counts: int

    def pack(self) -> bytes:
        """Return the payload."""
        return struct.pack("<h", self.counts)


@dataclass(frozen=True)
class Configuration:
    """How samples are taken and sent.

    Attributes
    ----------
    rate : int
        Samples per second; 0 for none.
    axes : int
        One bit each, x the lowest.
    samples_per_frame : int
    """

    TYPE: ClassVar = FrameType.CONFIGURATION
    rate: int
    axes: int
    samples_per_frame: int

    def pack(self) -> bytes:
        """Return the payload."""
        return struct.pack("<HBB", self.rate, self.axes, self.samples_per_frame)


@dataclass(frozen=True)
class Configure(Configuration):
    """Asks for a configuration, which the device answers with the one it has."""

    TYPE: ClassVar = FrameType.CONFIGURE


@dataclass(frozen=True)
class Identity:
    """What the device is.

    Attributes
    ----------
    firmware : tuple of int
        Major, minor, patch.
    axes : int
        Of its accelerometer, one bit each.
    highest_rate : int
        Samples per second.
    full_scale_acceleration : float
        Nominal, of 32767 counts, m/s^2.
    full_scale_current : float
        Of `FULL_SCALE` counts, A; 0 where there is no actuator.
    serial_number : str
        At most 16 ASCII characters.
    """

    TYPE: ClassVar = FrameType.IDENTITY
    firmware: tuple[int, int, int]
    axes: int
    highest_rate: int
    full_scale_acceleration: float
    full_scale_current: float
    serial_number: str

    @property
    def nominal_gain(self) -> float:
        """Acceleration of a count, m/s^2."""
        return self.full_scale_acceleration / FULL_SCALE

    def pack(self) -> bytes:
        """Return the payload."""
        return _IDENTITY.pack(
            *self.firmware,
            self.axes,
            self.highest_rate,
            self.full_scale_acceleration,
            self.full_scale_current,
            self.serial_number.encode("ascii"),
        )


@dataclass(frozen=True)
class Samples:
    """Successive samples of an accelerometer.

    Attributes
    ----------
    index : int
        How many samples were taken before the first of these, modulo 2**32.
    axes : int
        One bit each.
    counts : tuple of int
        Sample by sample, within each axis by axis.
    """

    TYPE: ClassVar = FrameType.SAMPLES
    index: int
    axes: int
    counts: tuple[int, ...]

    def pack(self) -> bytes:
        """Return the payload."""
        number = len(self.counts) // self.axes.bit_count()
        head = _SAMPLES.pack(self.index, self.axes, number)
        return head + struct.pack(f"<{len(self.counts)}h", *self.counts)


@dataclass(frozen=True)
class Status:
    """How the device is, and what it has counted since it started.

    Attributes
    ----------
    state : State
    current : int
        That flows, counts of `FULL_SCALE`.
    received, damaged, lost : int
        Frames from the host: intact, not intact, missing by their sequence numbers.
    refused : int
        Set-points while it was not armed.
    timeouts : int
        How often set-points stopped for 5 ms.
    unsent : int
        Frames that the port had no room for.
    """

    TYPE: ClassVar = FrameType.STATUS
    state: State
    current: int
    received: int
    damaged: int
    lost: int
    refused: int
    timeouts: int
    unsent: int

    def pack(self) -> bytes:
        """Return the payload."""
        return _STATUS.pack(
            self.state,
            self.current,
            self.received,
            self.damaged,
            self.lost,
            self.refused,
            self.timeouts,
            self.unsent,
        )


@dataclass(frozen=True)
class Error:
    """The device did not do what a frame said.

    Attributes
    ----------
    code : ErrorCode
    type, sequence : int
        Of the frame that it refused.
    """

    TYPE: ClassVar = FrameType.ERROR
    code: ErrorCode
    type: int
    sequence: int

    def pack(self) -> bytes:
        """Return the payload."""
        return struct.pack("<BBH", self.code, self.type, self.sequence)


_IDENTITY = struct.Struct("<BBBBHff16s")
_SAMPLES = struct.Struct("<IBB")
_STATUS = struct.Struct("<BhIIIIII")


def most_samples(axes: int) -> int:
    """Return how many samples of some axes, one bit each, a frame can have."""
    return (LONGEST_PAYLOAD - _SAMPLES.size) // (2 * axes.bit_count())


def read_message(frame: Frame) -> Message:
    """Return the meaning of a frame.

    Raises
    ------
    PayloadError
        Of another version, of no known type, or with a payload that its type cannot have.
    """
    if frame.version != VERSION:
        raise PayloadError(f"version {frame.version} of the protocol, must be {VERSION}")
    try:
        return _READERS[frame.type](frame.payload)
    except KeyError:
        raise PayloadError(f"type 0x{frame.type:02X} of a frame, not known") from None
    except (struct.error, ValueError) as error:
        raise PayloadError(f"payload of type 0x{frame.type:02X}: {error}") from None


def _read_empty(kind: type[Identify] | type[Arm] | type[Disarm], payload: bytes) -> Message:
    if payload:
        raise PayloadError("must be empty")
    return kind()


def _read_identity(payload: bytes) -> Identity:
    *firmware, axes, rate, acceleration, current, serial_number = _IDENTITY.unpack(payload)
    # NaN compares as false and is refused as well.
    if not 0 < acceleration < float("inf") or not 0 <= current < float("inf"):
        raise PayloadError("full scales must be finite and positive")
    major, minor, patch = firmware
    text = serial_number.rstrip(b"\0").decode("ascii")
    return Identity((major, minor, patch), axes, rate, acceleration, current, text)


def _read_samples(payload: bytes) -> Samples:
    index, axes, number = _SAMPLES.unpack_from(payload)
    if not 0 < axes < 1 << len(AXES):
        raise PayloadError("must have axes x, y or z")
    counts = struct.unpack_from(f"<{number * axes.bit_count()}h", payload, _SAMPLES.size)
    if not counts or len(payload) != _SAMPLES.size + 2 * len(counts):
        raise PayloadError("must be as long as its samples")
    return Samples(index, axes, counts)


def _read_status(payload: bytes) -> Status:
    state, *numbers = _STATUS.unpack(payload)
    return Status(State(state), *numbers)


def _read_error(payload: bytes) -> Error:
    code, kind, sequence = struct.unpack("<BBH", payload)
    return Error(ErrorCode(code), kind, sequence)


_READERS: dict[int, Callable[[bytes], Message]] = {
    FrameType.IDENTIFY: lambda payload: _read_empty(Identify, payload),
    FrameType.ARM: lambda payload: _read_empty(Arm, payload),
    FrameType.DISARM: lambda payload: _read_empty(Disarm, payload),
    FrameType.SET_CURRENT: lambda payload: SetCurrent(*struct.unpack("<h", payload)),
    FrameType.CONFIGURE: lambda payload: Configure(*struct.unpack("<HBB", payload)),
    FrameType.CONFIGURATION: lambda payload: Configuration(*struct.unpack("<HBB", payload)),
    FrameType.IDENTITY: _read_identity,
    FrameType.SAMPLES: _read_samples,
    FrameType.STATUS: _read_status,
    FrameType.ERROR: _read_error,
}


def encode(frame: Frame) -> bytes:
    """Return a frame as it goes over the wire, its delimiter included."""
    head = _HEADER.pack(frame.version, frame.type, frame.sequence, frame.clock)
    body = head + frame.payload
    stuffed: bytes = cobs.encode(body + _CRC.pack(binascii.crc_hqx(body, CRC_START)))
    return stuffed + DELIMITER


def decode(stuffed: bytes) -> Frame | None:
    """Return the frame between two delimiters; None where it is damaged."""
    try:
        body = cobs.decode(stuffed)
    except cobs.DecodeError:
        return None
    if not _OVERHEAD <= len(body) <= _OVERHEAD + LONGEST_PAYLOAD:
        return None
    content = body[: -_CRC.size]
    if (binascii.crc_hqx(content, CRC_START),) != _CRC.unpack_from(body, len(content)):
        return None
    version, kind, sequence, clock = _HEADER.unpack_from(content)
    return Frame(version, kind, sequence, clock, content[_HEADER.size :])


class Encoder:
    """Numbers the frames of one sender."""

    def __init__(self) -> None:
        self._sequence = 0

    def encode(self, message: Message, clock: int) -> bytes:
        """Return a message as a frame, stamped with the sender's clock in us."""
        sequence, self._sequence = self._sequence, (self._sequence + 1) % SEQUENCES
        return encode(Frame(VERSION, message.TYPE, sequence, clock & 0xFFFFFFFF, message.pack()))


class Decoder:
    """Finds frames in bytes as they come, from any place on.

    Attributes
    ----------
    received : int
        Frames with an intact CRC.
    damaged : int
        Stretches between delimiters that were none.
    lost : int
        Frames missing, by the sequence numbers of those received.
    """

    def __init__(self) -> None:
        self._pending = bytearray()
        self._too_long = False
        self._expected: int | None = None
        self.received = self.damaged = self.lost = 0

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames that end within some bytes; what is left waits for more."""
        frames = []
        *ended, rest = data.split(DELIMITER)
        for piece in ended:
            self._keep(piece)
            frame = self._take()
            if frame:
                frames.append(frame)
        self._keep(rest)
        return frames

    def restart(self) -> None:
        """Expect another sender, whose sequence begins anywhere."""
        self._pending.clear()
        self._too_long = False
        self._expected = None

    def _keep(self, piece: bytes | bytearray) -> None:
        if len(self._pending) + len(piece) > LONGEST_ENCODED:
            # No frame is as long: what is kept must not grow without end.
            self._too_long = True
            self._pending.clear()
        elif not self._too_long:
            self._pending += piece

    def _take(self) -> Frame | None:
        stuffed, too_long = bytes(self._pending), self._too_long
        self._pending.clear()
        self._too_long = False
        if not (stuffed or too_long):
            return None
        frame = None if too_long else decode(stuffed)
        if frame is None:
            self.damaged += 1
            return None
        self.received += 1
        self._count_lost(frame.sequence)
        return frame

    def _count_lost(self, sequence: int) -> None:
        if self._expected is not None:
            gap = (sequence - self._expected) % SEQUENCES
            # More than half of all is a sender that has started anew.
            if gap < SEQUENCES // 2:
                self.lost += gap
        self._expected = (sequence + 1) % SEQUENCES


def axes_bits(names: Sequence[str]) -> int:
    """Return the bits that stand for axes."""
    return sum(1 << AXES.index(name) for name in names)

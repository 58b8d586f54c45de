# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of the serial protocol (see README.md in this folder), without port and clock.

A frame is version, type, sequence number, sender's clock, payload and CRC-16, all little-endian,
stuffed by COBS and ended by a zero. `firmware/haptic_handle/protocol.cpp` is the same in C++.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import compress
from typing import ClassVar, NamedTuple

from cobs import cobs  # type: ignore[import-untyped]

from haptic_accel.core.axes import NAMES

VERSION = 3
"""Version of the protocol in this package."""

ONE_COIL = 2
"""Version of the protocol for boards with one coil, which the driver also supports; only the
identity differs."""

VERSIONS = ONE_COIL, VERSION
"""Versions that the driver supports."""

FIRMWARE = 3, 0, 0
"""Version of the firmware in this package, `firmware/haptic_handle`."""

CRC_START = 0xFFFF
"""CRC-16/CCITT-FALSE (CRC-16/IBM-3740): polynomial 0x1021, not reflected, check value 0x29B1."""

DELIMITER = b"\0"
"""Last byte of a frame; COBS leaves no other zero."""

LONGEST_PAYLOAD = 240
"""Maximum length of a payload, bytes; with header and CRC below the 254 bytes for which COBS adds
one byte."""

FULL_SCALE = 32767
"""Counts at full scale, in both directions."""

SEQUENCES = 1 << 16
"""Number of frames after which sequence numbers restart."""

CLOCKS = 1 << 32
"""Modulus of clocks, in us, and of counts of samples."""

COUNT = 2
"""Number of bytes of a count."""

_HEADER = struct.Struct("<BBHI")
_CRC = struct.Struct("<H")
_OVERHEAD = _HEADER.size + _CRC.size
LONGEST_ENCODED = _OVERHEAD + LONGEST_PAYLOAD + 1
"""Maximum number of bytes between two delimiters."""


FROM_DEVICE = 0x80
"""Bit that is set in the types of frames from the device."""


class FrameType(IntEnum):
    """Type of a frame."""

    IDENTIFY = 0x01
    CONFIGURE = 0x02
    ARM = 0x03
    DISARM = 0x04
    SET_CURRENT = 0x05
    SCHEDULE_CURRENT = 0x06
    ALIGN = 0x07
    IDENTITY = 0x81
    CONFIGURATION = 0x82
    SAMPLES = 0x83
    STATUS = 0x84
    ERROR = 0x85


class State(IntEnum):
    """State of the device; a current flows only while it is armed."""

    DISARMED = 0
    ARMED = 1
    TIMED_OUT = 2
    FAULT = 3


class ErrorCode(IntEnum):
    """Device's reason for refusing a frame."""

    VERSION = 1
    TYPE = 2
    LENGTH = 3
    VALUE = 4
    NO_ACTUATOR = 5
    FAULT = 6


class PayloadError(ValueError):
    """Payload that does not fit its frame type."""


class Frame(NamedTuple):
    """Frame with an intact CRC; its payload may still be invalid.

    Attributes
    ----------
    version, type : int
    sequence : int
        Number of the frame at the sender, modulo `SEQUENCES`.
    clock : int
        The sender's clock, us modulo 2**32; for samples, the time of the first sample.
    payload : bytes
    """

    version: int
    type: int
    sequence: int
    clock: int
    payload: bytes


MESSAGES: dict[int, type[Message]] = {}
"""Messages by type of frame."""


@dataclass(frozen=True)
class Message:
    """Base class of messages, the contents of payloads.

    A subclass specifies its frame type, its payload layout and the matching fields.
    """

    TYPE: ClassVar[FrameType]
    LAYOUT: ClassVar = struct.Struct("")
    BYTES_PER_COIL: ClassVar = 0

    def __init_subclass__(cls, kind: FrameType, layout: str = "") -> None:
        """Set the frame type, and the payload layout unless inherited."""
        cls.TYPE = kind
        if layout:
            cls.LAYOUT = struct.Struct(layout)
        MESSAGES[kind] = cls

    def pack(self) -> bytes:
        """Return the payload."""
        return self.LAYOUT.pack(*vars(self).values())

    @classmethod
    def size(cls, coils: int) -> int:
        """Return the length of the payload for a board with a number of coils, bytes."""
        return cls.LAYOUT.size + cls.BYTES_PER_COIL * coils

    @classmethod
    def unpack(cls, payload: bytes) -> Message:
        """Return the message of a payload.

        Raises
        ------
        struct.error, ValueError
            The payload is not valid for the frame type.
        """
        return cls(*cls.LAYOUT.unpack(payload))


@dataclass(frozen=True)
class Identify(Message, kind=FrameType.IDENTIFY):
    """Request for the identity."""


@dataclass(frozen=True)
class ArmRequest(Message, kind=FrameType.ARM):
    """Permission for a current to flow."""


@dataclass(frozen=True)
class DisarmRequest(Message, kind=FrameType.DISARM):
    """Command to switch the current off until the device is armed again."""


def coil_layout(payload: bytes, layout: str) -> str:
    """Return the layout for the number of coils that matches a payload's length.

    Raises
    ------
    ValueError
        No number of coils matches.

    Examples
    --------
    >>> coil_layout(bytes(8), "<{}hI")
    '<2hI'
    """
    coils = (len(payload) - struct.calcsize(layout.format(0))) // COUNT
    if not 0 <= coils <= len(NAMES):
        raise ValueError(f"must have counts of at most {len(NAMES)} coils")
    return layout.format(coils)


@dataclass(frozen=True)
class SetCurrent(Message, kind=FrameType.SET_CURRENT):
    """Set-points of all coils that act at once and discard scheduled set-points.

    Attributes
    ----------
    counts : tuple of int
        Currents of the board's coils in the order x, y, z, in counts, `FULL_SCALE` for full scale.
        Every bit pattern is a valid number.
    """

    counts: tuple[int, ...]

    BYTES_PER_COIL: ClassVar = COUNT

    def pack(self) -> bytes:
        """Return the payload."""
        return struct.pack(f"<{len(self.counts)}h", *self.counts)

    @classmethod
    def unpack(cls, payload: bytes) -> SetCurrent:
        """Return the message of a payload."""
        return cls(struct.unpack(coil_layout(payload, "<{}h"), payload))


@dataclass(frozen=True)
class ScheduleCurrent(Message, kind=FrameType.SCHEDULE_CURRENT, layout="<I"):
    """Set-points of all coils that act from a specified sampling tick on.

    Attributes
    ----------
    counts : tuple of int
        As in `SetCurrent`.
    due : int
        Time of the tick by the device's clock, us, within half a period.
    """

    counts: tuple[int, ...]
    due: int

    BYTES_PER_COIL: ClassVar = COUNT

    def pack(self) -> bytes:
        """Return the payload."""
        return struct.pack(f"<{len(self.counts)}hI", *self.counts, self.due)

    @classmethod
    def unpack(cls, payload: bytes) -> ScheduleCurrent:
        """Return the message of a payload."""
        *counts, due = struct.unpack(coil_layout(payload, "<{}hI"), payload)
        return cls(tuple(counts), due)


@dataclass(frozen=True)
class Align(Message, kind=FrameType.ALIGN, layout="<II"):
    """Request to move the sampling ticks onto a grid.

    Attributes
    ----------
    tick : int
        Time of any grid point by the device's clock, us.
    period : int
        Period of the grid by the device's clock, ns.
    """

    tick: int
    period: int


@dataclass(frozen=True)
class Configuration(Message, kind=FrameType.CONFIGURATION, layout="<HBB"):
    """Sampling rate, axes, and grouping of samples into frames.

    Attributes
    ----------
    rate : int
        Samples per second; 0 for none.
    axes : int
        Bit mask of axes, x the lowest bit.
    samples_per_frame : int
    """

    rate: int
    axes: int
    samples_per_frame: int


@dataclass(frozen=True)
class Configure(Configuration, kind=FrameType.CONFIGURE):
    """Request for a configuration, answered with the actual configuration."""


@dataclass(frozen=True)
class Identity(Message, kind=FrameType.IDENTITY, layout="<BBBBHffff16s"):
    """Description of the device.

    Attributes
    ----------
    firmware : tuple of int
        Major, minor, patch.
    axes : int
        Bit mask of the accelerometer's axes.
    highest_rate : int
        Samples per second.
    full_scale_acceleration : float
        Nominal acceleration of 32767 counts, m/s^2.
    full_scale_currents : tuple of float
        Currents of `FULL_SCALE` counts of the coils along x, y and z, A; 0 for axes without a
        coil. A board of one coil with an older firmware has the coil along z.
    serial_number : str
        At most 16 printable ASCII characters.
    """

    firmware: tuple[int, int, int]
    axes: int
    highest_rate: int
    full_scale_acceleration: float
    full_scale_currents: tuple[float, float, float]
    serial_number: str

    ONE_COIL_LAYOUT: ClassVar = struct.Struct("<BBBBHff16s")
    """Payload in version `ONE_COIL`."""

    @property
    def nominal_gain(self) -> float:
        """Acceleration of a count, m/s^2."""
        return self.full_scale_acceleration / FULL_SCALE

    @property
    def coils(self) -> tuple[str, ...]:
        """Axes of the coils, in the order of their counts."""
        return tuple(compress(NAMES, self.full_scale_currents))

    def pack(self) -> bytes:
        """Return the payload."""
        firmware, *numbers, currents, serial_number = vars(self).values()
        return self.LAYOUT.pack(*firmware, *numbers, *currents, serial_number.encode("ascii"))

    @classmethod
    def unpack(cls, payload: bytes) -> Identity:
        """Return the message of a payload; its length shows version `ONE_COIL`."""
        if len(payload) == cls.ONE_COIL_LAYOUT.size:
            *head, current, number = cls.ONE_COIL_LAYOUT.unpack(payload)
            currents = 0.0, 0.0, current
        else:
            *head, x, y, z, number = cls.LAYOUT.unpack(payload)
            currents = x, y, z
        *firmware, axes, rate, acceleration = head
        # NaN compares as false and is refused as well.
        if not 0 < acceleration < float("inf") or not all(
            0 <= current < float("inf") for current in currents
        ):
            raise ValueError("full scales must be finite and positive")
        text = number.rstrip(b"\0").decode("ascii")
        if not text.isprintable():
            raise ValueError("the serial number must be printable")
        return cls(tuple(firmware), axes, rate, acceleration, currents, text)


@dataclass(frozen=True)
class Samples(Message, kind=FrameType.SAMPLES, layout="<IBB"):
    """Successive samples of an accelerometer.

    Attributes
    ----------
    index : int
        Number of samples taken earlier, modulo 2**32.
    axes : int
        Bit mask of axes.
    counts : tuple of int
        Counts, ordered by sample, then by axis.
    """

    index: int
    axes: int
    counts: tuple[int, ...]

    @property
    def number(self) -> int:
        """Number of samples."""
        return len(self.counts) // self.axes.bit_count()

    def pack(self) -> bytes:
        """Return the payload."""
        head = self.LAYOUT.pack(self.index, self.axes, self.number)
        return head + struct.pack(f"<{len(self.counts)}h", *self.counts)

    @classmethod
    def unpack(cls, payload: bytes) -> Samples:
        """Return the message of a payload."""
        index, axes, number = cls.LAYOUT.unpack_from(payload)
        if not 0 < axes < 1 << len(NAMES) or not number:
            raise ValueError("must have samples of axes x, y or z")
        counts = struct.unpack(f"<{number * axes.bit_count()}h", payload[cls.LAYOUT.size :])
        return cls(index, axes, counts)


@dataclass(frozen=True)
class Status(Message, kind=FrameType.STATUS, layout="<B8I"):
    """State of the device, and counts since its start.

    Attributes
    ----------
    state : State
    currents : tuple of int
        Currents in the coils, counts of `FULL_SCALE`.
    received, damaged, lost : int
        Numbers of frames from the host: intact, damaged, missing by sequence number.
    refused : int
        Number of set-points received while not armed, or due too far ahead.
    timeouts : int
        Number of times that set-points stopped for 5 ms.
    unsent : int
        Number of frames that did not fit into the port's buffer.
    late : int
        Number of scheduled set-points that arrived after their tick, and acted at once.
    overflowed : int
        Number of scheduled set-points that did not fit into the queue.
    """

    state: State
    currents: tuple[int, ...]
    received: int
    damaged: int
    lost: int
    refused: int
    timeouts: int
    unsent: int
    late: int
    overflowed: int

    def __post_init__(self) -> None:
        """Convert the number of a state; raise `ValueError` if there is no such state."""
        object.__setattr__(self, "state", State(self.state))

    def pack(self) -> bytes:
        """Return the payload."""
        state, currents, *counts = vars(self).values()
        return struct.pack(f"<B{len(currents)}h8I", state, *currents, *counts)

    @classmethod
    def unpack(cls, payload: bytes) -> Status:
        """Return the message of a payload."""
        state, *numbers = struct.unpack(coil_layout(payload, "<B{}h8I"), payload)
        return cls(state, tuple(numbers[:-8]), *numbers[-8:])


@dataclass(frozen=True)
class Error(Message, kind=FrameType.ERROR, layout="<BBH"):
    """Refusal of a frame.

    Attributes
    ----------
    code : ErrorCode
    type, sequence : int
        Type and sequence number of the refused frame.
    """

    code: ErrorCode
    type: int
    sequence: int

    def __post_init__(self) -> None:
        """Convert the number of a code; raise `ValueError` if there is no such code."""
        object.__setattr__(self, "code", ErrorCode(self.code))


REQUESTS = {kind: message for kind, message in MESSAGES.items() if kind < FROM_DEVICE}
"""Messages from the host, by type of frame."""


def most_samples(axes: int) -> int:
    """Return the maximum number of samples per frame for a bit mask of axes."""
    return (LONGEST_PAYLOAD - Samples.LAYOUT.size) // (2 * axes.bit_count())


def read_message(frame: Frame) -> Message:
    """Return the message in a frame.

    Raises
    ------
    PayloadError
        The protocol version or the type is unknown, or the payload is not valid for the type.
    """
    if frame.version not in VERSIONS:
        raise PayloadError(f"version {frame.version} of the protocol, must be {VERSION}")
    if frame.type not in MESSAGES:
        raise PayloadError(f"type 0x{frame.type:02X} of a frame, not known")
    try:
        return MESSAGES[frame.type].unpack(frame.payload)
    except (struct.error, ValueError) as error:
        raise PayloadError(f"payload of type 0x{frame.type:02X}: {error}") from None


def encode(frame: Frame) -> bytes:
    """Return a frame as bytes on the wire, delimiter included."""
    head = _HEADER.pack(frame.version, frame.type, frame.sequence, frame.clock)
    body = head + frame.payload
    stuffed: bytes = cobs.encode(body + _CRC.pack(binascii.crc_hqx(body, CRC_START)))
    return stuffed + DELIMITER


def decode(stuffed: bytes) -> Frame | None:
    """Return the frame between two delimiters; None if it is damaged."""
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
    """Sequence counter of one sender's frames.

    Attributes
    ----------
    version : int
        Version of the protocol that the receiver supports.
    """

    def __init__(self) -> None:
        self.version = VERSION
        self._sequence = 0

    def encode(self, message: Message, clock: int) -> bytes:
        """Return a message as a frame, stamped with the sender's clock in us."""
        sequence, self._sequence = self._sequence, (self._sequence + 1) % SEQUENCES
        return encode(Frame(self.version, message.TYPE, sequence, clock % CLOCKS, message.pack()))


class Decoder:
    """Decoder of frames in a stream of bytes that starts at any position.

    Attributes
    ----------
    received : int
        Frames with an intact CRC.
    damaged : int
        Number of sections between delimiters that were not intact frames.
    lost : int
        Number of frames missing by sequence number.
    """

    def __init__(self) -> None:
        self.received = self.damaged = self.lost = 0
        self.restart()

    def restart(self) -> None:
        """Expect another sender, whose sequence starts at any number."""
        self._pending = b""
        self._expected: int | None = None

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames completed by `data`; keep the rest for the next call."""
        *ended, rest = (self._pending + data).split(DELIMITER)
        # Longer data are damaged, as no frame is longer, and must not grow without limit.
        self._pending = rest[: LONGEST_ENCODED + 1]
        frames = [decode(stuffed) for stuffed in ended if stuffed]
        intact = [frame for frame in frames if frame]
        self.received += len(intact)
        self.damaged += len(frames) - len(intact)
        for frame in intact:
            self._count_lost(frame.sequence)
        return intact

    def _count_lost(self, sequence: int) -> None:
        gap = 0 if self._expected is None else (sequence - self._expected) % SEQUENCES
        # A gap of more than half the range indicates a restarted sender.
        self.lost += gap if gap < SEQUENCES // 2 else 0
        self._expected = (sequence + 1) % SEQUENCES


def axes_bits(names: Sequence[str]) -> int:
    """Return the bit mask of axes, x the lowest bit."""
    return sum(1 << NAMES.index(name) for name in names)

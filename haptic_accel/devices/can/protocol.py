# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ODrive's CANSimple protocol: build and read frames, without a bus; bus load by the frames.

Frames have standard ids: the axis' node in the upper 6 of 11 bits, the command in the lower 5. All
numbers are little-endian. The layout follows ODrive's public firmware 0.5.6
(Firmware/communication/can/can_simple.cpp and docs/can-protocol.rst of odriverobotics/ODrive); the
part used here is the same in 0.6, except for the meaning of the error bits.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, NamedTuple

COMMAND_BITS = 5
"""Bits of an id that hold the command."""

HIGHEST_NODE = 0x3F
"""Highest node id: the upper 6 bits of a standard id."""

HIGHEST_ID = 0x7FF
"""Highest standard id, of 11 bits."""

LARGEST_TORQUE = 1e4
"""Largest accepted torque, N m; no motor reaches it."""


class Command(IntEnum):
    """Command of a frame."""

    HEARTBEAT = 0x01
    ESTOP = 0x02
    SET_AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    SET_CONTROLLER_MODE = 0x0B
    SET_INPUT_TORQUE = 0x0E
    CLEAR_ERRORS = 0x18


AxisState = IntEnum(
    "AxisState",
    "UNDEFINED IDLE STARTUP_SEQUENCE FULL_CALIBRATION_SEQUENCE MOTOR_CALIBRATION "
    "SENSORLESS_CONTROL ENCODER_INDEX_SEARCH ENCODER_OFFSET_CALIBRATION "
    "CLOSED_LOOP_CONTROL LOCKIN_SPIN ENCODER_DIR_FIND HOMING "
    "ENCODER_HALL_POLARITY_CALIBRATION ENCODER_HALL_PHASE_CALIBRATION "
    "ANTICOGGING_CALIBRATION",
    start=0,
)
"""State of an axis."""

TORQUE_CONTROL = 1
"""ControlMode of `Command.SET_CONTROLLER_MODE`."""

PASS_THROUGH = 1
"""InputMode of `Command.SET_CONTROLLER_MODE`: the torque acts unchanged."""

WATCHDOG_TIMER_EXPIRED = {"0.5": 0x800, "0.6": 0x1000000}
"""Error bit by firmware: no command came within `config.watchdog_timeout`."""

ESTOP_REQUESTED = {"0.5": 0x4000, "0.6": 0x2000000}
"""Error bit by firmware: emergency stop."""

ERRORS: dict[str, dict[int, str]] = {
    # tools/odrive/enums.py of 0.5.6, AXIS_ERROR_...
    "0.5": {
        0x1: "INVALID_STATE",
        0x40: "MOTOR_FAILED",
        0x80: "SENSORLESS_ESTIMATOR_FAILED",
        0x100: "ENCODER_FAILED",
        0x200: "CONTROLLER_FAILED",
        0x800: "WATCHDOG_TIMER_EXPIRED",
        0x1000: "MIN_ENDSTOP_PRESSED",
        0x2000: "MAX_ENDSTOP_PRESSED",
        0x4000: "ESTOP_REQUESTED",
        0x20000: "HOMING_WITHOUT_ENDSTOP",
        0x40000: "OVER_TEMP",
        0x80000: "UNKNOWN_POSITION",
    },
    # ODrive.Error of the message database odrive-cansimple 0.6.10.
    "0.6": {
        0x1: "INITIALIZING",
        0x2: "SYSTEM_LEVEL",
        0x4: "TIMING_ERROR",
        0x8: "MISSING_ESTIMATE",
        0x10: "BAD_CONFIG",
        0x20: "DRV_FAULT",
        0x40: "MISSING_INPUT",
        0x100: "DC_BUS_OVER_VOLTAGE",
        0x200: "DC_BUS_UNDER_VOLTAGE",
        0x400: "DC_BUS_OVER_CURRENT",
        0x800: "DC_BUS_OVER_REGEN_CURRENT",
        0x1000: "CURRENT_LIMIT_VIOLATION",
        0x2000: "MOTOR_OVER_TEMP",
        0x4000: "INVERTER_OVER_TEMP",
        0x8000: "VELOCITY_LIMIT_VIOLATION",
        0x10000: "POSITION_LIMIT_VIOLATION",
        0x1000000: "WATCHDOG_TIMER_EXPIRED",
        0x2000000: "ESTOP_REQUESTED",
        0x4000000: "SPINOUT_DETECTED",
        0x8000000: "BRAKE_RESISTOR_DISARMED",
        0x10000000: "THERMISTOR_DISCONNECTED",
        0x40000000: "CALIBRATION_ERROR",
    },
}
"""Names of the bits of a heartbeat's error, by firmware."""


class Frame(NamedTuple):
    """Frame of a CAN bus with a standard id.

    Attributes
    ----------
    id : int
        11 bits.
    data : bytes
        Up to 8.
    remote : bool
        True for a data request (RTR).
    """

    id: int
    data: bytes = b""
    remote: bool = False

    @property
    def node(self) -> int:
        """Node of the axis."""
        return self.id >> COMMAND_BITS

    @property
    def command(self) -> int:
        """Number of the command."""
        return self.id & ((1 << COMMAND_BITS) - 1)


@dataclass(frozen=True)
class Message:
    """Base class of messages, the contents of frames to or from an axis.

    A subclass specifies its command, its data layout and the matching fields.

    Attributes
    ----------
    node : int
        Node id of the axis.
    """

    COMMAND: ClassVar[Command]
    LAYOUT: ClassVar = struct.Struct("")
    node: int

    def __init_subclass__(cls, command: Command, layout: str = "") -> None:
        """Set the command, and the layout of its data."""
        cls.COMMAND, cls.LAYOUT = command, struct.Struct(layout)

    def frame(self) -> Frame:
        """Return the message as a frame.

        Raises
        ------
        ValueError
            The node does not exist.
        """
        if not 0 <= self.node <= HIGHEST_NODE:
            raise ValueError(f"node = {self.node}: must be from 0 to {HIGHEST_NODE}")
        _, *values = vars(self).values()
        return Frame(self.node << COMMAND_BITS | self.COMMAND, self.LAYOUT.pack(*values))


@dataclass(frozen=True)
class Heartbeat(Message, command=Command.HEARTBEAT, layout="<IB3x"):
    """Error and state of an axis, sent ten times a second by default.

    The last 3 bytes differ between firmwares and are not read.
    """

    error: int
    state: int


@dataclass(frozen=True)
class Estimates(Message, command=Command.ENCODER_ESTIMATES, layout="<ff"):
    """Position and speed of a motor, turns and turns per second."""

    position: float
    velocity: float


@dataclass(frozen=True)
class EstimatesRequest(Message, command=Command.ENCODER_ESTIMATES):
    """Request for one estimate."""

    def frame(self) -> Frame:
        """Return the message as a frame without data."""
        return super().frame()._replace(remote=True)


@dataclass(frozen=True)
class EmergencyStop(Message, command=Command.ESTOP):
    """Order to stop with an error."""


@dataclass(frozen=True)
class ClearErrors(Message, command=Command.CLEAR_ERRORS, layout="<x"):
    """Order to clear errors. The zero byte prevents blinking in 0.6; 0.5 ignores this byte."""


@dataclass(frozen=True)
class SetState(Message, command=Command.SET_AXIS_STATE, layout="<I"):
    """Order to change the state of an axis."""

    state: int


@dataclass(frozen=True)
class SetMode(Message, command=Command.SET_CONTROLLER_MODE, layout="<II"):
    """Order to change the control mode of an axis."""

    control: int = TORQUE_CONTROL
    input: int = PASS_THROUGH


@dataclass(frozen=True)
class SetTorque(Message, command=Command.SET_INPUT_TORQUE, layout="<f"):
    """Order to exert a torque, N m."""

    torque: float

    def frame(self) -> Frame:
        """Return the message as a frame.

        Raises
        ------
        ValueError
            The torque is not finite, or beyond `LARGEST_TORQUE`.
        """
        if not abs(self.torque) <= LARGEST_TORQUE:
            raise ValueError(f"torque = {self.torque}: must be within {LARGEST_TORQUE:g}")
        return super().frame()


REPORTS: dict[int, type[Message]] = {kind.COMMAND: kind for kind in (Heartbeat, Estimates)}
"""Messages from an axis, by command."""

ORDERS: dict[int, type[Message]] = {
    kind.COMMAND: kind for kind in (EmergencyStop, ClearErrors, SetState, SetMode, SetTorque)
}
"""Messages to an axis, by command."""


def parse_report(frame: Frame) -> Message | None:
    """Return the message of a frame from an axis; None for other or invalid frames."""
    return _parse(frame, REPORTS)


def parse_order(frame: Frame) -> Message | None:
    """Return the message of a frame to an axis; None for other or invalid frames."""
    if frame.command == Command.ENCODER_ESTIMATES and (frame.remote or not frame.data):
        return EstimatesRequest(frame.node)
    return _parse(frame, ORDERS)


def _parse(frame: Frame, kinds: Mapping[int, type[Message]]) -> Message | None:
    kind = kinds.get(frame.command)
    if kind is None or frame.remote or len(frame.data) < kind.LAYOUT.size:
        return None
    values = kind.LAYOUT.unpack_from(frame.data)
    return kind(frame.node, *values) if all(map(math.isfinite, values)) else None


def error_names(error: int, firmware: str) -> str:
    """Return the names of a heartbeat's error bits; empty if there are none.

    Parameters
    ----------
    error : int
        32 bits.
    firmware : str
        A key of `ERRORS`.
    """
    known = ERRORS[firmware]
    bits = [1 << index for index in range(32) if error >> index & 1]
    return ", ".join(known.get(bit, f"unknown error 0x{bit:x}") for bit in bits)


def state_name(state: int) -> str:
    """Return the name of an axis' state."""
    try:
        return AxisState(state).name
    except ValueError:
        return f"unknown state {state}"


FRAME_BITS = 47
"""Bits of a frame with a standard id and no data: start, id, control, CRC, acknowledgement, end,
and the three bits between frames (ISO 11898-1)."""

STUFFED_BITS = 34
"""Bits from start to CRC, where a bit is stuffed after five equal bits."""

FULL_LOAD = 0.8
"""Largest load that leaves a margin for repeated and waiting frames (assumed rule of thumb)."""

HEARTBEAT_RATE = 10.0
"""Default rate of ODrive's heartbeats, Hz."""

ESTIMATES_BYTES, TORQUE_BYTES, HEARTBEAT_BYTES = 8, 4, 8


def frame_bits(data_bytes: int) -> int:
    """Return the maximum number of bits in a standard-id frame, including stuff bits.

    In the worst case the first stuff bit follows five bits, and each further one follows four, as
    stuff bits also count (Davis et al., Real-Time Systems 35, 2007).

    Parameters
    ----------
    data_bytes : int
        0 to 8; 0 in a request for data.
    """
    stuffed = (STUFFED_BITS + 8 * data_bytes - 1) // 4
    return FRAME_BITS + 8 * data_bytes + stuffed


HEARTBEATS = HEARTBEAT_RATE * frame_bits(HEARTBEAT_BYTES)
"""Bits per second of a joint's heartbeats."""


@dataclass(frozen=True)
class BusLoad:
    """Largest load of a bus by an arm's frames.

    Attributes
    ----------
    joints : int
    rate : float
        Rate of estimates and of torques, Hz.
    bitrate : float
        Bit rate of the bus, bit/s.
    requested : bool
        True if every estimate is requested.
    """

    joints: int
    rate: float
    bitrate: float
    requested: bool = False

    @property
    def cycle(self) -> int:
        """Bits of a joint's frames per sample, without its heartbeats."""
        request = frame_bits(0) if self.requested else 0
        return request + frame_bits(ESTIMATES_BYTES) + frame_bits(TORQUE_BYTES)

    @property
    def share(self) -> float:
        """Load as a fraction of the bus' capacity; above 1 it is impossible."""
        return self.joints * (self.rate * self.cycle + HEARTBEATS) / self.bitrate

    @property
    def fits(self) -> bool:
        """True if the load is at most `FULL_LOAD`."""
        return self.share <= FULL_LOAD

    @property
    def highest_rate(self) -> float:
        """Highest rate that fits, Hz."""
        return (FULL_LOAD * self.bitrate / self.joints - HEARTBEATS) / self.cycle

    def __str__(self) -> str:
        """Return the load in one line."""
        how = "requested" if self.requested else "streamed"
        joints = "1 joint" if self.joints == 1 else f"{self.joints} joints"
        line = (
            f"bus load up to {100 * self.share:.0f} % of {self.bitrate / 1e6:g} Mbit/s"
            f" ({joints} at {self.rate:g} Hz, estimates {how})"
        )
        if not self.fits:
            line += f": too much, up to {self.highest_rate:.0f} Hz would fit"
        return line

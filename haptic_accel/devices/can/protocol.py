"""ODrive's CANSimple as bytes: build and read frames, without a bus.

Frames have standard ids: the axis' node in the upper 6 of 11 bits, the command in the lower 5.
All numbers are little-endian. The layout is that of ODrive's public firmware 0.5.6
(Firmware/communication/can/can_simple.cpp and docs/can-protocol.rst of odriverobotics/ODrive);
the part used here is the same in 0.6, except for the meaning of the error bits.
"""

from __future__ import annotations

import math
import struct
from enum import IntEnum
from typing import NamedTuple, TypeAlias

COMMAND_BITS = 5
"""Bits of an id that hold the command."""

HIGHEST_NODE = 0x3F
"""Highest node id: the upper 6 bits of a standard id."""

HIGHEST_ID = 0x7FF
"""Highest standard id, of 11 bits."""

LARGEST_TORQUE = 1e4
"""Largest torque accepted, N m: no motor has as much."""


class Command(IntEnum):
    """Command of a frame."""

    HEARTBEAT = 0x01
    ESTOP = 0x02
    SET_AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    SET_CONTROLLER_MODE = 0x0B
    SET_INPUT_TORQUE = 0x0E
    CLEAR_ERRORS = 0x18


class AxisState(IntEnum):
    """State of an axis."""

    UNDEFINED = 0
    IDLE = 1
    STARTUP_SEQUENCE = 2
    FULL_CALIBRATION_SEQUENCE = 3
    MOTOR_CALIBRATION = 4
    SENSORLESS_CONTROL = 5
    ENCODER_INDEX_SEARCH = 6
    ENCODER_OFFSET_CALIBRATION = 7
    CLOSED_LOOP_CONTROL = 8
    LOCKIN_SPIN = 9
    ENCODER_DIR_FIND = 10
    HOMING = 11
    ENCODER_HALL_POLARITY_CALIBRATION = 12
    ENCODER_HALL_PHASE_CALIBRATION = 13
    ANTICOGGING_CALIBRATION = 14


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

_HEARTBEAT = struct.Struct("<IB")
_STATE = struct.Struct("<I")
_ESTIMATES = struct.Struct("<ff")
_MODE = struct.Struct("<II")
_TORQUE = struct.Struct("<f")

_NO_IDENTIFICATION = b"\0"
"""Data of `Command.CLEAR_ERRORS` for 0.6, whose axis blinks otherwise; 0.5 ignores it."""


class Frame(NamedTuple):
    """Frame of a CAN bus with a standard id.

    Attributes
    ----------
    id : int
        11 bits.
    data : bytes
        Up to 8.
    remote : bool
        True for a request for the data of its id (RTR).
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


class Heartbeat(NamedTuple):
    """Error and state of an axis, sent ten times a second by default."""

    node: int
    error: int
    state: int


class Estimates(NamedTuple):
    """Position and speed of a motor, turns and turns per second."""

    node: int
    position: float
    velocity: float


Report: TypeAlias = "Heartbeat | Estimates"
"""Content of a frame from an axis."""


class SetState(NamedTuple):
    """Order to change the state of an axis."""

    node: int
    state: int


class SetMode(NamedTuple):
    """Order to change the control mode of an axis."""

    node: int
    control: int
    input: int


class SetTorque(NamedTuple):
    """Order to exert a torque, N m."""

    node: int
    torque: float


class SimpleOrder(NamedTuple):
    """Order without a value: emergency stop, clear errors, request for estimates."""

    node: int
    command: Command


Order: TypeAlias = "SetState | SetMode | SetTorque | SimpleOrder"
"""Content of a frame to an axis."""


def frame_id(node: int, command: Command) -> int:
    """Return the 11-bit id of a command to or from an axis.

    Raises
    ------
    ValueError
        The node does not exist.
    """
    if not 0 <= node <= HIGHEST_NODE:
        raise ValueError(f"node = {node}: must be from 0 to {HIGHEST_NODE}")
    return node << COMMAND_BITS | command


def make_heartbeat(node: int, error: int, state: int) -> Frame:
    """Build a heartbeat."""
    # The last 3 bytes differ between firmwares and are not read.
    return Frame(frame_id(node, Command.HEARTBEAT), _HEARTBEAT.pack(error, state) + bytes(3))


def make_estimates(node: int, position: float, velocity: float) -> Frame:
    """Build estimates, turns and turns per second."""
    data = _ESTIMATES.pack(position, velocity)
    return Frame(frame_id(node, Command.ENCODER_ESTIMATES), data)


def make_estimates_request(node: int) -> Frame:
    """Build a request for estimates, once."""
    return Frame(frame_id(node, Command.ENCODER_ESTIMATES), remote=True)


def make_estop(node: int) -> Frame:
    """Build an emergency stop, which leaves the axis with an error."""
    return Frame(frame_id(node, Command.ESTOP))


def make_clear_errors(node: int) -> Frame:
    """Build a command to clear errors."""
    return Frame(frame_id(node, Command.CLEAR_ERRORS), _NO_IDENTIFICATION)


def make_set_state(node: int, state: AxisState) -> Frame:
    """Build a command to change the state."""
    return Frame(frame_id(node, Command.SET_AXIS_STATE), _STATE.pack(state))


def make_torque_mode(node: int) -> Frame:
    """Build a command to control torque."""
    data = _MODE.pack(TORQUE_CONTROL, PASS_THROUGH)
    return Frame(frame_id(node, Command.SET_CONTROLLER_MODE), data)


def make_input_torque(node: int, torque: float) -> Frame:
    """Build a set-point of the torque, N m.

    Raises
    ------
    ValueError
        The torque is not finite, or beyond `LARGEST_TORQUE`.
    """
    if not abs(torque) <= LARGEST_TORQUE:
        raise ValueError(f"torque = {torque}: must be from {-LARGEST_TORQUE:g} to the same")
    return Frame(frame_id(node, Command.SET_INPUT_TORQUE), _TORQUE.pack(torque))


def parse_report(frame: Frame) -> Report | None:
    """Read a frame from an axis; None if it is of another kind or invalid."""
    if frame.remote:
        return None
    data, node = frame.data, frame.node
    if frame.command == Command.ENCODER_ESTIMATES and len(data) >= _ESTIMATES.size:
        position, velocity = _ESTIMATES.unpack_from(data)
        finite = math.isfinite(position) and math.isfinite(velocity)
        return Estimates(node, position, velocity) if finite else None
    if frame.command == Command.HEARTBEAT and len(data) >= _HEARTBEAT.size:
        return Heartbeat(node, *_HEARTBEAT.unpack_from(data))
    return None


def parse_order(frame: Frame) -> Order | None:
    """Read a frame to an axis; None if it is of another kind or invalid."""
    data, node, command = frame.data, frame.node, frame.command
    if command == Command.ENCODER_ESTIMATES and (frame.remote or not data):
        return SimpleOrder(node, Command.ENCODER_ESTIMATES)
    if frame.remote:
        return None
    if command == Command.SET_INPUT_TORQUE and len(data) >= _TORQUE.size:
        (torque,) = _TORQUE.unpack_from(data)
        return SetTorque(node, torque) if math.isfinite(torque) else None
    if command == Command.SET_AXIS_STATE and len(data) >= _STATE.size:
        return SetState(node, *_STATE.unpack_from(data))
    if command == Command.SET_CONTROLLER_MODE and len(data) >= _MODE.size:
        return SetMode(node, *_MODE.unpack_from(data))
    if command in (Command.ESTOP, Command.CLEAR_ERRORS):
        return SimpleOrder(node, Command(command))
    return None


def error_names(error: int, firmware: str) -> str:
    """Return the names of a heartbeat's error bits; empty for none.

    Parameters
    ----------
    error : int
        32 bits.
    firmware : str
        A key of `ERRORS`.
    """
    known = ERRORS[firmware]
    bits = [1 << place for place in range(32) if error >> place & 1]
    return ", ".join(known.get(bit, f"unknown error 0x{bit:x}") for bit in bits)


def state_name(state: int) -> str:
    """Return the name of an axis' state."""
    try:
        return AxisState(state).name
    except ValueError:
        return f"unknown state {state}"

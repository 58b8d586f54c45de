# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated arms on a python-can bus, or behind slcan adapters on pseudo-terminals.

An arm has axes, ODrives with the CANSimple protocol, and a simulated device. It has no bus and no
clock: the caller passes frames with their times, s.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from haptic_accel import FloatArray
from haptic_accel.core import vector
from haptic_accel.devices import SimulatedDevice
from haptic_accel.devices.can import (
    STREAMED,
    CanParameters,
    frame_of,
    kinematics_of,
    message_of,
    protocol,
)
from haptic_accel.devices.can.protocol import HEARTBEAT_RATE, HIGHEST_ID, AxisState, Command, Frame
from haptic_accel.kits.emulators import ports

if TYPE_CHECKING:
    import can

MUTED = {ports.HEARTBEAT: Command.HEARTBEAT, ports.ESTIMATES: Command.ENCODER_ESTIMATES}
"""Command that an axis omits, by fault."""


class SlcanPort:
    """Serial adapter with slcan, as a pseudo-terminal.

    Parameters
    ----------
    path : Path
        Symbolic link to make to the terminal.
    """

    def __init__(self, path: Path) -> None:
        self._terminal = ports.PseudoTerminal(path)
        self._adapter = SlcanAdapter()

    def receive(self) -> list[Frame]:
        """Return the frames that the host has sent; never waits."""
        frames, answer = self._adapter.receive(self._terminal.read() or b"")
        if answer:
            self._terminal.write(answer)
        return frames

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames, if the host has opened the bus."""
        lines = b"".join(map(frame_line, frames))
        if lines and self._adapter.opened:
            self._terminal.write(lines)

    def send_garbage(self, noise: random.Random) -> None:
        """Send random bytes."""
        self._terminal.write(noise.randbytes(noise.randrange(1, 30)) + b"\r")

    def plug(self) -> None:
        """Create the port, with the bus closed."""
        if not self._terminal.plugged:
            self._adapter = SlcanAdapter()
            self._terminal.plug()

    def unplug(self) -> None:
        """Remove the port."""
        self._terminal.unplug()


class BusPort:
    """Bus of python-can.

    Parameters
    ----------
    open_bus : callable
        Function that opens the bus.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = open_bus()

    def receive(self) -> list[Frame]:
        """Return the available frames; never waits."""
        messages = iter(lambda: self._bus.recv(0.0) if self._bus else None, None)
        return [frame for frame in map(frame_of, messages) if frame]

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames; those that cannot be sent are lost."""
        import can

        if self._bus is None:
            return
        for frame in frames:
            with suppress(can.CanError):
                self._bus.send(message_of(frame))

    def send_garbage(self, noise: random.Random) -> None:
        """Send a random frame."""
        self.send([Frame(noise.randrange(HIGHEST_ID + 1), noise.randbytes(noise.randrange(9)))])

    def plug(self) -> None:
        """Join the bus."""
        self._bus = self._bus or self._open_bus()

    def unplug(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None


CanPort: TypeAlias = SlcanPort | BusPort
"""Access of emulated arms to a bus."""


class CanLine:
    """Arms at a port, with faults of the port and of one arm; times are s since the start.

    Parameters
    ----------
    port : CanPort
    arms : sequence of EmulatedArm
        Arms; axis faults affect the first axis of the first arm.
    rate : float
        Steps per second.
    faults : Faults
        Faults; their times count from the first torque.

    Attributes
    ----------
    due : float
        Time of the next step.
    """

    terminals = ()

    def __init__(
        self, port: CanPort, arms: Sequence[EmulatedArm], rate: float, faults: ports.Faults
    ) -> None:
        self._port = port
        self._arms = arms
        self._period = 1 / rate
        self._faults = faults
        self.due = 0.0

    @property
    def driven(self) -> bool:
        """True once any arm has received a torque."""
        return self._faults.begun

    def step(self, now: float) -> None:
        """Exchange frames between port and arms."""
        if now < self.due:
            return
        self.due = max(self.due + self._period, now)
        self._inject(now)
        for frame in self._passed(self._port.receive()):
            for arm in self._arms:
                self._port.send(self._passed(arm.receive(frame, now)))
        for arm in self._arms:
            self._port.send(self._passed(arm.due(now)))
        if any(arm.driven for arm in self._arms):
            self._faults.begin()

    def close(self) -> None:
        """Leave the bus."""
        self._port.unplug()

    def _inject(self, now: float) -> None:
        """Inject the faults that do not affect passing frames."""
        faults, faulty = self._faults, self._arms[0]
        if ports.AXIS_ERROR in faults.advance(now):
            faulty.fail()
        mute = faulty.axes[0].mute
        for name, command in MUTED.items():
            (mute.add if faults.active(name) else mute.discard)(command)
        if faults.active(ports.UNPLUG):
            self._port.unplug()
        else:
            self._port.plug()
        if faults.strikes(ports.GARBAGE):
            self._port.send_garbage(faults.random)

    def _passed(self, frames: list[Frame]) -> list[Frame]:
        if self._faults.active(ports.BUS_OFF):
            return []
        return [frame for frame in frames if not self._faults.strikes(ports.DROP)]


END, OK, ERROR = b"\r", b"\r", b"\a"

# slcan: a CAN bus as text lines on a serial port, with the commands of the Lawicel CAN232 manual,
# which slcan adapters support. The other end is python-can's interface `slcan` or Linux' slcand.

LONGEST_LINE = 26
"""Maximum length of a line: T, an extended id of 8, a length and 8 bytes of data."""

ANSWERS = {b"V": b"V1013" + END, b"N": b"NHAPT" + END, b"F": b"F00" + END}
"""Answers to queries, by first letter."""

ACCEPTED = b"OLCSsZMmWXTR"
"""First letters of other commands; frames with extended ids are accepted and ignored."""

FRAME = re.compile(rb"([tr])([0-7][0-9a-fA-F]{2})([0-8])((?:[0-9a-fA-F]{2})*)")
"""Line of a frame: data or request, id, length and data."""


def frame_line(frame: Frame) -> bytes:
    """Return a frame in an adapter's format, with its end."""
    if frame.remote:
        return b"r%03X0\r" % frame.id
    return b"t%03X%d%b\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode())


def parse_frame_line(line: bytes) -> Frame | None:
    """Parse a line, without its end, as a standard-id frame; None if it is no frame."""
    match = FRAME.fullmatch(line)
    if not match:
        return None
    kind, identifier, length, data = match.groups()
    remote = kind == b"r"
    if len(data) != (0 if remote else 2 * int(length)):
        return None
    return Frame(int(identifier, 16), bytes.fromhex(data.decode()), remote)


class SlcanAdapter:
    """Adapter that executes the commands of a host.

    Attributes
    ----------
    opened : bool
        True while the host receives frames.
    """

    def __init__(self) -> None:
        self.opened = False
        self._rest = b""

    def receive(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Process bytes from the host.

        Returns
        -------
        frames : list of Frame
            Frames for the bus.
        answer : bytes
            Answer to the host.
        """
        *lines, rest = (self._rest + data).split(END)
        # Discard a long line without an end.
        self._rest = rest if len(rest) <= LONGEST_LINE else b""
        frames, answers = [], []
        for line in lines:
            frame = parse_frame_line(line)
            if frame is not None and self.opened:
                frames.append(frame)
                answers.append(OK)
                continue
            if line[:1] in (b"O", b"L", b"C"):
                self.opened = line[:1] != b"C"
            accepted = OK if line[:1] in ACCEPTED else ERROR
            answers.append(ANSWERS.get(line[:1], accepted))
        return frames, b"".join(answers)


HEARTBEAT_PERIOD = 1 / HEARTBEAT_RATE
"""Period of the heartbeats, s."""

ESTIMATE_NOISE = 1e-5
"""Standard deviation of an estimate, turns (assumed: a tenth of a count of 8192)."""

MOTOR_ERROR = {"0.5": 0x40, "0.6": 0x20}
"""Injected error bit by firmware: MOTOR_FAILED, DRV_FAULT."""

HAND_SPEED = 0.5
"""Speed at which a hand moves a released arm back, m/s: slow enough for every joint."""

DAMPING = 1e-3
"""Damping of the inverse of a Jacobian, m/rad: near a singularity the arm does not follow."""


class EmulatedAxis:
    """ODrive axis with the commands for an arm.

    Parameters
    ----------
    node : int
    estimates_period : float
        Period of streamed estimates, s; 0 for none.
    watchdog : float
        Timeout of the watchdog, s; 0 for none, ODrive's default. May be changed.
    firmware : str

    Attributes
    ----------
    turns, speed : float
        Position and speed of the motor, turns and turns per second.
    mute : set of Command
        Commands that the axis does not send.
    """

    def __init__(self, node: int, estimates_period: float, watchdog: float, firmware: str) -> None:
        self.node = node
        self.turns = self.speed = 0.0
        self.mute: set[protocol.Command] = set()
        self._error = 0
        self._firmware = firmware
        self._state = AxisState.IDLE
        self._torque_mode = False
        self._torque = 0.0
        self.watchdog = watchdog
        self._fed = -math.inf
        self._periods = {self._heartbeat: HEARTBEAT_PERIOD, self._estimates: estimates_period}
        self._next = dict.fromkeys(self._periods, -math.inf)

    @property
    def armed(self) -> bool:
        """True while the axis is in closed loop."""
        return self._state is AxisState.CLOSED_LOOP_CONTROL

    @property
    def torque(self) -> float:
        """Torque of the motor, N m."""
        return self._torque if self.armed and self._torque_mode else 0.0

    def fail(self, error: int) -> None:
        """Stop with an error."""
        self._error |= error
        self._state = AxisState.IDLE

    def execute(self, order: protocol.Message, now: float) -> list[Frame]:
        """Execute an order and return the answer to it."""
        self._fed = now  # any command resets the watchdog (can_simple.cpp, do_command)
        match order:
            case protocol.SetTorque():
                self._torque = order.torque
            case protocol.SetMode():
                mode = protocol.TORQUE_CONTROL, protocol.PASS_THROUGH
                self._torque_mode = (order.control, order.input) == mode
            case protocol.SetState(state=AxisState.IDLE):
                self._state = AxisState.IDLE
            case protocol.SetState(state=AxisState.CLOSED_LOOP_CONTROL) if not self._error:
                self._state = AxisState.CLOSED_LOOP_CONTROL
            case protocol.ClearErrors():
                self._error = 0
            case protocol.EmergencyStop():
                self.fail(protocol.ESTOP_REQUESTED[self._firmware])
            case protocol.EstimatesRequest():
                return self._unmuted([self._estimates()])
        return []

    def due(self, now: float) -> list[Frame]:
        """Return the periodic frames due at a time."""
        if self.watchdog and self.armed and now - self._fed > self.watchdog:
            self.fail(protocol.WATCHDOG_TIMER_EXPIRED[self._firmware])
        frames = []
        for report, period in self._periods.items():
            if period and now >= self._next[report]:
                frames.append(report())
                # Missed frames are not sent later.
                due = self._next[report] + period
                self._next[report] = due if due > now else now + period
        return self._unmuted(frames)

    def _heartbeat(self) -> Frame:
        return protocol.Heartbeat(self.node, self._error, self._state).frame()

    def _estimates(self) -> Frame:
        return protocol.Estimates(self.node, self.turns, self.speed).frame()

    def _unmuted(self, frames: Iterable[Frame]) -> list[Frame]:
        return [frame for frame in frames if frame.command not in self.mute]


class EmulatedArm:
    """Axes that move the arm of a simulated device.

    The origin of the device's arm is the middle of the emulated arm's workspace. Motion and force
    of the tip are limited to the directions of the joints.

    Parameters
    ----------
    parameters : CanParameters
        Parameters of the driver.
    device : SimulatedDevice
    rate : float
        Rate of streamed estimates, Hz.
    watchdog : float
        Timeout of the axes' watchdogs, s.
    seed : int
        Seed of the estimates' noise.

    Attributes
    ----------
    axes : list of EmulatedAxis
    """

    def __init__(
        self,
        parameters: CanParameters,
        device: SimulatedDevice,
        *,
        rate: float,
        watchdog: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._firmware = parameters.firmware
        self._joints = list(parameters.joints.values())
        self._kinematics = kinematics_of(parameters)
        self._home = self._kinematics.position(self._kinematics.home)
        self._inverse = _damped_inverse(self._kinematics.jacobian(self._kinematics.home))
        period = 1 / rate if parameters.estimates == STREAMED else 0.0
        self.axes = [
            EmulatedAxis(joint.node_id, period, watchdog, parameters.firmware)
            for joint in self._joints
        ]
        self._random = random.Random(seed)
        self._device = device
        self._torques = [0.0] * len(self.axes)
        self._tip = np.array(self._home, dtype=float)
        self._moved = 0.0

    @property
    def driven(self) -> bool:
        """True while a motor has a torque."""
        return any(self._torques)

    def fail(self) -> None:
        """Stop the first axis with an error."""
        self.axes[0].fail(MOTOR_ERROR[self._firmware])

    def receive(self, frame: Frame, now: float) -> list[Frame]:
        """Process a frame and return the answers to it."""
        order = protocol.parse_order(frame)
        axis = next((axis for axis in self.axes if axis.node == frame.node), None)
        return axis.execute(order, now) if order and axis else []

    def due(self, now: float) -> list[Frame]:
        """Move the arm until a time; return the frames that its axes send then."""
        self._drive(now)
        self._move(now)
        return [frame for axis in self.axes for frame in axis.due(now)]

    def _drive(self, now: float) -> None:
        """Apply the motors' torques to the simulated arm whenever a torque changes."""
        torques = [axis.torque for axis in self.axes]
        if torques != self._torques:
            self._torques = torques
            pairs = zip(self._joints, torques, strict=True)
            of_joints = [joint.joint_torque(torque) for joint, torque in pairs]
            self._device.write(now, arm_force=vector(self._inverse.T @ of_joints))

    def _move(self, now: float) -> None:
        """Set the motors' position and speed from the simulated arm.

        The simulated arm jumps back to its start; the motors turn there gradually.
        """
        sample = self._device.read(now)
        velocity, passed = np.array(sample.velocity), now - self._moved
        way = np.add(self._home, sample.position) - self._tip
        possible = (np.linalg.norm(velocity) + HAND_SPEED) * passed
        if np.linalg.norm(way) > possible > 0.0:
            way *= possible / np.linalg.norm(way)
            velocity = way / passed
        self._tip, self._moved = self._tip + way, now
        x, y, z = self._tip.tolist()
        angles = self._kinematics.angles((x, y, z))
        self._inverse = _damped_inverse(self._kinematics.jacobian(angles))
        speeds = (self._inverse @ velocity).tolist()
        for axis, joint, angle, speed in zip(self.axes, self._joints, angles, speeds, strict=True):
            axis.turns = joint.turns(angle) + self._random.gauss(0.0, ESTIMATE_NOISE)
            axis.speed = speed / joint.angle_per_turn


def _damped_inverse(jacobian: FloatArray) -> FloatArray:
    """Return the inverse by damped least squares, also near singularities (Wampler 1986)."""
    square = jacobian @ jacobian.T + DAMPING**2 * np.eye(3)
    return np.asarray(jacobian.T @ np.linalg.inv(square))

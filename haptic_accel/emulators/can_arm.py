"""Emulated ODrives: axes that speak CANSimple, and the arm of a simulated device behind them.

No bus and no clock: frames go in and out with their times, s.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable

import numpy as np

from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.devices.can.load import HEARTBEAT_RATE
from haptic_accel.devices.can.parameters import STREAMED, CanParameters
from haptic_accel.devices.can.protocol import (
    ESTOP_REQUESTED,
    PASS_THROUGH,
    TORQUE_CONTROL,
    WATCHDOG_TIMER_EXPIRED,
    AxisState,
    ClearErrors,
    Command,
    EmergencyStop,
    Estimates,
    EstimatesRequest,
    Frame,
    Heartbeat,
    Message,
    SetMode,
    SetState,
    SetTorque,
    parse_order,
)
from haptic_accel.devices.interface import Device

HEARTBEAT_PERIOD = 1 / HEARTBEAT_RATE
"""Period of the heartbeats, s."""

ESTIMATE_NOISE = 1e-5
"""Standard deviation of an estimate, turns (assumed: a tenth of a count of 8192)."""

PUT_BACK_AFTER = 1.0
"""Time without a torque after which the arm is put back to its origin, s."""

MOTOR_ERROR = {"0.5": 0x40, "0.6": 0x20}
"""Injected error bit by firmware: MOTOR_FAILED, DRV_FAULT."""

DAMPING = 1e-3
"""Damping of the inverse of a Jacobian, m/rad: near a singularity the arm does not follow."""


class EmulatedAxis:
    """ODrive axis, as far as an arm needs it.

    Parameters
    ----------
    node : int
    estimates_period : float
        Period of streamed estimates, s; 0 for none.
    watchdog : float
        Time-out of the watchdog, s; 0 for none, ODrive's default.
    firmware : str

    Attributes
    ----------
    turns, speed : float
        Position and speed of the motor, turns and turns per second.
    mute : set of Command
        Commands that it does not send.
    """

    def __init__(self, node: int, estimates_period: float, watchdog: float, firmware: str) -> None:
        self.node = node
        self.turns = self.speed = 0.0
        self.mute: set[Command] = set()
        self._error = 0
        self._firmware = firmware
        self._state = AxisState.IDLE
        self._torque_mode = False
        self._torque = 0.0
        self._watchdog = watchdog
        self._fed = -math.inf
        self._estimates_period = estimates_period
        self._next_heartbeat = self._next_estimates = -math.inf

    @property
    def armed(self) -> bool:
        """True while it is in closed loop."""
        return self._state is AxisState.CLOSED_LOOP_CONTROL

    @property
    def torque(self) -> float:
        """Torque of the motor, N m."""
        return self._torque if self.armed and self._torque_mode else 0.0

    def fail(self, error: int) -> None:
        """Stop with an error."""
        self._error |= error
        self._state = AxisState.IDLE

    def execute(self, order: Message, now: float) -> list[Frame]:
        """Execute an order and return the answer to it."""
        self._fed = now  # by any command (can_simple.cpp, do_command)
        if isinstance(order, SetTorque):
            self._torque = order.torque
        elif isinstance(order, SetMode):
            self._torque_mode = (order.control, order.input) == (TORQUE_CONTROL, PASS_THROUGH)
        elif isinstance(order, SetState):
            self._enter(order.state)
        elif isinstance(order, ClearErrors):
            self._error = 0
        elif isinstance(order, EmergencyStop):
            self.fail(ESTOP_REQUESTED[self._firmware])
        elif isinstance(order, EstimatesRequest):
            return self._unmuted([self._estimates()])
        return []

    def due(self, now: float) -> list[Frame]:
        """Return the periodic frames due at a time."""
        if self._watchdog and self.armed and now - self._fed > self._watchdog:
            self.fail(WATCHDOG_TIMER_EXPIRED[self._firmware])
        frames = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = _next_due(self._next_heartbeat, HEARTBEAT_PERIOD, now)
            frames.append(Heartbeat(self.node, self._error, self._state).frame())
        if self._estimates_period and now >= self._next_estimates:
            self._next_estimates = _next_due(self._next_estimates, self._estimates_period, now)
            frames.append(self._estimates())
        return self._unmuted(frames)

    def _enter(self, state: int) -> None:
        if state == AxisState.CLOSED_LOOP_CONTROL and not self._error:
            self._state = AxisState.CLOSED_LOOP_CONTROL
        elif state == AxisState.IDLE:
            self._state = AxisState.IDLE

    def _estimates(self) -> Frame:
        return Estimates(self.node, self.turns, self.speed).frame()

    def _unmuted(self, frames: Iterable[Frame]) -> list[Frame]:
        return [frame for frame in frames if frame.command not in self.mute]


class EmulatedArm:
    """Axes that move the arm of a simulated device.

    The origin of the device's arm is the middle of the emulated one's workspace. Motion and force
    of the tip are limited to the directions of the joints.

    Parameters
    ----------
    parameters : CanParameters
        Parameters of the driver.
    new_device : callable
        Makes the simulated device.
    rate : float
        Rate of streamed estimates, Hz.
    watchdog : float
        Time-out of the axes' watchdogs, s.
    seed : int
        Seed of the estimates' noise.
    """

    def __init__(
        self,
        parameters: CanParameters,
        new_device: Callable[[], Device],
        *,
        rate: float,
        watchdog: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._p = parameters
        self._joints = list(parameters.joints.values())
        self._kinematics = parameters.arm()
        self._home = self._kinematics.position(self._kinematics.home)
        period = 1 / rate if parameters.estimates == STREAMED else 0.0
        self.axes = [
            EmulatedAxis(joint.node_id, period, watchdog, parameters.firmware)
            for joint in self._joints
        ]
        self._by_node = {axis.node: axis for axis in self.axes}
        self._random = random.Random(seed)
        self._new_device = new_device
        self._device = new_device()
        self._angles = self._kinematics.home
        self._torques = (0.0,) * len(self.axes)
        self._driven = False
        self._driven_at = -math.inf

    @property
    def driven(self) -> bool:
        """True if it had a torque since it was at its origin."""
        return self._driven

    def fail(self) -> None:
        """Stop the first axis with an error."""
        self.axes[0].fail(MOTOR_ERROR[self._p.firmware])

    def take(self, frame: Frame, now: float) -> list[Frame]:
        """Process a frame and return the answers to it."""
        order = parse_order(frame)
        axis = self._by_node.get(frame.node)
        return axis.execute(order, now) if order and axis else []

    def due(self, now: float) -> list[Frame]:
        """Move the arm until a time, and return the frames that its axes send then."""
        self._move(now)
        return [frame for axis in self.axes for frame in axis.due(now)]

    def _move(self, now: float) -> None:
        if self._driven and now - self._driven_at > PUT_BACK_AFTER:
            self._device, self._driven = self._new_device(), False
        self._drive(now)
        sample = self._device.read(now)
        assert sample, "simulated devices always have a sample"
        x, y, z = (a + b for a, b in zip(self._home, sample.position, strict=True))
        angles = self._kinematics.angles((x, y, z))
        jacobian = self._jacobian(angles)
        speeds = jacobian.T @ _damped_solve(jacobian, self._of_axes(sample.velocity))
        for axis, joint, angle, speed in zip(
            self.axes, self._joints, angles, speeds.tolist(), strict=True
        ):
            axis.turns = joint.turns(angle) + self._random.gauss(0.0, ESTIMATE_NOISE)
            axis.speed = speed / joint.angle_per_turn
        self._angles = angles

    def _drive(self, now: float) -> None:
        """Apply the torques of the motors to the simulated arm, from the first one on."""
        torques = tuple(axis.torque for axis in self.axes)
        if any(torques):
            self._driven, self._driven_at = True, now
        if torques == self._torques:
            return
        self._torques = torques
        joint = [j.joint_torque(torque) for j, torque in zip(self._joints, torques, strict=True)]
        force = [0.0, 0.0, 0.0]
        jacobian = self._jacobian(self._angles)
        made = _damped_solve(jacobian, jacobian @ np.array(joint))
        for place, part in zip(self._kinematics.axes, made.tolist(), strict=True):
            force[place] = part
        self._device.write(now, arm_force=(force[0], force[1], force[2]))

    def _jacobian(self, angles: tuple[float, ...]) -> FloatArray:
        """Return the square Jacobian, along the axes in which the tip can move."""
        columns = self._kinematics.jacobian(angles)
        return np.array([[column[axis] for column in columns] for axis in self._kinematics.axes])

    def _of_axes(self, vector: Vector) -> FloatArray:
        return np.array([vector[axis] for axis in self._kinematics.axes])


def _next_due(due: float, period: float, now: float) -> float:
    """Return the next time of a periodic frame; missed ones are not sent late."""
    return due + period if due + period > now else now + period


def _damped_solve(jacobian: FloatArray, vector: FloatArray) -> FloatArray:
    """Solve J J^T x = v, also near singularities (damped least squares, Wampler 1986)."""
    square = jacobian @ jacobian.T + DAMPING**2 * np.eye(len(jacobian))
    return np.asarray(np.linalg.solve(square, vector))

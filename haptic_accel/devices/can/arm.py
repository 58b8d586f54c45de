# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arm driven by ODrives: arming, torques and tip position, without bus or clock."""

from __future__ import annotations

import cmath
import logging
import math
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

import numpy as np

from haptic_accel.core.model import ZERO, FloatArray, Vector, vector
from haptic_accel.devices.can import protocol
from haptic_accel.devices.can.parameters import (
    REQUESTED,
    CanParameters,
    JointParameters,
    LinkParameters,
    StageParameters,
)
from haptic_accel.devices.can.protocol import AxisState, Frame, SetState, SetTorque
from haptic_accel.devices.interface import AUTO, Joints, Sample

SHORTEST = 1e-9
"""Minimum distance used as a divisor, m."""

Angles: TypeAlias = tuple[float, ...]
"""One value per joint: rad, rad/s or N m."""


class LinearStage:
    """Motor that moves the tip along an axis.

    Attributes
    ----------
    home : tuple of float
        Angles in the middle of the workspace, rad.
    """

    home: Angles = (0.0,)

    def __init__(self, parameters: StageParameters) -> None:
        self._axis = "xyz".index(parameters.axis)
        self._jacobian = np.zeros((3, 1))
        self._jacobian[self._axis] = parameters.travel / math.tau

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position, m, for an angle in rad."""
        return vector(self._jacobian @ angles)

    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the Jacobian, shape (3, 1), m/rad: the travel per angle."""
        return self._jacobian

    def angles(self, position: Vector) -> Angles:
        """Return the angle for a position along the axis, rad."""
        return (position[self._axis] / float(self._jacobian[self._axis, 0]),)


class ArticulatedArm:
    """Waist, shoulder and elbow.

    Attributes
    ----------
    home : tuple of float
        Angles in the middle of the workspace, far from singularities, rad.
    """

    # Upper link horizontal, forearm vertical: the links are at right angles.
    home: Angles = (0.0, 0.0, 0.0)

    def __init__(self, parameters: LinkParameters) -> None:
        self._upper, self._fore = parameters.upper, parameters.fore
        self._relative = parameters.elbow == "shoulder"

    def _pose(self, angles: Sequence[float]) -> tuple[float, complex, complex]:
        """Return the waist's angle, and both links as outwards + j upwards, m."""
        waist, shoulder, elbow = (0.0, *angles)[-3:]
        if self._relative:
            elbow += shoulder
        return waist, cmath.rect(self._upper, shoulder), -1j * cmath.rect(self._fore, elbow)

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position from the shoulder, m, for angles in rad."""
        waist, upper, fore = self._pose(angles)
        tip = upper + fore
        return tip.real * math.cos(waist), tip.real * math.sin(waist), tip.imag

    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the Jacobian, shape (3, joints), m/rad, at angles in rad.

        It is singular where the links are in line, or the tip is above or below the waist.
        """
        waist, upper, fore = self._pose(angles)
        tip = upper + fore
        cos_waist, sin_waist = math.cos(waist), math.sin(waist)
        columns = [(-tip.real * sin_waist, tip.real * cos_waist, 0.0)]
        for turned in (tip if self._relative else upper, fore):
            by_angle = 1j * turned
            columns.append((by_angle.real * cos_waist, by_angle.real * sin_waist, by_angle.imag))
        return np.array(columns[-len(self.home) :]).T

    def angles(self, position: Vector) -> Angles:
        """Return the angles, rad, that bring the tip to a position, m, or as near as possible.

        The elbow is above the line from shoulder to tip.
        """
        x, y, z = position
        out = math.hypot(x, y)
        distance = math.hypot(out, z)
        # Law of cosines; out of reach, the arm stretches towards the position.
        cosine = (self._upper**2 + distance**2 - self._fore**2) / (
            2 * self._upper * max(distance, SHORTEST)
        )
        shoulder = math.atan2(z, out) + math.acos(min(1.0, max(-1.0, cosine)))
        fore = complex(out, z) - cmath.rect(self._upper, shoulder)
        elbow = math.atan2(fore.real, -fore.imag) - self._relative * shoulder
        return (math.atan2(y, x), shoulder, elbow)[-len(self.home) :]


class PlanarArm(ArticulatedArm):
    """Shoulder and elbow of the articulated arm, in the plane of x and z."""

    home: Angles = ArticulatedArm.home[1:]

    def angles(self, position: Vector) -> Angles:
        """Return the angles with the elbow above the line from shoulder to tip, rad."""
        return super().angles((position[0], 0.0, position[2]))


Kinematics: TypeAlias = LinearStage | ArticulatedArm
"""Relation between the angles of the joints and the position of the tip."""


def kinematics_of(parameters: CanParameters) -> Kinematics:
    """Return the kinematics with the parameters of stage or links."""
    if parameters.kinematics == "stage":
        return LinearStage(parameters.stage)
    kind = PlanarArm if parameters.kinematics == "planar" else ArticulatedArm
    return kind(parameters.links)


REPEAT_PERIOD = 5e-3
"""Interval for repeating torques, s. The time-out of an axis' watchdog should be several
times this."""

ARMING_PERIOD = 0.25
"""Interval for repeating the commands to arm, s; heartbeats come every 0.1 s."""

LONGEST_SILENCE = 1.0
"""Longest time without commands until a drive must release its motor by itself, s. Emulated drives
on busy machines need that long; 0.02 s is recommended."""

NO_WATCHDOG = (
    "goes on without commands: set axis0.config.enable_watchdog = True and"
    " axis0.config.watchdog_timeout = 0.02, then save_configuration()"
)
"""Problem of a drive that would keep its last torque forever."""

JUMP = 0.02
"""Change of a motor's position beyond what its speed explains that counts as a jump, turns."""

LARGEST_ACCELERATION = 3000.0
"""Largest acceleration of a motor, turns/s^2: ten times that of a hand that shakes a light arm."""

FASTER_BETWEEN = 1.5
"""Maximum speed between two estimates, relative to the reported speeds."""

LONGEST_QUEUED = 20e-3
"""Longest period of estimates, s. Estimates from a queue arrive at the same time."""

UNDECIDED = 1.0
"""Time after a jump for which the source of estimates is uncertain, s."""

ON_REQUEST = "disarmed on request"
"""Reason for missing torques after `DrivenArm.disarm`."""

_LOG = logging.getLogger(__name__)


class State(Enum):
    """Permission of torques."""

    DISARMED = 0
    ARMING = 1
    ARMED = 2
    FALLING_SILENT = 3


@dataclass
class Axis:
    """Latest state of one joint and its drive; times in s, or minus infinity if there is none.

    Attributes
    ----------
    name : str
        Name of the joint, with the node, for messages.
    joint : JointParameters
    turns, speed : float
        Position and speed of the motor, turns and turns per second.
    estimated : float
        Time of the last estimates.
    error, state : int
        Error and state in the last heartbeat.
    reported : float
        Time of the last heartbeat.
    jumped : float
        Time of the last estimates that contradicted the previous ones.
    jump : str
        Description of that contradiction.
    """

    name: str
    joint: JointParameters
    turns: float = 0.0
    speed: float = 0.0
    estimated: float = -math.inf
    error: int = 0
    state: int = AxisState.UNDEFINED
    reported: float = -math.inf
    jumped: float = -math.inf
    jump: str = ""


class DrivenArm:
    """Axes that exert torques only while all axes work.

    Two threads call the methods: one reads the bus, the other moves the arm.

    Parameters
    ----------
    parameters : CanParameters
    send : callable
        Function that sends frames; returns False on failure.

    Attributes
    ----------
    nodes : list of int
        Node ids of the axes.
    state : State
    torques : tuple of float
        Torques of the motors, as last commanded, N m.
    longest_silence : float
        Longest time from the last command until a heartbeat reported that an axis had released its
        motor, s; heartbeats are a tenth of a second apart. NaN before a test.
    fault : str
        Reason for missing torques, kept until armed again; empty if none.
    """

    def __init__(self, parameters: CanParameters, send: Callable[[Sequence[Frame]], bool]) -> None:
        self._p = parameters
        self._send_frames = send
        self._kinematics = kinematics_of(parameters)
        joints = parameters.joints.items()
        self._axes = [Axis(f"{name} (node {joint.node_id})", joint) for name, joint in joints]
        self._by_node = {axis.joint.node_id: axis for axis in self._axes}
        self.nodes = list(self._by_node)
        self._lock = threading.RLock()
        self.state = State.DISARMED
        self.torques = self._zero = (0.0,) * len(self._axes)
        self._arming_since = self._arming_sent = self._torques_sent = -math.inf
        self._estimates_requested = -math.inf
        self._recovers = False
        self._tests = False
        self._silent_since = -math.inf
        self.longest_silence = math.nan
        self.fault = ""
        self._counts = Counter(foreign_frames=0, position_jumps=0, samples_missing=0)
        self._counts.update(limited_torques=0, withheld_forces=0, rejected_forces=0, disarmed=0)

    def counters(self) -> dict[str, int]:
        """Return counts by name."""
        return {"armed": int(self.state is State.ARMED), **self._counts}

    # Called by the thread that reads the bus

    def receive(self, frame: Frame, now: float) -> None:
        """Process a frame received at a time."""
        report = protocol.parse_report(frame)
        axis = self._by_node.get(frame.node)
        if report is None or axis is None:
            self._counts["foreign_frames"] += 1
        elif isinstance(report, protocol.Estimates):
            if jump := _jump(axis, report, now):
                self._counts["position_jumps"] += 1
                axis.jump, axis.jumped = jump, now
                self._disarm_for(jump)
            else:
                axis.turns, axis.speed, axis.estimated = report.position, report.velocity, now
        elif isinstance(report, protocol.Heartbeat):
            axis.error, axis.state, axis.reported = report.error, report.state, now
            self._react(axis)

    def update(self, now: float) -> None:
        """Disarm on a problem, continue arming, feed the drives' watchdogs."""
        with self._lock:
            if self.state is State.ARMED:
                for axis in self._axes:
                    if lost := self._overdue(axis, now):
                        self._disarm_for(lost, recovers=True)
            elif self.state is State.ARMING:
                self._continue_arming(now)
            elif self.state is State.FALLING_SILENT:
                self._continue_silence(now)
            elif self._may_rearm(now):
                self.arm(now)
            # Zero may be repeated forever. Only the commanding thread may repeat other torques, so
            # that the watchdogs stop the drives if that thread hangs. A request also feeds
            # watchdogs.
            if not any(self.torques):
                if self.state is not State.DISARMED:
                    self._send_torques(now, REPEAT_PERIOD)
                self._request_estimates(now, REPEAT_PERIOD)

    def lose(self) -> None:
        """Disarm because the bus is lost, and forget all reports."""
        self._disarm_for("the bus has gone", recovers=True)
        for axis in self._axes:
            axis.reported = axis.estimated = -math.inf

    def release(self) -> None:
        """Release all axes, which may still exert their last torques after a bus was lost."""
        with self._lock:
            self.state, self.torques = State.DISARMED, self._zero
            self._send(_idle(self.nodes))

    # Called by the thread that moves the arm

    def missing(self, now: float) -> str:
        """Return the names of axes without a heartbeat; empty if there are none."""
        return ", ".join(axis.name for axis in self._axes if self._silent(axis, now))

    def arm(self, now: float, *, test: bool = False) -> None:
        """Start arming: clear errors, then enter closed loop with zero torques.

        With `test`, sending then pauses until every drive's watchdog has released its motor, as
        required if this process hangs. Then the axes are armed again.
        """
        with self._lock:
            self._tests = test
            self.state, self._arming_since = State.ARMING, now
            self.torques, self._recovers = self._zero, False
            self._send_arming(now)

    def disarm(self) -> None:
        """Release all axes until armed again: zero torque, then idle."""
        with self._lock:
            self.release()
            self._recovers, self.fault = False, ON_REQUEST

    def apply(self, force: Vector, now: float) -> None:
        """Apply a force to the tip, N, while armed, within the motors' limits."""
        if not math.isfinite(sum(force)):
            self._counts["rejected_forces"] += 1
            force = ZERO
        angles = self._angles()
        torques = self._limited(self._kinematics.jacobian(angles).T @ force)
        with self._lock:
            if self.state is State.ARMED:
                self.torques = torques
                self._send_torques(now)
            elif any(torques):
                self._counts["withheld_forces"] += 1

    def read(self, now: float) -> Sample | None:
        """Return the tip's position and velocity, and repeat torques that are due.

        Without estimates there is no sample; such reads are counted. The acceleration is zero, as
        there is no accelerometer.
        """
        with self._lock:
            if self.state is State.ARMED:
                self._send_torques(now, REPEAT_PERIOD)
        self._request_estimates(now, 0.0)
        if any(self._stale(axis, now) for axis in self._axes):
            self._counts["samples_missing"] += 1
            return None
        angles = self._angles()
        velocity = vector(self._kinematics.jacobian(angles) @ self._speeds())
        return Sample(self._kinematics.position(angles), velocity, ZERO)

    def joints(self) -> Joints:
        """Return the last known angles, speeds and torques of the joints."""
        pairs = zip(self._axes, self.torques, strict=True)
        torques = [axis.joint.joint_torque(torque) for axis, torque in pairs]
        return Joints(list(self._p.joints), list(self._angles()), self._speeds(), torques)

    def _disarm_for(self, reason: str, *, recovers: bool = False) -> None:
        """Release all axes for a reason; `recovers` allows rearming without a request."""
        with self._lock:
            if self.state is State.DISARMED:
                return
            self.release()
            self._recovers, self.fault = recovers, reason
            self._counts["disarmed"] += 1
            _LOG.warning("can: %s: no torque: %s", self._p.channel, reason)

    def _angles(self) -> Angles:
        return tuple(axis.joint.angle(axis.turns) for axis in self._axes)

    def _speeds(self) -> list[float]:
        return [axis.joint.angle_per_turn * axis.speed for axis in self._axes]

    def _limited(self, joint_torques: FloatArray) -> Angles:
        """Return the motors' torques, scaled by one factor to keep the force's direction."""
        joints = [axis.joint for axis in self._axes]
        pairs = zip(joints, joint_torques.tolist(), strict=True)
        torques = [joint.motor_torque(torque) for joint, torque in pairs]
        pairs = zip(joints, torques, strict=True)
        scale = min([1.0, *(joint.torque_limit / abs(t) for joint, t in pairs if t)])
        self._counts["limited_torques"] += scale < 1.0
        # An infinite torque times a scale of zero would be NaN.
        return tuple(torque * scale for torque in torques) if scale else self._zero

    def _send(self, messages: Iterable[protocol.Message]) -> None:
        self._send_frames([message.frame() for message in messages])

    def _send_torques(self, now: float, period: float = 0.0) -> None:
        """Send torques if they are due and the state is not FALLING_SILENT."""
        if self.state is not State.FALLING_SILENT and now - self._torques_sent >= period:
            self._torques_sent = now
            torques = zip(self.nodes, self.torques, strict=True)
            self._send([SetTorque(node, torque) for node, torque in torques])

    def _request_estimates(self, now: float, period: float) -> None:
        """Request unstreamed estimates, unless silent or requested in the last period."""
        if self.state is State.FALLING_SILENT:
            return
        if self._p.estimates == REQUESTED and now - self._estimates_requested >= period:
            self._estimates_requested = now
            self._send([protocol.EstimatesRequest(node) for node in self.nodes])

    def _silent(self, axis: Axis, now: float) -> bool:
        return now - axis.reported > self._p.heartbeat_timeout

    def _stale(self, axis: Axis, now: float) -> bool:
        silent = now - axis.estimated > self._p.estimates_timeout
        return silent or now - axis.jumped < UNDECIDED

    def _react(self, axis: Axis) -> None:
        """Disarm if an axis reports a problem; stop axes that should be idle."""
        with self._lock:
            wrong = self._wrong(axis)
            if wrong and self.state is State.ARMED:
                self._disarm_for(wrong)
            elif axis.state == AxisState.CLOSED_LOOP_CONTROL and self.state is State.DISARMED:
                # The command was lost, or another program started the axis.
                self._send(_idle([axis.joint.node_id]))

    def _wrong(self, axis: Axis) -> str:
        """Return the problem that an axis reports; empty if none."""
        if axis.error:
            return f"{axis.name}: {protocol.error_names(axis.error, self._p.firmware)}"
        if axis.state != AxisState.CLOSED_LOOP_CONTROL:
            return f"{axis.name}: is not in closed loop but in {protocol.state_name(axis.state)}"
        return ""

    def _overdue(self, axis: Axis, now: float) -> str:
        """Return a text on an axis' overdue report; empty if none is overdue."""
        if self._silent(axis, now):
            return f"{axis.name}: no heartbeat for {self._p.heartbeat_timeout:g} s"
        if now - axis.jumped < UNDECIDED:
            return axis.jump
        if self._stale(axis, now):
            return f"{axis.name}: no estimates for {self._p.estimates_timeout:g} s"
        return ""

    def _send_arming(self, now: float) -> None:
        self._torques_sent = self._arming_sent = now
        for node in self.nodes:
            orders = protocol.SetMode(node), SetTorque(node, 0.0), protocol.ClearErrors(node)
            self._send([*orders, SetState(node, AxisState.CLOSED_LOOP_CONTROL)])

    def _continue_arming(self, now: float) -> None:
        missing = self._missing(now)
        if not missing and self._tests:
            self.state, self._silent_since = State.FALLING_SILENT, now
        elif not missing:
            self.state, self.fault = State.ARMED, ""
        elif now - self._arming_since > self._p.start_timeout:
            self._disarm_for(missing)
        elif now - self._arming_sent > ARMING_PERIOD:
            # An error that returns after clearing is persistent. An expired watchdog is not: it
            # shows a pause of this process.
            errors = [self._fault(a) for a in self._axes if a.reported > self._arming_since]
            if any(errors):
                self._disarm_for(missing)
            else:
                self._send_arming(now)

    def _continue_silence(self, now: float) -> None:
        """Arm again once each watchdog has released its motor."""
        for axis in self._axes:
            if self._fault(axis):
                self._disarm_for(self._wrong(axis))
                return
        held = [axis for axis in self._axes if axis.state == AxisState.CLOSED_LOOP_CONTROL]
        if not held:
            self.longest_silence = max(axis.reported for axis in self._axes) - self._silent_since
            self.arm(now)
        elif silent := [axis for axis in self._axes if self._silent(axis, now)]:
            self._disarm_for(self._overdue(silent[0], now))
        elif now - self._silent_since > LONGEST_SILENCE:
            self._disarm_for(f"{', '.join(axis.name for axis in held)}: {NO_WATCHDOG}")

    def _missing(self, now: float) -> str:
        """Return the missing conditions for torques; empty if none."""
        for axis in self._axes:
            # Earlier reports do not show the effect of the commands.
            wrong = f"{axis.name}: no heartbeat since it was armed"
            if axis.reported > self._arming_since:
                wrong = self._wrong(axis)
            if wrong := self._overdue(axis, now) or wrong:
                return wrong
        return ""

    def _fault(self, axis: Axis) -> int:
        """Return an axis' error bits except that of the watchdog, which expires on bus loss."""
        return axis.error & ~protocol.WATCHDOG_TIMER_EXPIRED[self._p.firmware]

    def _may_rearm(self, now: float) -> bool:
        """Return True if all lost reports are back, and arming without a request is allowed."""
        back = (not self._fault(a) and not self._overdue(a, now) for a in self._axes)
        return self._recovers and self._p.rearm == AUTO and all(back)


def _jump(axis: Axis, report: protocol.Estimates, now: float) -> str:
    """Return a text on how new estimates contradict the last ones; empty if they do not.

    Two drives with one node id report the positions of two motors in turns.
    """
    seconds = now - axis.estimated
    speed = max(abs(axis.speed), abs(report.velocity))
    explained = FASTER_BETWEEN * speed * max(seconds, LONGEST_QUEUED)
    explained += LARGEST_ACCELERATION * seconds**2 / 4  # acceleration and braking
    change = report.position - axis.turns
    if not abs(change) > JUMP + explained:
        return ""
    return (
        f"{axis.name}: jumped by {change:.3g} turns in {seconds * 1e3:.2g} ms at"
        f" {speed:.2g} turns/s: do two drives have this node id?"
    )


def _idle(nodes: Sequence[int]) -> list[protocol.Message]:
    """Return the commands to release axes: zero torque for all, then idle."""
    released = [SetTorque(node, 0.0) for node in nodes]
    return [*released, *(SetState(node, AxisState.IDLE) for node in nodes)]

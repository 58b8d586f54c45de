"""Arm of ODrives: arming, torques and position of its tip, without a bus and without a clock."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.devices.can.kinematics import (
    Angles,
    JointParameters,
    joint_torques,
    tip_velocity,
)
from haptic_accel.devices.can.parameters import REQUESTED, CanParameters
from haptic_accel.devices.can.protocol import (
    WATCHDOG_TIMER_EXPIRED,
    AxisState,
    ClearErrors,
    Estimates,
    EstimatesRequest,
    Frame,
    Heartbeat,
    Message,
    SetMode,
    SetState,
    SetTorque,
    error_names,
    parse_report,
    state_name,
)
from haptic_accel.devices.connection import AUTO
from haptic_accel.devices.interface import Sample

REPEAT_PERIOD = 5e-3
"""Time after which torques are sent again, s. The time-out of an axis' watchdog should be several
times this."""

ARMING_PERIOD = 0.25
"""Time after which the commands to arm are repeated, s; a heartbeat takes 0.1 s."""

ON_REQUEST = "disarmed on request"
"""Reason why there are no torques after `DrivenArm.disarm`."""

_LOG = logging.getLogger(__name__)


class State(Enum):
    """Permission of torques."""

    DISARMED = 0
    ARMING = 1
    ARMED = 2


@dataclass
class Axis:
    """Latest state of one joint and its drive; times in s, minus infinity for never.

    Attributes
    ----------
    name : str
    joint : JointParameters
    turns, speed : float
        Position and speed of the motor, turns and turns per second.
    estimated : float
        Time of the last estimates.
    error, state : int
        Error and state in the last heartbeat.
    reported : float
        Time of the last heartbeat.
    """

    name: str
    joint: JointParameters
    turns: float = 0.0
    speed: float = 0.0
    estimated: float = -math.inf
    error: int = 0
    state: int = AxisState.UNDEFINED
    reported: float = -math.inf

    @property
    def node(self) -> int:
        """Node id of the axis."""
        return self.joint.node_id

    def __str__(self) -> str:
        """Return the name of the axis for messages."""
        return f"{self.name} (node {self.node})"


class DrivenArm:
    """Axes that have torques only while all of them work.

    Called by two threads: one reads the bus, the other moves the arm.

    Parameters
    ----------
    parameters : CanParameters
    send : callable
        Sends frames; returns False if it could not.

    Attributes
    ----------
    fault : str
        Reason why there are no torques, or were none until it was armed again; empty if none.
    """

    def __init__(self, parameters: CanParameters, send: Callable[[Sequence[Frame]], bool]) -> None:
        self._p = parameters
        self._send_frames = send
        self._kinematics = parameters.arm()
        self._axes = [Axis(name, joint) for name, joint in parameters.joints.items()]
        self._by_node = {axis.node: axis for axis in self._axes}
        self._lock = threading.RLock()
        self._state = State.DISARMED
        self._torques = self._zero = (0.0,) * len(self._axes)
        self._arming_since = self._arming_sent = self._torques_sent = -math.inf
        self._estimates_requested = -math.inf
        self._recovers = False
        self.fault = ""
        self._counts = dict.fromkeys(
            (
                "foreign_frames",
                "samples_missing",
                "limited_torques",
                "withheld_forces",
                "rejected_forces",
                "disarmed",
            ),
            0,
        )

    @property
    def state(self) -> State:
        """Permission of torques."""
        return self._state

    @property
    def nodes(self) -> list[int]:
        """Node ids of the axes."""
        return list(self._by_node)

    @property
    def torques(self) -> Angles:
        """Torques of the motors, as last commanded, N m."""
        return self._torques

    def status(self) -> dict[str, int]:
        """Return counts by name."""
        return {"armed": int(self._state is State.ARMED), **self._counts}

    # Called by the thread that reads the bus

    def take(self, frame: Frame, now: float) -> None:
        """Process a frame received at a time."""
        report = parse_report(frame)
        axis = self._by_node.get(frame.node)
        if report is None or axis is None:
            self._counts["foreign_frames"] += 1
        elif isinstance(report, Estimates):
            axis.turns, axis.speed, axis.estimated = report.position, report.velocity, now
        elif isinstance(report, Heartbeat):
            axis.error, axis.state, axis.reported = report.error, report.state, now
            self._react(axis)

    def update(self, now: float) -> None:
        """Disarm if something is wrong, continue arming, feed the drives' watchdogs."""
        with self._lock:
            if self._state is State.ARMED:
                self._check(now)
            elif self._state is State.ARMING:
                self._continue_arming(now)
            elif self._may_rearm(now):
                self.arm(now)
            # Zero may be repeated for ever. Other torques only the commanding thread may repeat,
            # so that the watchdogs stop the drives when that one hangs.
            if self._state is not State.DISARMED and not any(self._torques):
                self._repeat(now)
            self._request_estimates(now, REPEAT_PERIOD)

    def lose(self) -> None:
        """Disarm because the bus is lost, and forget all reports."""
        self._disarm_for("the bus has gone", recovers=True)
        for axis in self._axes:
            axis.reported = axis.estimated = -math.inf

    def find(self) -> None:
        """Release the axes when the bus is back: they may still exert their last torques."""
        with self._lock:
            self._release()

    # Called by the thread that moves the arm

    def missing(self, now: float) -> str:
        """Return the names of axes without a heartbeat; empty if there are none."""
        return ", ".join(str(axis) for axis in self._axes if self._silent(axis, now))

    def arm(self, now: float) -> None:
        """Begin to arm: clear errors, then closed loop with zero torques."""
        with self._lock:
            self._state, self._arming_since = State.ARMING, now
            self._torques, self._recovers = self._zero, False
            self._send_arming(now)

    def disarm(self) -> None:
        """Release all axes until armed again: zero torque, then idle."""
        with self._lock:
            self._release()
            self._recovers, self.fault = False, ON_REQUEST

    def apply(self, force: Vector, now: float) -> None:
        """Apply a force to the tip, N, while armed and as far as the motors' limits allow."""
        if not math.isfinite(sum(force)):
            self._counts["rejected_forces"] += 1
            force = ZERO
        angles = self._angles()
        joint = joint_torques(self._kinematics.jacobian(angles), force)
        torques = self._limited(joint)
        with self._lock:
            if self._state is State.ARMED:
                self._torques = torques
                self._send_torques(now)
            elif any(torques):
                self._counts["withheld_forces"] += 1

    def read(self, now: float) -> Sample | None:
        """Return position and velocity of the tip, and repeat the torques if they are due.

        While estimates are missing there is no sample, which is counted. There is no
        accelerometer: the acceleration is zero.
        """
        with self._lock:
            if self._state is State.ARMED:
                self._repeat(now)
        self._request_estimates(now, 0.0)
        if any(self._stale(axis, now) for axis in self._axes):
            self._counts["samples_missing"] += 1
            return None
        angles = self._angles()
        speeds = [axis.joint.angle_per_turn * axis.speed for axis in self._axes]
        velocity = tip_velocity(self._kinematics.jacobian(angles), speeds)
        return Sample(self._kinematics.position(angles), velocity, 0.0)

    def _disarm_for(self, reason: str, *, recovers: bool = False) -> None:
        """Release all axes for a reason; `recovers` allows to arm again without a request."""
        with self._lock:
            if self._state is State.DISARMED:
                return
            self._release()
            self._recovers, self.fault = recovers, reason
            self._counts["disarmed"] += 1
            _LOG.warning("can: no torque: %s", reason)

    def _release(self) -> None:
        self._state, self._torques = State.DISARMED, self._zero
        self._send(_idle(self.nodes))

    def _angles(self) -> Angles:
        return tuple(axis.joint.angle(axis.turns) for axis in self._axes)

    def _limited(self, joint: Angles) -> Angles:
        """Return the motors' torques, all scaled alike, so that the force keeps its direction."""
        torques = [a.joint.motor_torque(t) for a, t in zip(self._axes, joint, strict=True)]
        excess = 1.0
        for axis, torque in zip(self._axes, torques, strict=True):
            limit = axis.joint.torque_limit
            if abs(torque) > limit * excess:
                excess = abs(torque) / limit if limit > 0 else math.inf
        self._counts["limited_torques"] += excess > 1.0
        if not math.isfinite(excess):
            return self._zero
        return tuple(torque / excess for torque in torques)

    def _send(self, messages: Iterable[Message]) -> None:
        self._send_frames([message.frame() for message in messages])

    def _send_torques(self, now: float) -> None:
        self._torques_sent = now
        torques = zip(self.nodes, self._torques, strict=True)
        self._send([SetTorque(node, torque) for node, torque in torques])

    def _repeat(self, now: float) -> None:
        if now - self._torques_sent >= REPEAT_PERIOD:
            self._send_torques(now)

    def _request_estimates(self, now: float, period: float) -> None:
        """Request estimates that are not streamed, unless done within a period."""
        if self._p.estimates == REQUESTED and now - self._estimates_requested >= period:
            self._estimates_requested = now
            self._send([EstimatesRequest(node) for node in self.nodes])

    def _silent(self, axis: Axis, now: float) -> bool:
        return now - axis.reported > self._p.heartbeat_timeout

    def _stale(self, axis: Axis, now: float) -> bool:
        return now - axis.estimated > self._p.estimates_timeout

    def _react(self, axis: Axis) -> None:
        """Disarm when an axis reports a problem; stop one that should be idle."""
        with self._lock:
            wrong = self._wrong(axis)
            if wrong and self._state is State.ARMED:
                self._disarm_for(wrong)
            elif axis.state == AxisState.CLOSED_LOOP_CONTROL and self._state is State.DISARMED:
                # The command was lost, or another program left it so.
                self._send(_idle([axis.node]))

    def _check(self, now: float) -> None:
        """Disarm when the reports of an axis are overdue."""
        lost = next(filter(None, (self._overdue(axis, now) for axis in self._axes)), "")
        if lost:
            self._disarm_for(lost, recovers=True)

    def _wrong(self, axis: Axis) -> str:
        """Return the problem that an axis reports; empty for none."""
        if axis.error:
            return f"{axis}: {error_names(axis.error, self._p.firmware)}"
        if axis.state != AxisState.CLOSED_LOOP_CONTROL:
            return f"{axis}: is not in closed loop but in {state_name(axis.state)}"
        return ""

    def _overdue(self, axis: Axis, now: float) -> str:
        """Return the report of an axis that is overdue; empty for none."""
        if self._silent(axis, now):
            return f"{axis}: no heartbeat for {self._p.heartbeat_timeout:g} s"
        if self._stale(axis, now):
            return f"{axis}: no estimates for {self._p.estimates_timeout:g} s"
        return ""

    def _send_arming(self, now: float) -> None:
        self._torques_sent = self._arming_sent = now
        for node in self.nodes:
            closed_loop = SetState(node, AxisState.CLOSED_LOOP_CONTROL)
            self._send([SetMode(node), SetTorque(node, 0.0), ClearErrors(node), closed_loop])

    def _continue_arming(self, now: float) -> None:
        missing = self._missing(now)
        if not missing:
            self._state, self.fault = State.ARMED, ""
        elif now - self._arming_since > self._p.start_timeout:
            self._disarm_for(missing)
        elif now - self._arming_sent > ARMING_PERIOD:
            # An error that was cleared and is there again would only come a third time.
            if any(axis.error and axis.reported > self._arming_since for axis in self._axes):
                self._disarm_for(missing)
            else:
                self._send_arming(now)

    def _missing(self, now: float) -> str:
        """Return what is still missing before torques are allowed; empty for nothing."""
        for axis in self._axes:
            # Earlier reports do not show the effect of the commands.
            reported = axis.reported > self._arming_since
            wrong = self._wrong(axis) if reported else f"{axis}: no heartbeat since it was armed"
            if wrong := self._overdue(axis, now) or wrong:
                return wrong
        return ""

    def _may_rearm(self, now: float) -> bool:
        """Return True if all lost reports are back, and arming without a request is allowed."""
        if not (self._recovers and self._p.rearm == AUTO):
            return False
        # A watchdog error is no fault of an axis that was cut off.
        watchdog = WATCHDOG_TIMER_EXPIRED[self._p.firmware]
        return all(
            not self._overdue(axis, now) and axis.error in (0, watchdog) for axis in self._axes
        )


def _idle(nodes: Sequence[int]) -> list[Message]:
    """Return the commands to release axes: no torque first, for all, then idle."""
    return [
        *(SetTorque(node, 0.0) for node in nodes),
        *(SetState(node, AxisState.IDLE) for node in nodes),
    ]

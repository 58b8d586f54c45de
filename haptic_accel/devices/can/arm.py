"""An arm of ODrives: when it may have torques, which, and where its tip is. No bus, no clock."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.devices.can.kinematics import (
    Angles,
    JointParameters,
    joint_torques,
    tip_velocity,
)
from haptic_accel.devices.can.parameters import AUTO, REQUESTED, CanParameters
from haptic_accel.devices.can.protocol import (
    WATCHDOG_TIMER_EXPIRED,
    AxisState,
    Estimates,
    Frame,
    Heartbeat,
    error_names,
    make_clear_errors,
    make_estimates_request,
    make_input_torque,
    make_set_state,
    make_torque_mode,
    parse_answer,
    state_name,
)
from haptic_accel.devices.interface import Sample

REPEAT_PERIOD = 5e-3
"""s, after which torques are sent again. An axis whose watchdog hears nothing lets go: its
time-out should be several times this."""

ARMING_PERIOD = 0.25
"""s, after which axes that did not hear are told again to arm; a heartbeat takes 0.1 s."""

ON_REQUEST = "disarmed on request"
"""Why there are no torques after `Arm.disarm`."""

_LOG = logging.getLogger(__name__)


class State(Enum):
    """Whether an arm may have torques."""

    DISARMED = 0
    ARMING = 1
    ARMED = 2


@dataclass
class Axis:
    """The latest of one joint and its drive; times in s, never if minus infinity.

    Attributes
    ----------
    turns, speed : float
        Of the motor, turns and turns per second.
    """

    name: str
    joint: JointParameters
    turns: float = 0.0
    speed: float = 0.0
    estimated: float = -math.inf
    error: int = 0
    state: int = AxisState.UNDEFINED
    heard: float = -math.inf

    @property
    def node(self) -> int:
        """Its node."""
        return self.joint.node_id

    def __str__(self) -> str:
        """Name it as in a message."""
        return f"{self.name} (node {self.node})"


class Arm:
    """Axes that have torques only while all of them are well.

    Called by two threads: one reads the bus, the other moves the arm.

    Parameters
    ----------
    parameters : CanParameters
    send : callable
        Sends frames and returns whether they went.

    Attributes
    ----------
    fault : str
        Why there are no torques, or were none until it was armed again; empty if all is well.
    """

    def __init__(self, parameters: CanParameters, send: Callable[[Sequence[Frame]], bool]) -> None:
        self._p = parameters
        self._send = send
        self._kinematics = parameters.arm()
        self._axes = [Axis(name, joint) for name, joint in parameters.joints.items()]
        self._by_node = {axis.node: axis for axis in self._axes}
        self._lock = threading.RLock()
        self._state = State.DISARMED
        self._torques = self._zero = (0.0,) * len(self._axes)
        self._armed_since = self._told_to_arm = self._told = self._asked = -math.inf
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
        """Whether it may have torques."""
        return self._state

    @property
    def nodes(self) -> list[int]:
        """Of its axes."""
        return list(self._by_node)

    @property
    def torques(self) -> Angles:
        """Of the motors, as last commanded, N m."""
        return self._torques

    def status(self) -> dict[str, int]:
        """Return counts by name."""
        return {"armed": int(self._state is State.ARMED), **self._counts}

    # What the thread that reads the bus calls

    def take(self, frame: Frame, now: float) -> None:
        """Take a frame that came at a time."""
        answer = parse_answer(frame)
        axis = self._by_node.get(frame.node)
        if answer is None or axis is None:
            self._counts["foreign_frames"] += 1
        elif isinstance(answer, Estimates):
            axis.turns, axis.speed, axis.estimated = answer.position, answer.velocity, now
        elif isinstance(answer, Heartbeat):
            axis.error, axis.state, axis.heard = answer.error, answer.state, now
            self._heed(axis)

    def look(self, now: float) -> None:
        """Let go if something is wrong, go on arming, keep the drives from letting go."""
        with self._lock:
            if self._state is State.ARMED:
                self._check(now)
            elif self._state is State.ARMING:
                self._go_on_arming(now)
            elif self._may_rearm(now):
                self.arm(now)
            # Zero may be repeated for ever. Other torques only their commander may repeat, so
            # that the drives let go when that one hangs.
            if self._state is not State.DISARMED and not any(self._torques):
                self._repeat(now)
            self._ask(now, REPEAT_PERIOD)

    def lose(self, now: float) -> None:
        """Note that the bus has gone, and with it all that was heard."""
        self._let_go("the bus has gone", recovers=True)
        for axis in self._axes:
            axis.heard = axis.estimated = -math.inf

    def find(self, now: float) -> None:
        """Note that the bus is back: the axes may still exert what they were told last."""
        with self._lock:
            self._release()

    # What the thread that moves the arm calls

    def missing(self, now: float) -> str:
        """Say which axes are not heard; empty if all are."""
        silent = [str(axis) for axis in self._axes if self._silence(axis, now)]
        return ", ".join(silent)

    def arm(self, now: float) -> None:
        """Begin to arm: clear errors, then closed loop with torques, which are zero."""
        with self._lock:
            self._state, self._armed_since = State.ARMING, now
            self._torques, self._recovers = self._zero, False
            self._tell_to_arm(now)

    def disarm(self) -> None:
        """Let go, until it is armed again: zero torque, then idle, for all axes."""
        with self._lock:
            self._release()
            self._recovers, self.fault = False, ON_REQUEST

    def apply(self, force: Vector, now: float) -> None:
        """Give the tip a force, N, as far as the motors' limits allow and while it is armed."""
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
        """Return where the tip is, and repeat the torques if nobody gave others.

        While estimates are missing there is no sample, which is counted. There is no
        accelerometer: the acceleration is zero.
        """
        with self._lock:
            if self._state is State.ARMED:
                self._repeat(now)
        self._ask(now, 0.0)
        if any(self._stale(axis, now) for axis in self._axes):
            self._counts["samples_missing"] += 1
            return None
        angles = self._angles()
        speeds = [axis.joint.angle_per_turn * axis.speed for axis in self._axes]
        velocity = tip_velocity(self._kinematics.jacobian(angles), speeds)
        return Sample(self._kinematics.position(angles), velocity, 0.0)

    def _let_go(self, reason: str, *, recovers: bool = False) -> None:
        """Let go because something is wrong.

        Parameters
        ----------
        reason : str
            What is.
        recovers : bool
            Whether it may be armed again without being asked, once nothing is wrong.
        """
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
        """Return the motors' torques, all shortened alike: the force keeps its direction."""
        torques = [a.joint.motor_torque(t) for a, t in zip(self._axes, joint, strict=True)]
        excess = 1.0
        for axis, torque in zip(self._axes, torques, strict=True):
            limit = axis.joint.torque_limit
            if abs(torque) > limit * excess:
                excess = abs(torque) / limit if limit > 0 else math.inf
        if excess > 1.0:
            self._counts["limited_torques"] += 1
        if not math.isfinite(excess):
            return self._zero
        return tuple(torque / excess for torque in torques)

    def _send_torques(self, now: float) -> None:
        self._told = now
        torques = zip(self.nodes, self._torques, strict=True)
        self._send([make_input_torque(node, torque) for node, torque in torques])

    def _repeat(self, now: float) -> None:
        if now - self._told >= REPEAT_PERIOD:
            self._send_torques(now)

    def _ask(self, now: float, period: float) -> None:
        """Ask for estimates that are not streamed, unless somebody did within a period."""
        if self._p.estimates == REQUESTED and now - self._asked >= period:
            self._asked = now
            self._send([make_estimates_request(node) for node in self.nodes])

    def _silence(self, axis: Axis, now: float) -> bool:
        return now - axis.heard > self._p.heartbeat_timeout

    def _stale(self, axis: Axis, now: float) -> bool:
        return now - axis.estimated > self._p.estimates_timeout

    def _heed(self, axis: Axis) -> None:
        """Let go at once when an axis says that it is not well; stop one that should be idle."""
        with self._lock:
            wrong = self._wrong(axis)
            if wrong and self._state is State.ARMED:
                self._let_go(wrong)
            elif axis.state == AxisState.CLOSED_LOOP_CONTROL and self._state is State.DISARMED:
                # It did not hear that it should let go, or another program left it so.
                self._send(_idle([axis.node]))

    def _check(self, now: float) -> None:
        """Let go when an axis is not heard."""
        for axis in self._axes:
            lost = self._lost(axis, now)
            if lost:
                self._let_go(lost, recovers=True)
                return

    def _wrong(self, axis: Axis) -> str:
        """Say what an axis has against torques; empty for nothing."""
        if axis.error:
            return f"{axis}: {error_names(axis.error, self._p.firmware)}"
        if axis.state != AxisState.CLOSED_LOOP_CONTROL:
            return f"{axis}: is not in closed loop but in {state_name(axis.state)}"
        return ""

    def _lost(self, axis: Axis, now: float) -> str:
        """Say what is not heard of an axis; empty for nothing."""
        if self._silence(axis, now):
            return f"{axis}: no heartbeat for {self._p.heartbeat_timeout:g} s"
        if self._stale(axis, now):
            return f"{axis}: no estimates for {self._p.estimates_timeout:g} s"
        return ""

    def _tell_to_arm(self, now: float) -> None:
        self._told = self._told_to_arm = now
        for node in self.nodes:
            self._send(
                [
                    make_torque_mode(node),
                    make_input_torque(node, 0.0),
                    make_clear_errors(node),
                    make_set_state(node, AxisState.CLOSED_LOOP_CONTROL),
                ]
            )

    def _go_on_arming(self, now: float) -> None:
        waited_for = self._waited_for(now)
        if not waited_for:
            self._state, self.fault = State.ARMED, ""
        elif now - self._armed_since > self._p.start_timeout:
            self._let_go(waited_for)
        elif now - self._told_to_arm > ARMING_PERIOD:
            # An error that was cleared and is there again would only come a third time.
            if any(axis.error and axis.heard > self._armed_since for axis in self._axes):
                self._let_go(waited_for)
            else:
                self._tell_to_arm(now)

    def _waited_for(self, now: float) -> str:
        """Say what is still to come before there may be torques; empty for nothing."""
        for axis in self._axes:
            # What was said before says nothing of what became of the commands.
            heard = axis.heard > self._armed_since
            wrong = self._wrong(axis) if heard else f"{axis}: no heartbeat since it was armed"
            if wrong := self._lost(axis, now) or wrong:
                return wrong
        return ""

    def _may_rearm(self, now: float) -> bool:
        """Whether what was lost is back, and whoever lost it wants it armed."""
        if not (self._recovers and self._p.rearm == AUTO):
            return False
        # Not having heard of us is no error of an axis that was cut off.
        watchdog = WATCHDOG_TIMER_EXPIRED[self._p.firmware]
        return all(
            not self._lost(axis, now) and axis.error in (0, watchdog) for axis in self._axes
        )


def _idle(nodes: Sequence[int]) -> list[Frame]:
    """Return what makes axes let go: no torque first, for all, then idle."""
    return [make_input_torque(node, 0.0) for node in nodes] + [
        make_set_state(node, AxisState.IDLE) for node in nodes
    ]

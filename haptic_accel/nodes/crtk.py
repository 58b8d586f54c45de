# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""CRTK interface of a device node: queries, motion commands and operating state of the arm.

The graph itself does not use CRTK. The interface has no cost while unused: queries are published
only while they have subscribers, and commands polled only while they have publishers.

This module also publishes the arm's lifecycle state and its joint states for displays.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from typing import Any

from builtin_interfaces.msg import Time
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from haptic_accel.core import crtk
from haptic_accel.core.actuator import ArmLimits
from haptic_accel.core.crtk import CRTK_MESSAGES, PositionServo, PositionServoParameters
from haptic_accel.core.model import Sample, Vector
from haptic_accel.core.parameters import shown
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import SafetyLayer
from haptic_accel.core.topics import JOINT_STATE_RATE, JOINT_STATES, ArmTopics, Topic
from haptic_accel.devices.interface import Joints
from haptic_accel.devices.rclpy_internals import lifecycle_callbacks, state_machine
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.signals import Sender
from haptic_accel.nodes.supervised_node import message_type

UNCONFIGURED, INACTIVE, ACTIVE = "unconfigured", "inactive", "active"
"""Stable states of a managed node, by their ROS names."""

SERVICES = {
    "change_state": ChangeState,
    "get_state": GetState,
    "get_available_states": GetAvailableStates,
    "get_available_transitions": GetAvailableTransitions,
    "get_transition_graph": GetAvailableTransitions,
}
"""Types of a managed node's services by name."""


class Managed(LifecycleNodeMixin):
    """Mix-in class that gives a graph node the states and services of ROS 2's lifecycle.

    The class creates the lifecycle services itself: the queue of rclpy's services is short, and
    requests that it drops get no answer.
    """

    def begin_lifecycle(self) -> None:
        """Create the services, once the node exists."""
        callbacks = lifecycle_callbacks(self, SERVICES)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=not callbacks)
        for name, callback in callbacks.items():
            self.create_service(SERVICES[name], f"~/{name}", callback)
        (change,) = (each for each in self.services if each.srv_type is ChangeState)
        self._change, change.callback = change.callback, self._serve_change

    @property
    def state(self) -> str:
        """Name of the current state."""
        return str(state_machine(self).current_state[1])

    def destroy_node(self) -> None:
        """Destroy the node and its state machine.

        rclpy would keep the state machine, and thus the middleware, until the process ends: the
        middleware's threads would then use libraries that are being unloaded.
        """
        super().destroy_node()
        state_machine(self).destroy_when_not_in_use()

    def _serve_change(self, request: ChangeState.Request, response: ChangeState.Response) -> Any:
        """Change the state as requested; rclpy would end the node for an impossible transition."""
        # Look the transition up by name or, without a name, by number.
        possible = {name: n for n, name, *_ in state_machine(self).available_transitions}
        requested = request.transition
        if requested.label in possible if requested.label else requested.id in possible.values():
            return self._change(request, response)
        self.get_logger().warning(
            f"transition {shown(requested.label) or requested.id}: refused in state {self.state};"
            f" allowed: {', '.join(possible)}"
        )
        response.success = False
        return response


def joint_state(stamp: int, frame: str = "", **fields: Any) -> JointState:
    """Return a joint state with a stamp (system time, ns), a frame, and fields by name."""
    message = JointState(**fields)
    sec, nanosec = divmod(stamp, NANOSECONDS)
    message.header.stamp, message.header.frame_id = Time(sec=sec, nanosec=nanosec), frame
    return message


class JointStates:
    """Publisher of an arm's position at a low rate, active while subscribed to.

    Parameters
    ----------
    node : GraphNode
    position : Topic
        The arm's position.
    rate : float
        Samples per second.
    """

    def __init__(self, node: GraphNode, position: Topic, rate: float) -> None:
        self._publisher = node.publisher(JOINT_STATES)
        self._names = [f"{position.source}_{axis}" for axis in "xyz"]
        self._every = max(1, round(rate / JOINT_STATE_RATE))
        self._passed = 0

    def add(self, stamp: int, position: Vector) -> None:
        """Publish a position, m, stamped in system time, ns, unless the last one is too recent."""
        self._passed += 1
        if self._passed < self._every:
            return
        self._passed = 0
        if self._publisher.get_subscription_count() == 0:
            return
        self._publisher.publish(joint_state(stamp, name=self._names, position=position))


INVALID = 0
"""Stamp of data that are not valid now (CRTK, "Data validity")."""

_JOINTS, _EMPTY = "sensor_msgs/msg/JointState", "std_msgs/msg/Empty"
_STATE, _TEXT = f"{CRTK_MESSAGES}/msg/OperatingState", f"{CRTK_MESSAGES}/msg/StringStamped"

STATE_COMMAND_AGE = 1.0
"""Age above which a state command is outdated, s; a person sends it, not a control loop."""


class Queries:
    """Publishers of an arm's joint state, force and set-points, active while subscribed to.

    Parameters
    ----------
    node : GraphNode
    arm : ArmTopics

    Attributes
    ----------
    is_subscribed : bool
        True if the last `poll` found a subscriber.
    """

    def __init__(self, node: GraphNode, arm: ArmTopics) -> None:
        self._frame, self._prefix = arm.position.frame, f"{arm.position.source}_"
        self._joints = node.publisher(arm.topic("measured_js", _JOINTS))
        self._force, self._set_force, self._set_point = (
            Sender(node, arm.topic(name, kind))
            for name, kind in (
                ("measured_cf", arm.arm_force.type),
                ("setpoint_cf", arm.arm_force.type),
                ("setpoint_cp", arm.position.type),
            )
        )
        self._joints_subscribed = self.is_subscribed = False

    def poll(self) -> None:
        """Check for subscribers."""
        self._joints_subscribed = self._joints.get_subscription_count() > 0
        others = self._force, self._set_force, self._set_point
        self.is_subscribed = self._joints_subscribed or any(sender.listeners for sender in others)

    def publish(
        self,
        stamp: int,
        sample: Sample,
        force: Vector,
        set_point: Vector | None,
        joints: Callable[[Sample, Vector], Joints],
    ) -> None:
        """Publish the queries of a sample.

        Parameters
        ----------
        stamp : int
            System time, ns.
        sample : Sample
        force : tuple of float
            Force of the arm's motors at that time, N.
        set_point : tuple of float or None
            Position at which the arm is held, m; or None.
        joints : callable
            Returns the joints for sample and force.
        """
        self._force.send(stamp, force)
        if set_point is None:
            self._set_force.send(stamp, force)
            self._set_point.send(INVALID, sample.position)
        else:
            self._set_force.send(INVALID, force)
            self._set_point.send(stamp, set_point)
        if self._joints_subscribed:
            self._publish_joints(stamp, joints(sample, force))

    def _publish_joints(self, stamp: int, joints: Joints) -> None:
        message = joint_state(
            stamp,
            self._frame,
            name=[self._prefix + name for name in joints.names],
            position=list(joints.positions),
            velocity=list(joints.velocities),
            effort=list(joints.efforts),
        )
        self._joints.publish(message)


class MotionCommands:
    """Motion commands other than forces: `servo_cp`, `hold` and `free`.

    Between two samples, `free` takes precedence over `hold`, and `hold` over a position; among
    commands of one kind, the newest applies.

    Parameters
    ----------
    node : GraphNode
    arm : ArmTopics
    parameters : PositionServoParameters
    limits : ArmLimits
        Positions have the maximum age of forces.

    Attributes
    ----------
    servo : PositionServo
    positions : Inbox
        Commands of `servo_cp`.
    expected : bool
        True if the last `poll` found a publisher.
    refused : int
        Number of outdated or non-finite positions.
    """

    def __init__(
        self, node: GraphNode, arm: ArmTopics, servo: PositionServoParameters, limits: ArmLimits
    ) -> None:
        self._limits = limits
        self.servo = PositionServo(servo)
        self.positions = node.inbox(arm.topic("servo_cp", arm.position.type, reliable=False))
        self._holds = node.inbox(arm.topic("hold", _EMPTY))
        self._frees = node.inbox(arm.topic("free", _EMPTY))
        self.expected = False
        self.refused = 0

    def poll(self) -> None:
        """Check for publishers."""
        inboxes = self.positions, self._holds, self._frees
        self.expected = any(inbox.senders for inbox in inboxes)

    def receive(self, position: Vector, goals: Iterable[tuple[int, Vector]]) -> bool:
        """Process commands at an arm position, m; return True if the arm is freed.

        Parameters
        ----------
        position : tuple of float
            Present position, m.
        goals : iterable of tuple
            Stamps, system time in ns, and commanded positions, m.
        """
        for stamp, goal in goals:
            if self._valid(stamp, goal):
                self.servo.set_point = goal
            else:
                self.refused += 1
        if self._holds.drain(bytes):
            self.servo.set_point = position
        freed = bool(self._frees.drain(bytes))
        if freed:
            self.servo.set_point = None
        return freed

    def _valid(self, stamp: int, goal: Vector) -> bool:
        """Return True if a position is finite and up to date."""
        age = 0 if self._limits.zero_stamp and not stamp else time.time_ns() - stamp
        return math.isfinite(sum(goal)) and abs(age) <= self._limits.max_age * NANOSECONDS


class OperatingState:
    """CRTK operating state of an arm; state commands cause transitions of the managed node.

    States and commands need CRTK's messages; "homed" and "busy" are published without them.

    Parameters
    ----------
    node : Managed
    arm : ArmTopics
    safety : SafetyLayer
    fault : callable
        Returns the device's fault; empty for none.
    rearm : callable
        Allows forces again after a fault; returns the reason if refused.
    """

    def __init__(
        self,
        node: Managed,
        arm: ArmTopics,
        safety: SafetyLayer,
        fault: Callable[[], str],
        rearm: Callable[[], str],
    ) -> None:
        def topic(name: str, kind: str = arm.stopped.type) -> Topic:
            return arm.topic(name, kind, latched=True)

        self._node, self._safety, self._fault, self._rearm = node, safety, fault, rearm
        self._pausing = False
        self._known_fault = ""
        self._published: tuple[Any, ...] = ()
        states = topic("is_homed"), topic("is_busy")
        self._homed, self._busy = (node.publisher(each).publish for each in states)
        self._state = None
        if find_spec(CRTK_MESSAGES):
            self._state = node.publisher(topic("operating_state", _STATE))
            commands = arm.topic("state_command", _TEXT)
            node.create_subscription(message_type(commands), commands.name, self._receive, 10)
        else:
            node.get_logger().debug(f"no {CRTK_MESSAGES}: no operating_state, no state_command")

    @property
    def state(self) -> str:
        """CRTK state name."""
        if self._fault() not in ("", self._known_fault):
            return crtk.FAULT
        if self._node.state == ACTIVE:
            if self._safety.stopped or self._safety.disarmed:
                return crtk.PAUSED
            return crtk.ENABLED if self._safety.active else crtk.DISABLED
        return crtk.PAUSED if self._pausing and self._node.state == INACTIVE else crtk.DISABLED

    def report(self, *, busy: bool = False, again: bool = False) -> None:
        """Publish the state if it changed; with `again`, publish it in any case."""
        homed = self._node.state in (INACTIVE, ACTIVE)
        starting = self._node.state == ACTIVE and not self._safety.active
        current = self.state, homed, busy or starting
        if current == self._published and not again:
            return
        self._published = current
        state, homed, busy = current
        self._homed(Bool(data=homed))
        self._busy(Bool(data=busy))
        if self._state:
            kind = message_type(Topic("", _STATE, "", ""))
            message = kind(state=state, is_homed=homed, is_busy=busy)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._state.publish(message)

    def _receive(self, command: Any) -> None:
        """Execute a command with a recent stamp or without one; log an older one as outdated."""
        sent = command.header.stamp
        stamp = sent.sec * NANOSECONDS + sent.nanosec
        if stamp and abs(time.time_ns() - stamp) > STATE_COMMAND_AGE * NANOSECONDS:
            self._node.get_logger().warning(f"state_command {command.string!r}: out of date")
        else:
            self._obey(command.string)

    def _obey(self, command: str) -> None:
        """Execute a state command, or log the reason of its refusal."""
        refused = crtk.refusal(command, self.state)
        if not refused:
            self.report(busy=True, again=True)
            refused = self._carry_out(command)
        if refused:
            self._node.get_logger().warning(f"state_command {command!r}: {refused}")
        self.report(again=True)

    def _carry_out(self, command: str) -> str:
        """Change the node's state by a command; return the reason if that is impossible."""
        for transition in crtk.transitions(command, self._node.state):
            if getattr(self._node, f"trigger_{transition}")() != Outcome.SUCCESS:
                return f"{transition} failed"
        self._pausing = command == crtk.PAUSE
        if command == crtk.DISABLE:
            self._known_fault = self._fault()
        elif command in (crtk.ENABLE, crtk.RESUME):
            self._known_fault = ""
            if self.state in (crtk.FAULT, crtk.PAUSED):
                return self._rearm()
        return ""

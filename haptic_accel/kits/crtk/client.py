# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of an arm's CRTK topics; imports ROS, so import this module late."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Bool

from haptic_accel import Vector
from haptic_accel.core import CRTK_MESSAGES, ZERO, Orientation
from haptic_accel.core.cdr import StampedVector, unpack_orientation, unpack_stamped_vector
from haptic_accel.core.sampling import NANOSECONDS, SequenceCheck, SolePublisher
from haptic_accel.core.topics import SLAVE
from haptic_accel.devices import rclpy_internals as internals

NODE = "haptic_accel_client"
"""Name of the client's node."""

DEPTH = 10
"""Number of messages kept until they are taken, of which the newest counts."""

DELIVERY = 0.2
"""Longest time for the arm to confirm the last force, s."""

ABSOLUTE = "set_cf_orientation_absolute"
"""Topic of a dVRK, next to `body/servo_cf`: true selects the base frame's orientation."""

_SENSOR = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Quality of service compatible with any publisher."""

_LATCHED = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Signal:
    """Newest vector of a topic, unless it has several publishers.

    The stamp gives the vector's age; it must advance, and agree with the clock. The subscription
    has no executor, so messages wake no thread.

    Attributes
    ----------
    orientation : Orientation
        Newest orientation, if the topic has poses.
    refused : int
        Number of messages whose stamp or vector cannot be used.
    refusal : str
        Reason why the newest message was refused; empty if it was accepted, or is old.
    """

    def __init__(
        self, node: Any, subscription: Any, rate: float, serve: Callable[[], object]
    ) -> None:
        self._take = internals.message_taker(subscription, serve)
        self._count = internals.publisher_count(subscription)
        self._publisher = SolePublisher(internals.MatchedPublishers(node, subscription).counts)
        self._has_orientation = subscription.msg_type is PoseStamped
        self._vector, self._seen = ZERO, -math.inf
        self._sequence = SequenceCheck(rate)
        self.refused, self.refusal, self._refused_at = 0, "", 0.0
        self.orientation = Orientation()

    @property
    def senders(self) -> int:
        """Number of publishers found."""
        return self._count()

    def newest(self, timeout: float) -> Vector | None:
        """Return the newest vector; None if it is older than a time-out in s.

        The result is also None while the topic has several publishers, which are
        indistinguishable.
        """
        messages = list(self._waiting())
        if self._publisher.sole([info["publication_sequence_number"] for _, info in messages]):
            for data, info in messages:
                self._store(data, info["received_timestamp"])
        else:
            deque(self._waiting(), maxlen=0)  # dropped, as they may have another publisher
            self._seen = -math.inf
        now = time.monotonic()
        if now - self._refused_at > timeout:
            self.refusal = ""
        return self._vector if now - self._seen <= timeout else None

    def _waiting(self) -> Iterator[tuple[bytes, dict[str, int]]]:
        """Yield received messages with their metadata."""
        while message := self._take():
            yield message

    def _store(self, data: bytes, received: int) -> None:
        """Store a vector; refuse one that is malformed, not finite, or late when received, ns.

        The time that a message waits in the queue is not counted as its delay.
        """
        now = time.time_ns()
        waited = max(0, now - received) if received else 0  # unknown to some middleware
        now, steady = now - waited, time.monotonic_ns() - waited
        try:
            stamp, vector = unpack_stamped_vector(data)
            if not math.isfinite(sum(vector)):
                raise ValueError("values are not finite")
            if not self._sequence.admits(stamp, now, steady):
                raise ValueError(self._sequence.refusal)
            if self._has_orientation:
                self.orientation.put(unpack_orientation(data))
        except ValueError as error:
            self.refused, self.refusal = self.refused + 1, str(error)
            self._refused_at = steady / NANOSECONDS
        else:
            self._vector, self.refusal = vector, ""
            self._seen = (steady - max(0, now - stamp)) / NANOSECONDS


class ArmClient:
    """Client that reads an arm's motion and state, and sends forces and commands.

    A separate ROS context allows it to send zero force while the process ends.

    Parameters
    ----------
    arm : str
        Full name of the arm's namespace.
    force : str
        Topic of the arm's force below it.
    rate : float
        Samples per second that are read.

    Attributes
    ----------
    position, velocity : Signal
    """

    def __init__(self, arm: str, force: str, rate: float) -> None:
        self._arm = arm
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(
            NODE,
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        serve = internals.server(self._node)
        self.position, self.velocity = (
            Signal(self._node, self._subscription(kind, name, _SENSOR, raw=True), rate, serve)
            for kind, name in ((PoseStamped, "measured_cp"), (TwistStamped, "measured_cv"))
        )
        self._force = self._publisher(WrenchStamped, force, QoSProfile(depth=1))
        self._send_force = internals.bytes_publisher(self._force)
        self._pack = StampedVector(SLAVE.arm_force).pack
        subframe, _, _ = force.strip("/").rpartition("/")
        if subframe:
            self._publisher(Bool, f"{subframe}/{ABSOLUTE}", _LATCHED).publish(Bool(data=True))
        self._states: list[Callable[[], Any]] = []
        self._state: Any = None
        self._commands = None
        if find_spec(CRTK_MESSAGES):
            self._messages: Any = import_module(f"{CRTK_MESSAGES}.msg")
            self._commands = self._publisher(
                self._messages.StringStamped, "state_command", QoSProfile(depth=DEPTH)
            )
            state = self._messages.OperatingState
            # Transient-local subscriptions receive latched states, volatile ones all other states.
            for profile in (_LATCHED, _SENSOR):
                subscription = self._subscription(state, "operating_state", profile)
                self._states.append(internals.message_taker(subscription, serve))

    @property
    def has_states(self) -> bool:
        """True if the arm can be enabled, and its state received."""
        return self._commands is not None

    @property
    def state(self) -> Any:
        """Newest `operating_state`; None while unknown."""
        for take in self._states:
            while message := take():
                self._state = message[0]
        return self._state

    def push(self, force: Vector) -> None:
        """Send a force, N, stamped with the present time."""
        self._send_force(self._pack(time.time_ns(), force))

    @property
    def is_heard(self) -> bool:
        """True once the arm subscribes to state commands; earlier commands are lost."""
        return self._commands is not None and self._commands.get_subscription_count() > 0

    def command(self, command: str) -> None:
        """Send a state command, if that is possible."""
        if self._commands:
            message = self._messages.StringStamped(string=command)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._commands.publish(message)

    def close(self) -> None:
        """Send zero force, wait for its receipt, and disconnect."""
        self.push(ZERO)
        self._force.wait_for_all_acked(Duration(seconds=DELIVERY))
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _subscription(self, kind: Any, name: str, profile: QoSProfile, raw: bool = False) -> Any:
        name = f"{self._arm}/{name}"
        return self._node.create_subscription(kind, name, _ignore, profile, raw=raw)

    def _publisher(self, kind: Any, name: str, profile: QoSProfile) -> Any:
        return self._node.create_publisher(kind, f"{self._arm}/{name.strip('/')}", profile)


def _ignore(message: Any) -> None:
    """Do nothing: messages are taken when they are needed."""

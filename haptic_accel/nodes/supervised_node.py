# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A node as its process sees it: its end, its guarded callbacks, and its topics."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_parameters
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.waitable import Waitable

from haptic_accel.core.cdr import unpack_stamped_vector, unpack_state
from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import Topic
from haptic_accel.devices.matched import MatchedPublishers
from haptic_accel.nodes.callbacks import CallbackGuard
from haptic_accel.nodes.standard_streams import NodeLogger
from haptic_accel.nodes.topic_node import DEPTH, SENT, message_type, offered_quality, quality
from haptic_accel.nodes.wires import WIRES, Wire

Value = TypeVar("Value")


class SupervisedNode(Node):
    """A node that can end by itself, and be closed, but that no callback can end.

    Its topics come from the topic table.

    Attributes
    ----------
    polls : bool
        True if `work` takes all urgent messages from their inboxes, so that the executor need only
        serve requests and timers.
    follows_stop : bool
        True if `follow_stop` is to be called once in `STOP_PERIOD`.
    unserved : set of Subscription
        Subscriptions that the executor ignores: their messages are taken when needed.
    """

    polls = False
    follows_stop = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.unserved: set[Subscription] = set()
        self._polled: set[Service] = set()
        self._malformed: Counter[str] = Counter()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._guard = CallbackGuard(
            lambda line: self.get_logger().error(line), lambda text: self.get_logger().debug(text)
        )
        super().__init__(*args, **kwargs)
        self._logger = NodeLogger(self.get_logger().name)
        self.finished: Future = Future()
        """Its result is set when the node's task is done."""

    def begin(self) -> None:
        """Get ready for the first `work`, once all nodes of the process are made."""

    def work(self) -> float:
        """Do the work that is due; return the steady time of the next call, s.

        The node's callbacks run in between, when a message or a request comes.
        """
        return math.inf

    def finish(self, line: str = "") -> None:
        """Mark the node's task as done, once, with an optional line for the log."""
        if not self.finished.done():
            if line:
                self.get_logger().info(line)
            self.finished.set_result(None)

    def follow_stop(self) -> None:
        """Read messages on the emergency stop, and act upon them."""

    def stop_forces(self) -> None:
        """Execute the emergency stop; do nothing in a node without forces."""

    def take_forces_off(self) -> None:
        """Remove all forces, before any node of the process is closed."""

    def close(self) -> None:
        """Release all resources; called once, however the node ended."""

    def publish_final_diagnostics(self) -> None:
        """Publish the final messages, which may be lost; called once after `close`."""

    def wire(self, topic: Topic) -> Wire:
        """Return the wire of a topic between the nodes of this process."""
        return WIRES.of(self.resolve_topic_name(topic.name))

    def publisher(self, topic: Topic, depth: int = SENT) -> Publisher:
        """Create a topic's publisher, which keeps the last `depth` messages."""
        return self.create_publisher(
            message_type(topic), topic.name, offered_quality(topic, depth)
        )

    def subscribe_raw(
        self, topic: Topic, callback: Callable[[bytes], None], depth: int = DEPTH
    ) -> Subscription:
        """Subscribe to a topic's messages as they are serialised."""
        # Another subscription receives stops from volatile publishers: no warning.
        events = SubscriptionEventCallbacks(use_default_callbacks=not topic.latched)
        return self.create_subscription(
            message_type(topic),
            topic.name,
            callback,
            quality(topic, depth),
            event_callbacks=events,
            raw=True,
        )

    def listen(self, topic: Topic, callback: Callable[[int, Vector], None]) -> Subscription:
        """Subscribe to a signal; the callback gets stamps, system time in ns, and vectors."""
        return self._listen(topic, unpack_stamped_vector, lambda taken: callback(*taken))

    def listen_state(self, topic: Topic, callback: Callable[[bool], None]) -> Subscription:
        """Subscribe to a latched state, true or false."""
        return self._listen(topic, unpack_state, callback)

    def refuse(self, topic: Topic, reason: str) -> None:
        """Count a malformed message; log the first of its topic."""
        self._malformed[topic.name] += 1
        if self._malformed[topic.name] == 1:
            self.get_logger().warning(f"{topic.name}: malformed message refused: {reason}")

    def create_timer(self, period: float, callback: Callable[[], object], **given: Any) -> Timer:
        """Create a timer of the steady clock, since setting system time back must not delay it.

        Parameters
        ----------
        period : float
            Interval between calls, s.
        callback : callable
        **given
            As for rclpy's own.
        """
        return super().create_timer(period, callback, clock=self._steady, **given)

    def create_service(
        self,
        kind: Any,
        name: str,
        callback: Callable[..., Any],
        *,
        qos_profile: QoSProfile = qos_profile_parameters,
        **given: Any,
    ) -> Service:
        """Create a service whose requests wait, as do those to the services of parameters.

        Of usual services ten requests wait, and the older ones get no answer.

        Parameters
        ----------
        kind
            Type of the service.
        name, callback, qos_profile, **given
            As for rclpy's own; by default 1000 requests wait.
        """
        return super().create_service(kind, name, callback, qos_profile=qos_profile, **given)

    def replace_service(self, kind: type, callback: Callable[..., Any]) -> None:
        """Serve the requests to rclpy's own services of a type by another callback."""
        for service in super().services:  # not yet guarded
            if service.srv_type is kind:
                service.callback = callback

    # An executor gets all that it serves from these four, including rclpy's own services, so every
    # callback is guarded.

    @property
    def services(self) -> Iterator[Service]:
        """Services whose requests wake the executor."""
        return (self._guard.service(each) for each in super().services if each not in self._polled)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions whose messages wake the executor."""
        return (
            self._guard.guarded(each, each.topic_name)
            for each in super().subscriptions
            if each not in self.unserved
        )

    @property
    def timers(self) -> Iterator[Timer]:
        """Timers, which wake the executor."""
        return (
            self._guard.guarded(each, f"timer of {each.timer_period_ns / NANOSECONDS:g} s")
            for each in super().timers
        )

    @property
    def waitables(self) -> Iterator[Waitable]:
        """Events of publishers and subscriptions, which wake the executor.

        The counts of a polled subscription do not: the executor fails for their event once the
        subscription is destroyed.
        """
        return (
            self._guard.guarded(each, "event of a topic") if hasattr(each, "callback") else each
            for each in super().waitables
            if not isinstance(each, MatchedPublishers)
        )

    def callback_failed(self, error: Exception) -> None:
        """Count and log an exception of the executor, for example in taking a message."""
        self._guard.note("executor", error)

    def _listen(
        self, topic: Topic, unpack: Callable[[bytes], Value], callback: Callable[[Value], None]
    ) -> Subscription:
        """Subscribe to a topic's messages as they are unpacked."""

        def receive(data: bytes) -> None:
            try:
                value = unpack(data)
            except ValueError as error:
                self.refuse(topic, str(error))
            else:
                callback(value)

        return self.subscribe_raw(topic, receive)

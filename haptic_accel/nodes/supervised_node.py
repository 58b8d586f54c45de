# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node with supervised end, guarded callbacks, topics, and wires within its process.

Standard output, error and log of a node never wait for a reader.
"""

from __future__ import annotations

import importlib
import io
import math
import os
import stat
import sys
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar, cast

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_parameters
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.waitable import Waitable

from haptic_accel.core.cdr import unpack_stamped_vector, unpack_state
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import shown
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import Topic
from haptic_accel.devices.rclpy_internals import MatchedPublishers, NodeLogger


class LossyStream(io.RawIOBase):
    """Raw stream that drops data that cannot be written at once; it never waits or fails.

    Lines of up to 4096 bytes (PIPE_BUF) are written whole to a pipe, or lost. After a longer line
    that was cut, the next text begins a new line.

    Parameters
    ----------
    descriptor : int
        Descriptor that does not block; it is not closed.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._is_cut = False

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Return whether the descriptor is a terminal."""
        return os.isatty(self._descriptor)

    def write(self, data: Any) -> int:
        """Write without waiting; return the length of all data."""
        text = b"\n" + bytes(data) if self._is_cut else bytes(data)
        # EAGAIN: a stalled reader. EPIPE, EIO: no reader or terminal. ENOSPC: a full disk.
        with suppress(OSError):
            self._is_cut = os.write(self._descriptor, text) < len(text)
        return len(data)


def unblock_standard_streams() -> None:
    """Write the log of this process without blocking; drop lines without a reader.

    A write blocks once a pipe holds 64 KiB of unread data, or less in a terminal stopped by
    Ctrl-S. A node whose supervisor is stopped or not read would block and hold the force of its
    last tick. The C library's streams, by which rclpy logs, drop such output, too; output to a
    file is not affected.
    """
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        _unblock(descriptor)
        if name == "stdin":
            continue
        before = getattr(sys, name)  # None if the stream was closed
        with suppress(OSError, AttributeError):
            before.flush()
        stream = io.TextIOWrapper(
            cast("Any", LossyStream(descriptor)),  # a raw stream suffices
            encoding=getattr(before, "encoding", "utf-8"),
            errors="backslashreplace",
            line_buffering=True,  # each line is a single write
        )
        setattr(sys, name, stream)


def _unblock(descriptor: int) -> None:
    try:
        mode = os.fstat(descriptor).st_mode
    except OSError:
        # A closed descriptor may be reused, e.g. by a socket, which must not receive the log.
        _replace(descriptor, os.open(os.devnull, os.O_RDWR))
        return
    if descriptor == 0 or not (stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)):
        return
    # Open the file again: a flag of an inherited file description applies to all processes that
    # share it, such as the shell. O_NOCTTY: otherwise a session leader gets the terminal's
    # signals.
    flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
    try:
        _replace(descriptor, os.open(f"/proc/self/fd/{descriptor}", flags))
    except OSError:
        # A socket, or another user's file after su; a flag on a terminal would disturb the shell.
        if not stat.S_ISCHR(mode):
            os.set_blocking(descriptor, False)


def _replace(descriptor: int, other: int) -> None:
    if other != descriptor:
        os.dup2(other, descriptor)
        os.close(other)


DEPTH = 1000
"""Number of messages kept for a subscriber: those of `CATCH_UP` at the highest rates."""

SENT = 10
"""Number of messages kept by a publisher."""


def message_type(topic: Topic) -> Any:
    """Import a topic's message class."""
    package, _, name = topic.type.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def quality(topic: Topic, depth: int = DEPTH) -> QoSProfile:
    """Return a subscriber's quality of service: signals as sensor data, events reliable."""
    reliability = ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT
    latched, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    durability = latched if topic.latched else volatile
    return QoSProfile(depth=depth, reliability=reliability, durability=durability)


def offered_quality(topic: Topic, depth: int = SENT) -> QoSProfile:
    """Return a publisher's quality of service: reliable, which suits all subscribers."""
    return quality(replace(topic, reliable=True), 1 if topic.latched else depth)


REASONS = ("message", "reason", "failure_reason")
"""Fields of responses for the reason of a refusal."""

Entity = TypeVar("Entity")


def refused(response: Any, reason: str) -> Any:
    """Return a new response, with the reason of a refusal if its type has a field for reasons.

    A new response is a refusal by default: fields for success are false.
    """
    for name in REASONS:
        if hasattr(response, name):
            setattr(response, name, reason)
    if hasattr(response, "result"):
        refused(response.result, reason)
    return response


class CallbackGuard:
    """Guard of the callbacks of one node's services, subscriptions, timers and events.

    Exceptions are counted, and the first failure of each kind is logged. A service always answers.

    No sender may end a node, and thus the graph. Only two kinds of error end a node:

    - An error in the node's own loop, `work`: closing the node removes its forces. Messages are
      checked before `work` takes them (`Inbox`, `Samples`).
    - An error at the start, or in writing a bag.

    A failed device is closed without force; the node continues.

    Parameters
    ----------
    log, explain : callable
        Called with a line for each kind of failure, and with its traceback.

    Attributes
    ----------
    failed : Counter
        Number of failures by service, topic or timer.
    """

    def __init__(self, log: Callable[[str], object], explain: Callable[[str], object]) -> None:
        self._log = log
        self._explain = explain
        self._kinds: set[tuple[str, type[Exception]]] = set()
        self.failed: Counter[str] = Counter()

    def guarded(self, entity: Entity, name: str) -> Entity:
        """Return a subscription, timer or event with its callback guarded."""
        served: Any = entity
        callback = served.callback
        if hasattr(callback, "guard"):
            return entity

        @wraps(callback)
        def call(*args: Any) -> Any:
            try:
                return callback(*args)
            except Exception as error:
                self.note(name, error)
                return None

        vars(call)["guard"] = self
        served.callback = call
        return entity

    def service(self, service: Service) -> Service:
        """Return a guarded service, which answers even if its callback fails."""
        callback, send = service.callback, service.send_response
        if hasattr(callback, "guard"):
            return service
        name = service.service_name

        def call(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                return refused(service.srv_type.Response(), self.note(name, error))

        def answer(response: Any, header: Any) -> None:
            try:
                send(response, header)
            except Exception as error:  # for example, ROS cannot convert a response
                reason = self.note(name, error)
                try:
                    send(refused(service.srv_type.Response(), reason), header)
                except Exception as again:
                    self.note(name, again)

        vars(call)["guard"] = self
        service.callback, service.send_response = call, answer
        return service

    def note(self, name: str, error: Exception) -> str:
        """Count a failure, log the first of its kind, and return it in one line."""
        self.failed[name] += 1
        reason = shown(f"{type(error).__name__}: {' '.join(str(error).split())}")
        if (name, type(error)) not in self._kinds:
            self._kinds.add((name, type(error)))
            self._log(f"{name}: failed: {reason}")
            self._explain("".join(traceback.format_exception(error)))
        return reason


class Wire:
    """Connection of one signal to its receivers in this process, if it is sent here.

    A receiver joins with a function of a flag, which is true if this process sends the signal, and
    false if the signal comes as messages.

    Examples
    --------
    >>> wire, told = Wire(), []
    >>> wire.join(told.append)
    >>> wire.offer()
    >>> told, wire.listeners
    ([False, True], 1)
    """

    def __init__(self) -> None:
        self._receivers: list[Callable[[bool], object]] = []
        self._offered = False

    @property
    def listeners(self) -> int:
        """Number of receivers in this process; 0 if it does not send the signal."""
        return len(self._receivers) if self._offered else 0

    def join(self, receiver: Callable[[bool], object]) -> None:
        """Add a receiver; it is called with true if the signal is sent here."""
        self._receivers.append(receiver)
        receiver(self._offered)

    def leave(self, receiver: Callable[[bool], object]) -> None:
        """Remove a receiver."""
        self._receivers.remove(receiver)

    def offer(self, offered: bool = True) -> None:
        """Notify the receivers that samples come by this wire or, if not offered, as messages."""
        self._offered = offered
        for receiver in self._receivers:
            receiver(offered)


class Wires:
    """Wires of the nodes that share a process.

    Attributes
    ----------
    joined : bool
        True if nodes created from now on share wires; otherwise each node has separate wires, as
        in a separate process.
    """

    def __init__(self) -> None:
        self.joined = False
        self._wires: defaultdict[str, Wire] = defaultdict(Wire)

    def of(self, name: str) -> Wire:
        """Return the wire of a topic, by its full name."""
        return self._wires[name] if self.joined else Wire()


WIRES = Wires()
"""Wires of this process."""


Value = TypeVar("Value")


class SupervisedNode(Node):
    """Node that can end by itself or be closed, but cannot be ended by a callback.

    The topic table defines the node's topics.

    Attributes
    ----------
    polls : bool
        True if `work` takes all urgent messages from their inboxes, so that the executor need only
        serve requests and timers.
    follows_stop : bool
        True if `follow_stop` is to be called once in `STOP_PERIOD`.
    unserved : set of Subscription
        Subscriptions that the executor ignores; their messages are read when needed.
    """

    polls = False
    follows_stop = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.unserved: set[Subscription] = set()
        self._polled: set[Service] = set()
        self._malformed: Counter[str] = Counter()
        self._node_logger: NodeLogger | None = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._guard = CallbackGuard(
            lambda line: self.get_logger().error(line), lambda text: self.get_logger().debug(text)
        )
        super().__init__(*args, **kwargs)
        self._node_logger = NodeLogger(self.get_logger().name)
        self.finished: Future = Future()
        """Future whose result is set when the node's task is done."""

    def get_logger(self) -> Any:
        """Return the node's logger; rclpy's own while the node is being made."""
        return self._node_logger or super().get_logger()

    def begin(self) -> None:
        """Prepare for the first call of `work`, once all nodes of the process exist."""

    def work(self) -> float:
        """Do the work that is due; return the steady time of the next call, s.

        Between calls, the node's callbacks run as messages and requests arrive.
        """
        return math.inf

    def finish(self, line: str = "") -> None:
        """Mark the node's task as done, once, with an optional line for the log."""
        if not self.finished.done():
            if line:
                self.get_logger().info(line)
            self.finished.set_result(None)

    def follow_stop(self) -> None:
        """Process messages on the emergency stop."""

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
        offered = offered_quality(topic, depth)
        return self.create_publisher(message_type(topic), topic.name, offered)

    def subscribe_raw(
        self, topic: Topic, callback: Callable[[bytes], None], depth: int = DEPTH
    ) -> Subscription:
        """Subscribe to a topic's serialised messages."""
        # No warning for a latched topic: another subscription receives volatile publishers' stops.
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
        return self._listen(topic, unpack_stamped_vector, lambda signal: callback(*signal))

    def listen_state(self, topic: Topic, callback: Callable[[bool], None]) -> Subscription:
        """Subscribe to a latched state, true or false."""
        return self._listen(topic, unpack_state, callback)

    def refuse(self, topic: Topic, reason: str) -> None:
        """Count a malformed message; log the first of its topic."""
        self._malformed[topic.name] += 1
        if self._malformed[topic.name] == 1:
            self.get_logger().warning(f"{topic.name}: malformed message refused: {reason}")

    def create_timer(self, period: float, callback: Callable[[], object], **options: Any) -> Timer:
        """Create a timer of the steady clock, since setting system time back must not delay it.

        Parameters
        ----------
        period : float
            Interval between calls, s.
        callback : callable
        **options
            As for rclpy's own.
        """
        return super().create_timer(period, callback, clock=self._steady, **options)

    def create_service(
        self,
        kind: Any,
        name: str,
        callback: Callable[..., Any],
        *,
        qos_profile: QoSProfile = qos_profile_parameters,
        **options: Any,
    ) -> Service:
        """Create a service with a long queue of requests, like rclpy's parameter services.

        Usual services queue only ten requests; older ones get no answer.

        Parameters
        ----------
        kind
            Type of the service.
        name, callback, qos_profile, **options
            As for rclpy's own; by default 1000 requests are queued.
        """
        return super().create_service(kind, name, callback, qos_profile=qos_profile, **options)

    def replace_service(self, kind: type, callback: Callable[..., Any]) -> None:
        """Replace the callback of rclpy's own services of a type."""
        for service in super().services:  # not yet guarded
            if service.srv_type is kind:
                service.callback = callback

    # An executor gets everything that it serves from these four properties, rclpy's own services
    # included, so every callback is guarded.

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
        """Timers that wake the executor."""
        return (
            self._guard.guarded(each, f"timer of {each.timer_period_ns / NANOSECONDS:g} s")
            for each in super().timers
        )

    @property
    def waitables(self) -> Iterator[Waitable]:
        """Events of publishers and subscriptions, which wake the executor.

        The events of a polled subscription are excluded: the executor fails for them once the
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
        """Subscribe to a topic's unpacked messages."""

        def receive(data: bytes) -> None:
            try:
                value = unpack(data)
            except ValueError as error:
                self.refuse(topic, str(error))
            else:
                callback(value)

        return self.subscribe_raw(topic, receive)

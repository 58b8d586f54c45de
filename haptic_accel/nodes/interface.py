# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base of all nodes: checked parameters, topics by name, diagnostics."""

from __future__ import annotations

import importlib
import math
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.waitable import Waitable

from haptic_accel.core.cdr import (
    StampedVector,
    pack_diagnostics,
    unpack_stamped_vector,
    unpack_state,
)
from haptic_accel.core.decimals import read_decimal
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import (
    ParameterError,
    Specification,
    allowed_values,
    checked,
    shown,
)
from haptic_accel.core.rivals import Endpoint, rivals
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.succession import Succession
from haptic_accel.core.topics import BUNDLES, DIAGNOSTICS, SIGNALS, Topic
from haptic_accel.graph.claims import claim_signal
from haptic_accel.graph.files import check_reached
from haptic_accel.graph.node_parameters import (
    NODES,
    USE_SIM_TIME,
    check_clock,
    node_parameters,
    node_schema,
)
from haptic_accel.nodes.bundling import BUNDLES_KEPT, BundleSender, join, owner, participant
from haptic_accel.nodes.callbacks import CallbackGuard
from haptic_accel.nodes.scheduling import SupervisedNode, scheduling_class
from haptic_accel.nodes.wires import WIRES, Wire

DIAGNOSTICS_PERIOD = 1.0
"""Interval between diagnostics, s."""

DEPTH = 1000
"""Number of messages kept for a subscriber: what comes in `CATCH_UP` at the highest rates."""

SENT = 10
"""Number of messages kept by a publisher."""

RIVALS_PERIOD = 0.1
"""Interval between looks for who has become a second publisher of a signal, s: samples are refused
at once, this is for the log."""

LISTENERS_PERIOD = 0.2
"""Interval between looks for who subscribes to a signal if their number stays the same, s."""

REFUSED = "no sample taken while it is sent by"
"""Warning for a signal with several publishers, before their names."""

_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Name that ROS gives to a node whose name it has not heard yet."""

_OF_EVERY_NODE = (USE_SIM_TIME, "start_type_description_service")
"""Parameters that rclpy gives every node."""

_LARGEST = sys.float_info.max

Value = TypeVar("Value")


class Sender:
    """Sends one signal of a node to other processes, by itself while it has a subscriber.

    The loop of this process passes it on to the nodes that share it.

    Parameters
    ----------
    node : GraphNode
    topic : Topic
    bundles : BundleSender, optional
        Bundles that all its messages are put into, too.
    """

    def __init__(self, node: GraphNode, topic: Topic, bundles: BundleSender | None = None) -> None:
        self._node, self._topic, self._bundles = node, topic, bundles
        self._pack = StampedVector(topic).pack
        self._wire = node.wire(topic)
        self._index = bundles.index(node.resolve_topic_name(topic.name)) if bundles else 0
        self._counts = 0, 0
        self._others = 0
        self._look_due = 0.0
        self.offer()

    def offer(self) -> None:
        """Be a publisher of the topic, again after `withdraw`."""
        self._publisher = self._node.publisher(self._topic)
        # As `publish` does, which asks first what it got.
        self._publish: Any = self._publisher.handle.publish_raw
        self._subscribed: Any = self._publisher.handle.get_subscription_count
        self._wire.offer()

    def withdraw(self) -> None:
        """Leave the topic to others; nothing may be sent until `offer`."""
        self._wire.withdraw()
        self._node.destroy_publisher(self._publisher)

    def send(self, stamp: int, vector: Vector) -> None:
        """Send a vector with a stamp, system time in ns."""
        # To ask takes 0.3 us, where a message takes ten times as long.
        subscribed, bundles = self._subscribed(), self._bundles
        bundled = bundles and bundles.listening()
        if subscribed or bundled:
            message = self._pack(stamp, vector)
            if subscribed:
                self._publish(message)
            if bundles and bundled:
                bundles.put(self._index, message)

    @property
    def listeners(self) -> int:
        """Number of receivers found: in this process, subscribers of the signal, of its bundles.

        Who subscribes to both counts once.
        """
        subscribed = int(self._subscribed())
        bundled = int(self._bundles.listening()) if self._bundles else 0
        if subscribed and bundled:
            subscribed = self._found_beside(subscribed, bundled)
        return self._wire.listeners + subscribed + bundled

    def _found_beside(self, subscribed: int, bundled: int) -> int:
        """Return the number of subscribers that do not get the bundles, as looked up lately."""
        now = time.monotonic()
        if (subscribed, bundled) != self._counts or now >= self._look_due:
            self._counts, self._look_due = (subscribed, bundled), now + LISTENERS_PERIOD
            found = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
            assert self._bundles
            both = self._bundles.listeners(self._node)
            self._others = min(subscribed, sum(owner(each) not in both for each in found))
        return self._others


class Publishers:
    """Publishers that a subscription is matched with.

    Attributes
    ----------
    name : str
        Full name of the topic.
    """

    def __init__(self, subscription: Subscription) -> None:
        self.name = subscription.topic_name
        self._count: Any = subscription.handle.get_publisher_count

    @property
    def senders(self) -> int:
        """Number of publishers, whatever their nodes are called.

        The middleware counts them: to ask takes 0.3 us, where the names of their nodes take 45.
        """
        return int(self._count())


class Inbox:
    """Messages of one topic that wait until they are taken, and wake no process.

    None is taken of a signal that is sent in the same process, whoever else publishes it.

    Parameters
    ----------
    node : GraphNode
    topic : Topic
    depth : int
        Number of messages that wait at most.

    Attributes
    ----------
    name : str
        Full name of the topic.
    subscription : Subscription or None
        None while the signal is sent in this process.
    """

    def __init__(self, node: GraphNode, topic: Topic, depth: int) -> None:
        self._node, self._topic = node, topic
        self._depth = depth
        self.name = node.resolve_topic_name(topic.name)
        self.subscription: Subscription | None = None
        self._counted, self._senders = -math.inf, 1
        self._wire = node.wire(topic)
        self._wire.join(self._connect)

    def leave(self) -> None:
        """Take nothing any more."""
        self._wire.leave(self._connect)
        self._unsubscribe()

    @property
    def fed(self) -> bool:
        """True while the signal is sent in this process."""
        return self.subscription is None

    @property
    def senders(self) -> int:
        """Number of publishers, as `Publishers` counts them.

        Without a subscription they are counted now and then: that takes 8 us, and nothing of
        theirs is taken.
        """
        if self.subscription:
            return int(self._count())
        if (now := time.monotonic()) >= self._counted + RIVALS_PERIOD:
            self._counted, self._senders = now, self._node.count_publishers(self.name)
        return self._senders

    def take(self, unpack: Callable[[bytes], object] = bytes) -> list[tuple[bytes, int]]:
        """Return serialised messages and the times of their reception, system time in ns.

        Those that cannot be unpacked are refused.
        """
        return [
            (data, information["received_timestamp"])
            for data, information, _ in self._unpacked(unpack)
        ]

    def take_vectors(self) -> list[tuple[int, Vector]]:
        """Return stamps, system time in ns, and vectors of a signal."""
        return [vector for _, _, vector in self._unpacked(unpack_stamped_vector)]

    def take_states(self) -> list[bool]:
        """Return the values of a state."""
        return [state for _, _, state in self._unpacked(unpack_state)]

    def _connect(self, here: bool) -> None:
        """Leave the signal to the loop of this process, or subscribe to it."""
        if here:
            self._unsubscribe()
        elif not self.subscription:
            self._subscribe()

    def _subscribe(self) -> None:
        self.subscription = self._node.subscribe_raw(self._topic, _ignore, self._depth)
        self._node.unserved.add(self.subscription)
        self._take: Any = self.subscription.handle.take_message
        self._count: Any = self.subscription.handle.get_publisher_count
        self._type = self.subscription.msg_type

    def _unsubscribe(self) -> None:
        if self.subscription:
            self._node.unserved.discard(self.subscription)
            self._node.destroy_subscription(self.subscription)
            self.subscription = None

    def _unpacked(
        self, unpack: Callable[[bytes], Value]
    ) -> Iterator[tuple[bytes, dict[str, int], Value]]:
        """Yield data, information and value of what waits; refuse what cannot be unpacked."""
        while self.subscription and (taken := self._take(self._type, True)):
            data, information = taken
            try:
                value = unpack(data)
            except ValueError as error:
                self._node.refuse(self._topic, str(error))
            else:
                yield data, information, value


class Requests:
    """Requests to one service that wait until they are taken, and may be answered later.

    Parameters
    ----------
    service : Service
    guard : CallbackGuard
    """

    def __init__(self, service: Service, guard: CallbackGuard) -> None:
        self._service: Any = service
        self._guard = guard

    def take(self) -> Iterator[tuple[Any, Callable[[Any], None]]]:
        """Yield each request with the function to call with the response."""
        while (taken := self._next())[1] is not None:
            request, header = taken
            yield request, partial(self._service.send_response, header=header)

    def _next(self) -> tuple[Any, Any]:
        """Return the next request and its header; None for each if there is none."""
        try:
            found = self._service.handle.service_take_request(self._service.srv_type.Request)
        except Exception as error:
            self._guard.note(self._service.service_name, error)
            return None, None
        return tuple(found)


class Samples:
    """Samples of one signal, of which a `Succession` admits those that come in order and in time.

    There are none while the signal has several publishers: a message does not tell which of them
    it is from.

    Parameters
    ----------
    inbox : Inbox
    rate : float
        Samples per second.
    jumped : callable
        Called with these samples before the first one after a clock was set.

    Attributes
    ----------
    succession : Succession
    contested : int
        Samples refused because the signal had several publishers.
    """

    def __init__(self, inbox: Inbox, rate: float, jumped: Callable[[Samples], None]) -> None:
        self._inbox = inbox
        self.contested = 0
        self._jumped = jumped
        self._first = True
        self.succession = Succession(rate)

    def take(self) -> Iterator[tuple[int, Vector]]:
        """Yield stamps, system time in ns, and vectors."""
        now, steady = time.time_ns(), time.monotonic_ns()
        taken = self._inbox.take_vectors()
        # Counted after they are taken: who sent any of them is found by now.
        if taken and self._inbox.senders > 1:
            self.contested += len(taken)
            taken = []
        for stamp, vector in taken:
            if self.succession.admits(stamp, now, steady):
                if self.succession.jump:
                    self._jumped(self)
                yield stamp, vector
        if self._first:  # what came while the node started has waited: no fault of its sender
            self._first = False
            self.succession.outdated = 0


class GraphNode(SupervisedNode):
    """A node whose parameters come from its schema and whose topics from the topic table.

    Parameters
    ----------
    executable : str
        Name of the executable, and of the node unless remapped.
    changeable : collection of str
        Parameters that can be changed while the node runs.

    Attributes
    ----------
    task : str
        Subject of its diagnostics.
    parameters
        The node's own parameters, checked.
    options : dict
        Parameters of its possible parts (devices, controllers), by name.
    contested_in_loop : int
        Number of samples that the loop of this process did not pass on, as others published them.
    unserved : set of Subscription
        Subscriptions that the executor leaves alone: their messages are taken when needed.

    Raises
    ------
    ParameterError
        A parameter has a value that is not allowed.
    """

    task: str

    def __init__(self, executable: str, changeable: Collection[str] = ()) -> None:
        self.unserved: set[Subscription] = set()
        self._polled: set[Service] = set()
        self._claims: list[socket.socket] = []
        self._bundles: BundleSender | None = None
        self._malformed: Counter[str] = Counter()
        self._followed: list[Samples] = []
        self._sole: dict[str, Inbox | Publishers] = {}
        self._rivals: dict[str, str] = {}
        self.contested_in_loop = 0
        self._told: set[str] = set()
        self._refused_before: Counter[str] = Counter()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._guard = CallbackGuard(
            lambda line: self.get_logger().error(line), lambda text: self.get_logger().debug(text)
        )
        # Values of the command line and of files must be seen before they are
        # declared: a wrong name must not be lost, nor a wrong value be reported by ROS.
        super().__init__(executable, automatically_declare_parameters_from_overrides=True)
        self._schema = node_schema(executable)
        self._changeable = changeable
        given = self._given()
        self.parameters, self.options = node_parameters(executable, given)
        self._declare(given)
        self.add_on_set_parameters_callback(self._change)
        own = {
            SetParameters: self._serve_parameters,
            SetParametersAtomically: self._serve_parameters_atomically,
        }
        for service in super().services:
            service.callback = own.get(service.srv_type, service.callback)
        self._gathered = b""
        # As `publish` does, which asks first what it got.
        self._publish_diagnostics: Any = self.publisher(DIAGNOSTICS).handle.publish_raw
        # Each in its turn: together they take longer than a period has left.
        for part in (self._gather_diagnostics, self._report_gathered, self.repeat_states):
            self.create_timer(DIAGNOSTICS_PERIOD, part)

    def sender(self, topic: Topic) -> Sender:
        """Create the only sender of a signal on this machine.

        Raises
        ------
        ParameterError
            Another process sends it in the same ROS domain.
        """
        name = self.resolve_topic_name(topic.name)
        self._claims.append(claim_signal(self.context.get_domain_id(), name))
        if topic not in SIGNALS:
            return Sender(self, topic)
        # Found by others before the signal is, which shows them that the signal is in it.
        self._bundles = join(self, partial(self.publisher, BUNDLES, BUNDLES_KEPT))
        return Sender(self, topic, self._bundles)

    def listen(self, topic: Topic, callback: Callable[[int, Vector], None]) -> Subscription:
        """Subscribe to a signal; the callback gets stamps, system time in ns, and vectors."""
        return self._listen(topic, unpack_stamped_vector, lambda taken: callback(*taken))

    def inbox(self, topic: Topic, depth: int = DEPTH) -> Inbox:
        """Subscribe to a topic whose messages are taken when they are needed, the last `depth`."""
        return Inbox(self, topic, depth)

    def wire(self, topic: Topic) -> Wire:
        """Return the wire of a topic between the nodes of this process."""
        return WIRES.of(self.resolve_topic_name(topic.name))

    def requests(self, kind: Any, name: str) -> Requests:
        """Offer a service whose requests are taken when there is time for them."""
        service = self._guard.service(self.create_service(kind, name, _ignore))
        self._polled.add(service)
        return Requests(service, self._guard)

    def samples(self, topic: Topic, rate: float) -> Samples:
        """Subscribe to a signal whose samples are taken in order, when they are needed."""
        inbox = self.inbox(topic)
        self.watch_senders(topic, inbox)
        self._followed.append(Samples(inbox, rate, partial(self._on_jump, topic)))
        return self._followed[-1]

    def watch_senders(self, topic: Topic, inbox: Inbox | Publishers) -> None:
        """Warn while a topic whose samples are used has several publishers."""
        if not self._sole:
            self.create_timer(RIVALS_PERIOD, self._look_for_rivals)
        self._sole[topic.name] = inbox

    def rivals(self, *inboxes: Inbox | Publishers) -> str:
        """Return who publishes to inboxes unless it is one sender; then an empty text.

        Publishers count, not nodes, whose names anyone may take: one of each inbox by one node
        is one sender.
        """
        senders = [inbox.senders for inbox in inboxes]
        if sum(senders) < 2:
            return ""
        found = rivals(
            [
                Endpoint(name, _full_name(each), participant(each))
                for name in (inbox.name for inbox in inboxes)
                for each in self.get_publishers_info_by_topic(name)
            ]
        )
        # A publisher that is matched already may not be listed yet.
        return found or (f"{max(senders)} publishers" if max(senders) > 1 else "")

    @property
    def contested(self) -> set[str]:
        """Names of the topics whose samples are not taken, as several publish them."""
        return {name for name, who in self._rivals.items() if who}

    def publishers(self, *topics: str) -> list[str]:
        """Return the full names of the nodes that publish to topics."""
        found = [each for topic in topics for each in self.get_publishers_info_by_topic(topic)]
        return sorted(map(_full_name, found))

    def states(self, inbox: Inbox) -> list[bool]:
        """Return the values of a state: true by anyone, false by a publisher that is alone.

        Whoever plays a recording of it may stop, but must not release.
        """
        return [state for state in inbox.take_states() if state or inbox.senders < 2]

    # An executor asks these four for all that it serves, rclpy's own services included, so that
    # nothing gets past the guard.

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
        """Events of publishers and subscriptions, which wake the executor."""
        return (
            self._guard.guarded(each, "event of a topic") if hasattr(each, "callback") else each
            for each in super().waitables
        )

    def callback_failed(self, error: Exception) -> None:
        """Count and log what the executor raised: what taking a message does, for one."""
        self._guard.note("executor", error)

    def listen_state(self, topic: Topic, callback: Callable[[bool], None]) -> Subscription:
        """Subscribe to a latched state, true or false."""
        return self._listen(topic, unpack_state, callback)

    def create_timer(self, period: float, callback: Callable[[], object], **given: Any) -> Timer:
        """Create a timer of the steady clock: one of system time would wait if that is set back.

        Parameters
        ----------
        period : float
            Interval between calls, s.
        callback : callable
        **given
            As for rclpy's own.
        """
        return super().create_timer(period, callback, clock=self._steady, **given)

    def publisher(self, topic: Topic, depth: int = SENT) -> Publisher:
        """Create a topic's publisher, which keeps the last `depth` messages."""
        return self.create_publisher(
            message_type(topic), topic.name, offered_quality(topic, depth)
        )

    def subscribe_raw(
        self, topic: Topic, callback: Callable[[bytes], None], depth: int = DEPTH
    ) -> Subscription:
        """Subscribe to a topic's messages as they are serialised."""
        # A stop that is published without being kept is heard by another subscription: no warning.
        events = SubscriptionEventCallbacks(use_default_callbacks=not topic.latched)
        return self.create_subscription(
            message_type(topic),
            topic.name,
            callback,
            quality(topic, depth),
            event_callbacks=events,
            raw=True,
        )

    def refuse(self, topic: Topic, reason: str) -> None:
        """Count a malformed message; log the first of its topic."""
        self._malformed[topic.name] += 1
        if self._malformed[topic.name] == 1:
            self.get_logger().warning(f"{topic.name}: malformed message refused: {reason}")

    def start_anew(self) -> None:
        """Forget the samples that wait: a clock was set, and later ones have other stamps."""

    def say_farewell(self) -> None:
        """Publish the last diagnostics."""
        self.report()

    def destroy_node(self) -> None:
        """Destroy the node, with its last messages sent; its signals may have another sender."""
        if self._bundles:
            self._bundles.leave(self)
            self._bundles = None
        super().destroy_node()
        self.leave_signals()

    def leave_signals(self) -> None:
        """Let other nodes of this machine send the signals of this one."""
        for claimed in self._claims:
            claimed.close()

    def change(self, values: dict[str, Any]) -> None:
        """Apply new, checked values of parameters that can be changed; all or none.

        Raises
        ------
        ParameterError
            A value cannot be applied; nothing has changed.
        """

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; those that have the value already need not be changeable.

        The type of a value may be another one than its parameter's, as `_as_meant` has it.
        """
        try:
            new = [each for each in map(self._checked, parameter_list) if not self._holds(each)]
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return super().set_parameters_atomically(new)

    def _serve_parameters(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        """Set all parameters of a request or none, where rclpy would set those that it can."""
        response.results = [self._set(request.parameters)] * len(request.parameters)
        return response

    def _serve_parameters_atomically(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[ParameterMessage]) -> SetParametersResult:
        """Set the parameters of a request, all or none; whatever fails is the answer."""
        try:
            return self.set_parameters_atomically([_parameter(each) for each in messages])
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            reason = self._guard.note("set_parameters", error)
            return SetParametersResult(successful=False, reason=reason)

    def _checked(self, parameter: Parameter) -> Parameter:
        """Return a parameter with its value in the type that the schema demands."""
        name, value = parameter.name, parameter.value
        if name == USE_SIM_TIME:
            check_clock(value)
        if name in _OF_EVERY_NODE:
            return parameter
        if name not in self._schema:
            raise ParameterError(f"{shown(name)}: {self.get_name()} has no such parameter")
        default, specification = self._schema[name]
        value = _as_meant(value, default)
        return Parameter(name, value=checked(name, value, default, specification))

    def _holds(self, parameter: Parameter) -> bool:
        """Return whether a parameter has its value already; refuse another one of a fixed one."""
        value = self.get_parameter(parameter.name).value
        if parameter.value == value:
            return True
        if parameter.name in self._schema and parameter.name not in self._changeable:
            raise ParameterError(
                f"{parameter.name} = {parameter.value}: must stay {value} while the node runs"
            )
        return False

    def _change(self, parameters: list[Parameter]) -> SetParametersResult:
        """Apply new, checked values, or refuse them."""
        values = {each.name: each.value for each in parameters if each.name in self._changeable}
        try:
            if values:
                self.change(values)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def status(self) -> tuple[str, dict[str, str]]:
        """Return a warning, empty if all is well, and values with units for diagnostics."""
        return "", {}

    def report(self) -> None:
        """Publish the node's diagnostics, and what else is published once a second."""
        self._gather_diagnostics()
        self._report_gathered()
        self.repeat_states()

    def repeat_states(self) -> None:
        """Publish states again, for whoever relies on hearing of them."""

    def _report_gathered(self) -> None:
        """Publish the diagnostics that were gathered, each once."""
        if self._gathered:
            self._publish_diagnostics(self._gathered)
            self._gathered = b""

    def _gather_diagnostics(self) -> None:
        warning, values = self.status()
        contested = (f"{name}: {REFUSED} {who}" for name, who in self._rivals.items() if who)
        refused = self._refusals()
        new = refused - self._refused_before
        self._refused_before = refused
        counted = (f"{key}: {n}" for key, n in new.items())
        warning = ", ".join(filter(None, (warning, *contested, *counted)))
        counts = {key: str(count) for key, count in refused.items()}
        values = {"scheduling": scheduling_class(), **counts, **values}
        name = self.get_fully_qualified_name()
        self._gathered = pack_diagnostics(
            time.time_ns(),
            bool(warning),
            f"{name.lstrip('/')}: {self.task}",
            warning or "OK",
            name,
            values,
        )

    def _refusals(self) -> Counter[str]:
        """Return how many messages and requests were refused, by reason."""
        counts = Counter(
            {
                "messages malformed": self._malformed.total(),
                "callbacks failed": self._guard.failed.total(),
            }
        )
        if self._followed:
            counts["samples out of date"] = sum(s.succession.outdated for s in self._followed)
            contested = self.contested_in_loop + sum(s.contested for s in self._followed)
            counts["samples of several senders"] = contested
        return counts

    def _look_for_rivals(self) -> None:
        """Log once where a signal has several publishers, and once that it has one again."""
        for name, inbox in self._sole.items():
            found = self.rivals(inbox)
            # Who they are is known a moment after that there are several.
            settled = found == self._rivals.get(name, "")
            self._rivals[name] = found
            if settled and bool(found) != (name in self._told):
                self._told ^= {name}
                line = f"{REFUSED} {found}" if found else "taken again: it has one sender"
                self.get_logger().warning(f"{name}: {line}")

    def _on_jump(self, topic: Topic, jumped: Samples) -> None:
        """Let all signals begin anew, so that this is said once."""
        by = jumped.succession.jump
        self.get_logger().warning(f"{topic.name}: a clock was set by {by:+.3g} s; starting anew")
        for samples in self._followed:
            if samples is not jumped:
                samples.succession.begin()
        self.start_anew()

    def _listen(
        self, topic: Topic, unpack: Callable[[bytes], Value], callback: Callable[[Value], None]
    ) -> Subscription:
        """Subscribe to a topic's messages as they are unpacked."""

        def take(data: bytes) -> None:
            try:
                value = unpack(data)
            except ValueError as error:
                self.refuse(topic, str(error))
            else:
                callback(value)

        return self.subscribe_raw(topic, take)

    def _given(self) -> dict[str, Any]:
        """Return the values of the command line and of files, and undeclare them."""
        check_clock(self.get_parameter(USE_SIM_TIME).value)
        for path in _parameter_files():
            check_reached(path, self.get_fully_qualified_name())
        given = {
            name: parameter.value
            for name, parameter in self.get_parameters_by_prefix("").items()
            if name not in _OF_EVERY_NODE
        }
        for name in given:
            self.undeclare_parameter(name)
            # A file may give every node (/**) what only some of them have.
            if not any(name in node_schema(executable) for executable in NODES):
                raise ParameterError(f"{name}: no such parameter")
        return given

    def _declare(self, given: dict[str, Any]) -> None:
        """Declare all parameters with their descriptors and checked values.

        They are read-only but for those that can be changed while the node runs.
        """
        for name, (default, specification) in self._schema.items():
            value = checked(name, given.get(name, default), default, specification)
            descriptor = _descriptor(default, specification)
            descriptor.read_only = name not in self._changeable
            # ROS would take the value as given: 300 is no double to it.
            self.declare_parameter(name, value, descriptor, ignore_override=True)


def _parameter_files() -> Iterator[Path]:
    """Yield the parameter files of the command line, which ROS has read."""
    words, for_ros = iter(sys.argv[1:]), False
    for word in words:
        if word in ("--ros-args", "--"):
            for_ros = word == "--ros-args"
        elif for_ros and word == "--params-file":
            yield Path(next(words))


def _full_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node, which is known a moment after the endpoint."""
    if endpoint.node_name == _UNKNOWN:
        return "an unknown node"
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def _parameter(message: ParameterMessage) -> Parameter:
    """Return a parameter as it came in a request.

    Raises
    ------
    ParameterError
        Its type is unknown, or is not that of its value.
    """
    name, kind = shown(message.name), message.value.type
    try:
        return Parameter.from_parameter_msg(message)
    except (TypeError, ValueError):
        raise ParameterError(f"{name}: type = {kind}: must be one of 1 to 9") from None


def _ignore(*taken: Any) -> None:
    """Do nothing with a message or a request: it is taken when there is time."""


def _as_meant(value: Any, default: Any) -> Any:
    """Return a value as its file has it.

    ``ros2 param load`` passes on 9e-06 as text, and the text 0.6 as a number.
    """
    if isinstance(value, str) and isinstance(default, float):
        with suppress(ValueError):
            return read_decimal(value)
    if isinstance(value, (int, float)) and isinstance(default, str):
        return str(value)
    return value


def _descriptor(default: Any, specification: Specification) -> ParameterDescriptor:
    """Return a parameter's descriptor: text with unit and allowed values, and the range."""
    unit = f" [{specification.unit}]" if specification.unit else ""
    low, high = specification.low, specification.high
    descriptor = ParameterDescriptor(
        description=specification.text + unit,
        additional_constraints=allowed_values(default, specification),
    )
    if low is None and high is None:
        return descriptor
    whole = isinstance(default, int)
    kind, least, most = (int, 0, 2**63 - 1) if whole else (float, -_LARGEST, _LARGEST)
    low, high = kind(least if low is None else low), kind(most if high is None else high)
    if whole:
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


def message_type(topic: Topic) -> Any:
    """Import a topic's message class."""
    package, _, name = topic.type.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def quality(topic: Topic, depth: int = DEPTH) -> QoSProfile:
    """Return a subscriber's quality of service: signals as sensor data, events reliable."""
    reliability = ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT
    latched, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=depth, reliability=reliability, durability=latched if topic.latched else volatile
    )


def offered_quality(topic: Topic, depth: int = SENT) -> QoSProfile:
    """Return a publisher's quality of service: reliable, so for subscribers of both kinds."""
    return quality(replace(topic, reliable=True), 1 if topic.latched else depth)

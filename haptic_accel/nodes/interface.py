# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base of all nodes: checked parameters, topics by name, diagnostics."""

from __future__ import annotations

import importlib
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.subscription import Subscription

from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector, unpack_state
from haptic_accel.core.decimals import read_decimal
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import (
    ParameterError,
    Specification,
    allowed_values,
    checked,
)
from haptic_accel.core.succession import Succession
from haptic_accel.core.topics import DIAGNOSTICS, Topic
from haptic_accel.graph.claims import claim_signal
from haptic_accel.graph.files import check_reached
from haptic_accel.graph.node_parameters import (
    NODES,
    USE_SIM_TIME,
    check_clock,
    node_parameters,
    node_schema,
)
from haptic_accel.nodes.scheduling import SupervisedNode, scheduling_class

DIAGNOSTICS_PERIOD = 1.0
"""Interval between diagnostics, s."""

DEPTH = 1000
"""Number of messages kept for a subscriber: what comes in `CATCH_UP` at the highest rates."""

SENT = 10
"""Number of messages kept by a publisher."""

_OF_EVERY_NODE = (USE_SIM_TIME, "start_type_description_service")
"""Parameters that rclpy gives every node."""

_LARGEST = sys.float_info.max

Value = TypeVar("Value")


class Sender:
    """Publishes one signal of a node."""

    def __init__(self, node: GraphNode, topic: Topic) -> None:
        self._node, self._topic = node, topic
        self._pack = StampedVector(topic).pack
        self.offer()

    def offer(self) -> None:
        """Be a publisher of the topic, again after `withdraw`."""
        self._publisher = self._node.publisher(self._topic)
        # As `publish` does, which asks first what it got.
        self._publish: Any = self._publisher.handle.publish_raw

    def withdraw(self) -> None:
        """Leave the topic to others; nothing may be sent until `offer`."""
        self._node.destroy_publisher(self._publisher)

    def send(self, stamp: int, vector: Vector) -> None:
        """Publish a vector with a stamp, system time in ns."""
        self._publish(self._pack(stamp, vector))

    @property
    def listeners(self) -> int:
        """Number of subscribers found."""
        return int(self._publisher.get_subscription_count())


class Inbox:
    """Messages of one topic that wait until they are taken, and wake no process.

    Parameters
    ----------
    subscription : Subscription
    refuse : callable
        Called with the reason for each message that is malformed.

    Attributes
    ----------
    subscription : Subscription
    """

    def __init__(self, subscription: Subscription, refuse: Callable[[str], None]) -> None:
        self.subscription = subscription
        self._refuse = refuse
        self._take: Any = subscription.handle.take_message
        self._type = subscription.msg_type

    @property
    def senders(self) -> int:
        """Number of publishers found."""
        return int(self.subscription.get_publisher_count())

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

    def _unpacked(
        self, unpack: Callable[[bytes], Value]
    ) -> Iterator[tuple[bytes, dict[str, int], Value]]:
        """Yield data, information and value of what waits; refuse what cannot be unpacked."""
        while taken := self._take(self._type, True):
            data, information = taken
            try:
                value = unpack(data)
            except ValueError as error:
                self._refuse(str(error))
            else:
                yield data, information, value


class Requests:
    """Requests to one service that wait until they are taken, and may be answered later.

    Parameters
    ----------
    service : Service
    """

    def __init__(self, service: Service) -> None:
        self._service: Any = service

    def take(self) -> Iterator[tuple[Any, Callable[[Any], None]]]:
        """Yield each request with the function to call with the response."""
        kind = self._service.srv_type.Request
        while (taken := self._service.handle.service_take_request(kind))[1] is not None:
            request, header = taken
            yield request, partial(self._service.send_response, header=header)


class Samples:
    """Samples of one signal, of which a `Succession` admits those that come in order and in time.

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
    """

    def __init__(self, inbox: Inbox, rate: float, jumped: Callable[[Samples], None]) -> None:
        self._inbox = inbox
        self._jumped = jumped
        self._first = True
        self.succession = Succession(rate)

    def take(self) -> Iterator[tuple[int, Vector]]:
        """Yield stamps, system time in ns, and vectors."""
        now, steady = time.time_ns(), time.monotonic_ns()
        for stamp, vector in self._inbox.take_vectors():
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

    Raises
    ------
    ParameterError
        A parameter has a value that is not allowed.
    """

    task: str

    def __init__(self, executable: str, changeable: Collection[str] = ()) -> None:
        self._inboxes: set[Subscription] = set()
        self._polled: set[Service] = set()
        self._claims: list[socket.socket] = []
        self._malformed: Counter[str] = Counter()
        self._followed: list[Samples] = []
        self._refused_before: Counter[str] = Counter()
        super().__init__(
            executable,
            # Values of the command line and of files must be seen before they are
            # declared: a wrong name must not be lost, nor a wrong value be reported by ROS.
            allow_undeclared_parameters=True,
            automatically_declare_parameters_from_overrides=True,
        )
        self._schema = node_schema(executable)
        self._changeable = changeable
        given = self._given()
        self.parameters, self.options = node_parameters(executable, given)
        self._declare(given)
        self.add_on_set_parameters_callback(self._change)
        for service in self.services:
            if service.srv_type is SetParameters:
                service.callback = self._serve_parameters
        self._publish_diagnostics = self.publisher(DIAGNOSTICS).publish
        self.create_timer(DIAGNOSTICS_PERIOD, self.report)

    def sender(self, topic: Topic) -> Sender:
        """Create the only sender of a signal on this machine.

        Raises
        ------
        ParameterError
            Another process sends it in the same ROS domain.
        """
        name = self.resolve_topic_name(topic.name)
        self._claims.append(claim_signal(self.context.get_domain_id(), name))
        return Sender(self, topic)

    def listen(self, topic: Topic, callback: Callable[[int, Vector], None]) -> Subscription:
        """Subscribe to a signal; the callback gets stamps, system time in ns, and vectors."""
        return self._listen(topic, unpack_stamped_vector, lambda taken: callback(*taken))

    def inbox(self, topic: Topic, depth: int = DEPTH) -> Inbox:
        """Subscribe to a topic whose messages are taken when they are needed, the last `depth`."""
        subscription = self.subscribe_raw(topic, _ignore, depth)
        self._inboxes.add(subscription)
        return Inbox(subscription, partial(self.refuse, topic))

    def leave(self, inbox: Inbox) -> None:
        """Unsubscribe an inbox."""
        self._inboxes.discard(inbox.subscription)
        self.destroy_subscription(inbox.subscription)

    def requests(self, kind: Any, name: str) -> Requests:
        """Offer a service whose requests are taken when there is time for them."""
        service = self.create_service(kind, name, _ignore)
        self._polled.add(service)
        return Requests(service)

    def samples(self, topic: Topic, rate: float) -> Samples:
        """Subscribe to a signal whose samples are taken in order, when they are needed."""
        self._followed.append(Samples(self.inbox(topic), rate, partial(self._on_jump, topic)))
        return self._followed[-1]

    def rivals(self, *inboxes: Inbox) -> list[str]:
        """Return the full names of the nodes that publish to inboxes; none for a single one."""
        topics = [inbox.subscription.topic_name for inbox in inboxes]
        # To ask for names takes eight times as long.
        if sum(self.count_publishers(topic) for topic in topics) < 2:
            return []
        return self.publishers(*topics)

    def publishers(self, *topics: str) -> list[str]:
        """Return the full names of the nodes that publish to topics."""
        found = [each for topic in topics for each in self.get_publishers_info_by_topic(topic)]
        return sorted({f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found})

    def states(self, inbox: Inbox) -> list[bool]:
        """Return the values of a state: true by anyone, false by a node that alone says so.

        Whoever plays a recording of it may stop, but must not release.
        """
        return [state for state in inbox.take_states() if state or len(self.rivals(inbox)) < 2]

    @property
    def services(self) -> Iterator[Service]:
        """Services whose requests wake the executor."""
        return (each for each in super().services if each not in self._polled)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions whose messages wake the executor."""
        return (each for each in super().subscriptions if each not in self._inboxes)

    def listen_state(self, topic: Topic, callback: Callable[[bool], None]) -> Subscription:
        """Subscribe to a latched state, true or false."""
        return self._listen(topic, unpack_state, callback)

    def publisher(self, topic: Topic) -> Publisher:
        """Create a topic's publisher."""
        return self.create_publisher(message_type(topic), topic.name, offered_quality(topic))

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
        """Destroy the node; its signals may have another sender."""
        super().destroy_node()
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
        given = [Parameter.from_parameter_msg(message) for message in request.parameters]
        response.results = [self.set_parameters_atomically(given)] * len(given)
        return response

    def _checked(self, parameter: Parameter) -> Parameter:
        """Return a parameter with its value in the type that the schema demands."""
        name, value = parameter.name, parameter.value
        if name == USE_SIM_TIME:
            check_clock(value)
        if name in _OF_EVERY_NODE:
            return parameter
        if name not in self._schema:
            raise ParameterError(f"{name}: {self.get_name()} has no such parameter")
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
        """Publish the node's diagnostics."""
        warning, values = self.status()
        refused = self._refusals()
        new = refused - self._refused_before
        self._refused_before = refused
        warning = ", ".join(filter(None, (warning, *(f"{key}: {n}" for key, n in new.items()))))
        counts = {key: str(count) for key, count in refused.items()}
        values = {"scheduling": scheduling_class(), **counts, **values}
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if warning else DiagnosticStatus.OK,
            name=f"{self.get_fully_qualified_name().lstrip('/')}: {self.task}",
            message=warning or "OK",
            hardware_id=self.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._publish_diagnostics(array)

    def _refusals(self) -> Counter[str]:
        """Return how many messages were refused, by reason."""
        counts = Counter({"messages malformed": self._malformed.total()})
        if self._followed:
            counts["samples out of date"] = sum(s.succession.outdated for s in self._followed)
        return counts

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


def offered_quality(topic: Topic) -> QoSProfile:
    """Return a publisher's quality of service: reliable, so for subscribers of both kinds."""
    return quality(replace(topic, reliable=True), 1 if topic.latched else SENT)

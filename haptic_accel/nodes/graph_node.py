# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base of all nodes: signals, their publishers, and diagnostics."""

from __future__ import annotations

import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.topic_endpoint_info import TopicEndpointInfo

from haptic_accel.bags.trial_metadata import description
from haptic_accel.core.cdr import pack_diagnostics
from haptic_accel.core.parameters import (
    ParameterError,
    Specification,
    allowed_values,
    checked,
    read_decimal,
    shown,
)
from haptic_accel.core.tick import TICK
from haptic_accel.core.topics import BUNDLES, DESCRIPTION, DIAGNOSTICS, SIGNALS, Topic
from haptic_accel.devices.rclpy_internals import TAKES, bytes_publisher
from haptic_accel.graph.domain import lock_signal
from haptic_accel.nodes import signals
from haptic_accel.nodes.supervised_node import DEPTH, SupervisedNode, message_type
from haptic_accel.nodes.timing import scheduling_class
from haptic_accel.setup import node_parameters
from haptic_accel.setup.files import FORMER, check_reached, present_values
from haptic_accel.setup.node_parameters import NODES, USE_SIM_TIME, check_clock, node_schema

_OF_EVERY_NODE = (USE_SIM_TIME, "start_type_description_service")
"""Parameters that rclpy gives every node."""

Changeable: TypeAlias = Callable[[Any], Collection[str]]
"""Function that returns, for a node's own parameters, those that can be changed while it runs."""

_LARGEST = sys.float_info.max


class DeclaredParameters:
    """Parameters of a node, declared from its schema, with options of its devices.

    Parameters
    ----------
    node : Node
        Node that has declared the values of command line and files.
    executable : str
        Key of the schema.
    changeable : Changeable
    change : callable
        Applies new, checked values of changeable parameters by name, or raises a ParameterError.
    note : callable
        Records an exception of the named callback; returns it in one line.

    Attributes
    ----------
    own
        The node's own parameters, checked.
    options : dict
        Parameters of the node's optional parts (devices, controllers), by name.
    schema : mapping
        Default and specification of the declared parameters, by dotted name.

    Raises
    ------
    ParameterError
        A parameter has a value that is not allowed.
    """

    def __init__(
        self,
        node: Node,
        executable: str,
        changeable: Changeable,
        change: Callable[[dict[str, Any]], None],
        note: Callable[[str, Exception], str],
    ) -> None:
        self._node, self._apply, self._note = node, change, note
        values = self._overrides()
        self.own, self.options = node_parameters.build_parameters(executable, values)
        self.schema = node_parameters.declared_schema(executable, self.own)
        self._others = node_schema(executable).keys() - self.schema
        self._changeable = changeable(self.own)
        self._declare(values)
        node.add_on_set_parameters_callback(self._change)

    @property
    def services(self) -> dict[type, Callable[..., Any]]:
        """Callbacks of the services that replace rclpy's, by service type."""
        return {
            GetParameters: self._serve_values,
            SetParameters: self._serve,
            SetParametersAtomically: self._serve_atomically,
        }

    def new(self, parameters: Iterable[Parameter]) -> list[Parameter]:
        """Return the parameters with changed values, in the types of the schema.

        Raises
        ------
        ParameterError
            A value is not allowed, or its parameter is fixed.
        """
        return [each for each in map(self._checked, parameters) if not self._holds(each)]

    def _serve_values(self, request: Any, response: Any) -> Any:
        """Return a value for each name, unset if unknown; rclpy would return none at all."""
        found = (self._node.get_parameter_or(name, Parameter(name)) for name in request.names)
        response.values = [each.get_parameter_value() for each in found]
        return response

    def _serve(self, request: Any, response: Any) -> Any:
        """Set all parameters of a request or none; rclpy would set the valid ones."""
        response.results = [self._set(request.parameters)] * len(request.parameters)
        return response

    def _serve_atomically(self, request: Any, response: Any) -> Any:
        """Set all parameters of a request or none."""
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[ParameterMessage]) -> SetParametersResult:
        """Set the parameters of a request, all or none; the result holds any failure."""
        try:
            return self._node.set_parameters_atomically([_parameter(each) for each in messages])
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            reason = self._note("set_parameters", error)
            return SetParametersResult(successful=False, reason=reason)

    def _checked(self, parameter: Parameter) -> Parameter:
        """Return a parameter with its value in the type of the schema."""
        name, value = parameter.name, parameter.value
        if name == USE_SIM_TIME:
            check_clock(value)
        if name in _OF_EVERY_NODE:
            return parameter
        if name not in self.schema:
            lacks = f"{self._node.get_name()} has no such parameter"
            why = f"the device is {self.own.device}" if name in self._others else lacks
            raise ParameterError(f"{shown(name)}: {why}")
        default, specification = self.schema[name]
        value = _as_meant(value, default)
        return Parameter(name, value=checked(name, value, default, specification))

    def _holds(self, parameter: Parameter) -> bool:
        """Return whether a parameter has its value already; refuse to change a fixed one."""
        value = self._node.get_parameter(parameter.name).value
        if parameter.value == value:
            return True
        if parameter.name in self.schema and parameter.name not in self._changeable:
            raise ParameterError(
                f"{parameter.name} = {parameter.value}: must stay {value} while the node runs"
            )
        return False

    def _change(self, parameters: list[Parameter]) -> SetParametersResult:
        """Apply new, checked values, or refuse them."""
        values = {each.name: each.value for each in parameters if each.name in self._changeable}
        try:
            if values:
                self._apply(values)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _overrides(self) -> dict[str, Any]:
        """Return the values of the command line and of files, and undeclare them."""
        check_clock(self._node.get_parameter(USE_SIM_TIME).value)
        for path in _parameter_files():
            check_reached(path, self._node.get_fully_qualified_name())
        values = {
            name: parameter.value
            for name, parameter in self._node.get_parameters_by_prefix("").items()
            if name not in _OF_EVERY_NODE
        }
        for name in values:
            self._node.undeclare_parameter(name)
            # A file may set parameters in all nodes (/**) that only some nodes have.
            if not any(name in {*node_schema(each), *FORMER.get(each, ())} for each in NODES):
                raise ParameterError(f"{name}: no such parameter")
        return present_values(values, values.get("rate"), self._node.get_logger().warning)

    def _declare(self, values: dict[str, Any]) -> None:
        """Declare all parameters with their descriptors and checked values.

        All are read-only except those that can be changed while the node runs.
        """
        for name, (default, specification) in self.schema.items():
            value = checked(name, values.get(name, default), default, specification)
            descriptor = _descriptor(default, specification)
            descriptor.read_only = name not in self._changeable
            # ROS would take the override's own type: an integer such as 300 is no double.
            self._node.declare_parameter(name, value, descriptor, ignore_override=True)


def _parameter_files() -> Iterator[Path]:
    """Yield the parameter files of the command line, which ROS has read."""
    texts, for_ros = iter(sys.argv[1:]), False
    for text in texts:
        if text in ("--ros-args", "--"):
            for_ros = text == "--ros-args"
        elif for_ros and text == "--params-file":
            yield Path(next(texts))


def _parameter(message: ParameterMessage) -> Parameter:
    """Return the parameter in a request's message.

    Raises
    ------
    ParameterError
        The type is unknown, or differs from the value's type.
    """
    name, kind = shown(message.name), message.value.type
    try:
        return Parameter.from_parameter_msg(message)
    except (TypeError, ValueError):
        raise ParameterError(f"{name}: type = {kind}: must be one of 1 to 9") from None


def _as_meant(value: Any, default: Any) -> Any:
    """Convert a value to the type that it has in the parameter file.

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


DIAGNOSTICS_PERIOD = 1.0
"""Interval between diagnostics, s."""

REFUSED = "no sample taken while it is sent by"
"""Warning for a signal with several publishers, before their names."""

_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Placeholder of ROS for the name of a node that it has not discovered yet."""


class GraphNode(SupervisedNode):
    """Node of the graph: sole sender of its signals, with a diagnostic report each second.

    Parameters
    ----------
    executable : str
        Name of the executable, and of the node unless remapped.
    changeable : Changeable

    Attributes
    ----------
    parameters
        The node's own parameters, checked.
    options : dict
        Parameters of the node's optional parts (devices, controllers), by name.
    task : str
        Subject of its diagnostics.
    contested_in_loop : int
        Number of samples that this process's loop withheld because other nodes sent the signal.

    Raises
    ------
    ParameterError
        A parameter has a value that is not allowed.
    """

    task: str

    def __init__(self, executable: str, changeable: Changeable = lambda _: ()) -> None:
        self._locks: list[socket.socket] = []
        self._bundles: signals.BundleSender | None = None
        self._followed: list[signals.Samples] = []
        self._sole: dict[str, signals.Inbox | signals.Publishers] = {}
        self._rivals: dict[str, str] = {}
        self.contested_in_loop = 0
        self._warned: set[str] = set()
        self._refused_before: Counter[str] = Counter()
        # Check the values of command line and files before declaration: ROS would ignore a wrong
        # name, and report a wrong value less clearly.
        super().__init__(executable, automatically_declare_parameters_from_overrides=True)
        note = self._guard.note
        self._declared = DeclaredParameters(self, executable, changeable, self.change, note)
        self.parameters, self.options = self._declared.own, self._declared.options
        for kind, callback in self._declared.services.items():
            self.replace_service(kind, callback)
        self._gathered = b""
        self._described = {name: self.get_parameter(name).value for name in self._declared.schema}
        self._publish_description = self.publisher(DESCRIPTION).publish
        self.add_post_set_parameters_callback(self._publish_parameters)
        self._publish_parameters(())
        self._publish_diagnostics = bytes_publisher(self.publisher(DIAGNOSTICS))
        # Take turns: all parts at once take longer than the rest of a period. One timer keeps the
        # order; the executor serves several due timers in any order.
        parts = (self._gather_diagnostics, self._report_gathered, self.repeat_states)
        turns = cycle(parts)
        self.create_timer(DIAGNOSTICS_PERIOD / len(parts), lambda: next(turns)())

    def change(self, values: dict[str, Any]) -> None:
        """Apply new, checked values of parameters that can be changed; all or none.

        Raises
        ------
        ParameterError
            A value cannot be applied; nothing has changed.
        """

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; a fixed parameter may be set to its present value."""
        try:
            new = self._declared.new(parameter_list)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return super().set_parameters_atomically(new)

    def sender(self, topic: Topic) -> signals.Sender:
        """Create the only sender of a signal on this machine.

        Raises
        ------
        ParameterError
            Another process sends it in the same ROS domain.
        """
        name = self.resolve_topic_name(topic.name)
        self._locks.append(lock_signal(self.context.get_domain_id(), name))
        if topic not in SIGNALS:
            return signals.Sender(self, topic)
        # Create the bundles first: other nodes must discover them before the signal in them.
        self._bundles = signals.join(self, partial(self.publisher, BUNDLES, signals.BUNDLES_KEPT))
        return signals.Sender(self, topic, self._bundles)

    def inbox(self, topic: Topic, depth: int = DEPTH) -> signals.Inbox:
        """Subscribe to a topic whose last `depth` messages are read when needed."""
        return signals.Inbox(self, topic, depth)

    def requests(self, kind: Any, name: str) -> signals.Requests:
        """Offer a service whose requests wait until the node has time for them."""
        service = self._guard.service(self.create_service(kind, name, signals.ignore))
        if TAKES:
            self._polled.add(service)
        return signals.Requests(service, self._guard)

    def samples(self, topic: Topic, rate: float) -> signals.Samples:
        """Subscribe to a signal whose samples are read in order, when needed."""
        inbox = self.inbox(topic)
        self.watch_senders(topic, inbox)
        self._followed.append(signals.Samples(inbox, rate, partial(self._on_jump, topic)))
        return self._followed[-1]

    def watch_senders(self, topic: Topic, inbox: signals.Inbox | signals.Publishers) -> None:
        """Warn while a topic whose samples are used has several publishers."""
        if not self._sole:
            self.create_timer(signals.RIVALS_PERIOD, self._check_rivals)
        self._sole[topic.name] = inbox

    def rivals(self, *inboxes: signals.Inbox | signals.Publishers) -> str:
        """Return the senders to inboxes if there are several; otherwise an empty text.

        Publishers are counted because node names are not unique. A node with one publisher per
        inbox counts as one sender.
        """
        senders = [inbox.senders for inbox in inboxes]
        if sum(senders) < 2:
            return ""
        listed = [
            Endpoint(name, _full_name(each), signals.participant(each))
            for name in (inbox.name for inbox in inboxes)
            for each in self.get_publishers_info_by_topic(name)
        ]
        found = rivals(listed)
        # Publishers that are already matched may not be listed yet.
        return found or (f"{sum(senders)} publishers" if len(listed) < sum(senders) else "")

    @property
    def contested(self) -> set[str]:
        """Names of the topics whose samples are refused because several nodes publish them."""
        return {name for name, who in self._rivals.items() if who}

    def publishers(self, *topics: str) -> list[str]:
        """Return the full names of the nodes that publish to topics."""
        found = [each for topic in topics for each in self.get_publishers_info_by_topic(topic)]
        return sorted(map(_full_name, found))

    def states(self, inbox: signals.Inbox) -> list[bool]:
        """Return values of a state: true from any publisher, false from a sole publisher.

        A bag being played may stop the graph, but must not release the stop.
        """
        return [state for state in inbox.drain_states() if state or inbox.sole]

    def start_again(self) -> None:
        """Discard the waiting samples, whose stamps are invalid after a change of the clock."""

    def publish_final_diagnostics(self) -> None:
        """Publish the final diagnostics."""
        self.report()

    def destroy_node(self) -> None:
        """Send the last messages and destroy the node; others may then send its signals."""
        if self._bundles:
            self._bundles.leave(self)
            self._bundles = None
        super().destroy_node()
        self.leave_signals()

    def leave_signals(self) -> None:
        """Release this node's locks on signals, for other nodes of this machine."""
        for lock in self._locks:
            lock.close()

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return a warning, empty if all is well, and values with units for diagnostics."""
        return "", {}

    def report(self) -> None:
        """Publish all that the node publishes once a second, such as diagnostics."""
        self._report_gathered()  # report its warnings, which later reports lack
        self._gather_diagnostics()
        self._report_gathered()
        self.repeat_states()

    def repeat_states(self) -> None:
        """Publish latched states again, for subscribers without their history."""

    def _publish_parameters(self, changed: Sequence[Parameter]) -> None:
        """Publish all parameters, with their values after a change, for any recorder."""
        self._described |= {each.name: each.value for each in changed}
        text = description(self.get_name(), self._described)
        self._publish_description(message_type(DESCRIPTION)(data=text))

    def _report_gathered(self) -> None:
        """Publish each set of gathered diagnostics once."""
        if self._gathered:
            self._publish_diagnostics(self._gathered)
            self._gathered = b""

    def _gather_diagnostics(self) -> None:
        warning, values = self.diagnostics()
        contested = (f"{name}: {REFUSED} {who}" for name, who in self._rivals.items() if who)
        refused = self._refusals()
        new = refused - self._refused_before
        self._refused_before = refused
        changes = (f"{key}: {n}" for key, n in new.items())
        warning = ", ".join(filter(None, (warning, *contested, *changes)))
        counts = {key: str(count) for key, count in refused.items()}
        values = {"scheduling": scheduling_class(), "tick": TICK, **counts, **values}
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
        """Return the numbers of refused messages and requests by reason."""
        counts: Counter[str] = Counter()
        counts["messages malformed"] = self._malformed.total()
        counts["callbacks failed"] = self._guard.failed.total()
        if self._followed:
            counts["samples out of date"] = sum(s.sequence.outdated for s in self._followed)
            contested = self.contested_in_loop + sum(s.contested for s in self._followed)
            counts["samples of several senders"] = contested
        return counts

    def _check_rivals(self) -> None:
        """Log once when a signal gets several publishers, and once when it is back to one."""
        for name, inbox in self._sole.items():
            found = self.rivals(inbox)
            # The names of publishers are discovered shortly after their number.
            settled = found == self._rivals.get(name, "")
            self._rivals[name] = found
            if settled and bool(found) != (name in self._warned):
                self._warned ^= {name}
                line = f"{REFUSED} {found}" if found else "taken again: it has one sender"
                self.get_logger().warning(f"{name}: {line}")

    def _on_jump(self, topic: Topic, jumped: signals.Samples) -> None:
        """Restart the sequence checks of all signals, so that the change is reported once."""
        by = jumped.sequence.jump
        self.get_logger().warning(f"{topic.name}: a clock was set by {by:+.3g} s; starting again")
        for samples in self._followed:
            if samples is not jumped:
                samples.sequence.begin()
        self.start_again()


def _full_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node, discovered shortly after the endpoint."""
    if endpoint.node_name == _UNKNOWN:
        return "an unknown node"
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


class Endpoint(NamedTuple):
    """Publisher of a topic.

    Attributes
    ----------
    topic : str
    node : str
        Full name of the publisher's node, not necessarily unique.
    participant : bytes
        Globally unique identifier of the publisher's process.
    """

    topic: str
    node: str
    participant: bytes


def rivals(endpoints: Sequence[Endpoint]) -> str:
    """Return the names of the publishers if they belong to several senders; otherwise "".

    One node may have one publisher per topic.

    Examples
    --------
    >>> one = Endpoint("/slave/servo_cf", "/coupler", b"1")
    >>> rivals([one, one._replace(topic="/slave/servo_cp")])
    ''
    >>> rivals([one, one._replace(participant=b"2")])
    '/coupler (2 publishers)'
    >>> rivals([one, Endpoint("/slave/servo_cf", "/evil", b"2")])
    '/coupler and /evil'
    """
    topics = Counter(each.topic for each in endpoints)
    senders = {(each.participant, each.node) for each in endpoints}
    if len(senders) < 2 and max(topics.values(), default=0) < 2:
        return ""
    nodes = sorted(Counter(each.node for each in endpoints).items())
    return " and ".join(f"{name} ({n} publishers)" if n > 1 else name for name, n in nodes)

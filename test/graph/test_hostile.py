# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hostile requests, messages and events to every node: none ends, all answer, forces flow on.

`pytest --fuzz 100000 test/graph/test_hostile.py` sends as many.
"""

from __future__ import annotations

import importlib
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from lifecycle_msgs.srv import ChangeState
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool, Trigger

from fuzzing import ODD_TEXTS, mutated
from haptic_accel.core.outside import node_module
from haptic_accel.core.topics import ACTUATOR_FORCE, MASTER_ARM_FORCE, SLAVE_ARM_FORCE
from haptic_accel.devices.rclpy_internals import EventsExecutor
from haptic_accel.nodes.supervised_node import message_type, quality
from haptic_accel.setup.node_parameters import NODES, node_schema
from observing import Observer
from running import PATIENCE, Command, Start

FORCES = (MASTER_ARM_FORCE, SLAVE_ARM_FORCE, ACTUATOR_FORCE)

BATCH = 50
"""Requests and messages that are sent together, after which everything is looked at."""

REQUESTS_KEPT = 10
"""Requests that the middleware keeps for a service that is held up (depth of ROS' default profile
of services); of more, the oldest are lost."""

ANEW = 0.2
"""Interval between attempts to let forces flow again, s, after what stopped them on purpose."""

FLOWING = 5
"""Messages of each force after which forces flow."""

ENDS = ("shutdown", "destroy")
"""Parts of the labels of transitions that end a node as they should."""

ENDING = range(5, 9)
"""Numbers of these transitions."""

OWN = ("/observer/", "/rosout", "/parameter_events")

KNOWN = sorted({name for node in NODES for name in node_schema(node)})
LABELS = ("configure", "activate", "deactivate", "cleanup", "create", "transition_success")
TEXTS = st.sampled_from((*ODD_TEXTS, *KNOWN, *LABELS, "use_sim_time", "/", "~/x", "x" * 60_000))
INTEGERS = re.compile(r"(u?)int(8|16|32|64)$")
KINDS: dict[str, st.SearchStrategy[Any]] = {
    "boolean": st.booleans(),
    "octet": st.binary(min_size=1, max_size=1),
    "char": st.integers(0, 255),
    "byte": st.integers(0, 255),
    "float": st.floats(width=32),
    "double": st.floats() | st.sampled_from([0.0, 1e308]),
    "string": TEXTS,
    "wstring": TEXTS,
}


def imported(kind: str) -> Any:
    """Return the class of a type, as package/msg/Name or package/Name."""
    package, *group, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.{group[0] if group else 'msg'}"), name)


@cache
def values(kind: str) -> st.SearchStrategy[Any]:
    """Return the values that a field may have."""
    if array := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        length = int(array[2])
        return st.lists(values(array[1]), min_size=length, max_size=length)
    if sequence := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind):
        return st.lists(values(sequence[1]), max_size=min(3, int(sequence[2] or 3)))
    if integer := INTEGERS.fullmatch(kind):
        bits, unsigned = int(integer[2]), bool(integer[1])
        low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return st.integers(low, min(high, 12)) | st.sampled_from([low, high, 99 % (high + 1)])
    return KINDS[kind] if kind in KINDS else contents(imported(kind))


@cache
def contents(kind: Any) -> st.SearchStrategy[Any]:
    """Return messages of a type with anything that they can carry."""
    fields = kind.get_fields_and_field_types()
    return st.fixed_dictionaries({name: values(of) for name, of in fields.items()}).map(
        lambda given: kind(**given)
    )


class Hostile:
    """A node that sends to all others.

    Attributes
    ----------
    services, topics : dict
        Types by name.
    sent : int
        Number of requests and messages.
    """

    def __init__(self, observer: Observer, nodes: list[Command]) -> None:
        self._node, self._nodes = observer.node, nodes
        self._executor = EventsExecutor(context=observer.context)
        self._executor.add_node(self._node)
        self._forces = {topic.name: 0 for topic in FORCES}
        for topic in FORCES:
            self._node.create_subscription(
                message_type(topic),
                topic.name,
                lambda _, name=topic.name: self._count(name),
                quality(topic, depth=10),
                raw=True,
            )
        self._clients: dict[str, Any] = {}
        self.services: dict[str, Any] = {}
        self.topics: dict[str, Any] = {}
        self.sent = 0

    def look_round(self, *nodes: str) -> None:
        """Find all services and topics, also of nodes that may have just begun."""

        def found() -> bool:
            named = self._node.get_node_names_and_namespaces()
            return {*nodes} <= {f"{space.rstrip('/')}/{name}" for name, space in named}

        self.until(found, f"all of {nodes}")
        for name, (kind, *_) in self._node.get_service_names_and_types():
            if not name.startswith(OWN) and self._node.count_services(name):
                self.services[name] = imported(kind)
                self._client(self.services[name], name)
        clients = [self._clients[name] for name in self.services]
        self.until(lambda: all(each.service_is_ready() for each in clients), "all services")
        for name, (kind, *_) in self._node.get_topic_names_and_types():
            self.topics[name] = imported(kind)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for something while no node ends."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"not in {PATIENCE:g} s: {what}"
            self._executor.spin_once(timeout_sec=0.01)
            for node in self._nodes:
                assert node.process.poll() is None, node.text

    def ask(self, requests: list[tuple[str, Any]]) -> None:
        """Send requests, as many at once as a service keeps; wait until all are answered."""
        of = dict[str, list[Any]]()
        for name, request in requests:
            of.setdefault(name, []).append(request)
        for first in range(0, max(map(len, of.values()), default=0), REQUESTS_KEPT):
            kept = slice(first, first + REQUESTS_KEPT)
            self._ask_at_once([(name, request) for name in of for request in of[name][kept]])
        self.sent += len(requests)

    def _ask_at_once(self, requests: list[tuple[str, Any]]) -> None:
        asked = [(name, self._clients[name].call_async(request)) for name, request in requests]
        self.until(lambda: all(each.done() for _, each in asked), str([name for name, _ in asked]))

    def tell(self, name: str, messages: list[bytes]) -> None:
        """Publish messages as they are serialised, to whoever subscribes, and leave."""
        profile = QoSProfile(depth=len(messages), reliability=ReliabilityPolicy.RELIABLE)
        publisher = self._node.create_publisher(self.topics[name], name, profile)
        if self._node.count_subscribers(name):
            deadline = time.monotonic() + 0.2  # some want what is kept, which this is not
            self.until(
                lambda: publisher.get_subscription_count() > 0 or time.monotonic() > deadline,
                f"a subscriber of {name}",
            )
        for message in messages:
            with suppress(RuntimeError):  # the middleware refuses to send some
                publisher.publish(message)
        self.sent += len(messages)
        self._executor.spin_once(timeout_sec=0.005)
        self._node.destroy_publisher(publisher)

    def let_forces_flow(self) -> None:
        """Wait for forces; undo what stops them on purpose, as a person would."""
        enough = {name: count + FLOWING for name, count in self._forces.items()}
        due = time.monotonic() + ANEW

        def flowing() -> bool:
            nonlocal due
            if all(self._forces[name] >= count for name, count in enough.items()):
                return True
            if time.monotonic() >= due:
                due = time.monotonic() + ANEW
                self._undo()
            return False

        self.until(flowing, f"forces flow: {self._forces} of {enough}")

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()

    def _undo(self) -> None:
        for device in ("master_device", "slave_device"):
            for label in ("configure", "activate"):
                request = ChangeState.Request()
                request.transition.label = label
                self._client(ChangeState, f"/{device}/change_state").call_async(request)
            self._client(Trigger, f"/{device}/arm").call_async(Trigger.Request())
        self._client(SetBool, "/estop").call_async(SetBool.Request(data=False))
        self._client(SetBool, "/coupler/engage").call_async(SetBool.Request(data=True))

    def _client(self, kind: Any, name: str) -> Any:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        return self._clients[name]

    def _count(self, name: str) -> None:
        self._forces[name] += 1


def harmless(service: str, request: Any) -> bool:
    """Return whether a request does not ask a node to end."""
    if not service.endswith("/change_state"):
        return True
    wanted = request.transition
    return wanted.id not in ENDING and not any(word in wanted.label for word in ENDS)


@pytest.fixture
def hostile(haptic_accel: Start, start: Start, observer: Observer) -> Iterator[Hostile]:
    """Start every node there is, and one that is hostile to them."""
    words = ("bag:=bag", "scope:=true", "scope_port:=0", "rate:=250")
    graph = haptic_accel("teleop", *words)
    graph.wait_for("engaged")
    others = [
        start("-m", node_module(name), "--ros-args", "-r", f"__ns:=/{name}", *words)
        for name, words in {"half_coupler": ("-p", "side:=master"), "restamper": ()}.items()
    ]
    hostile = Hostile(observer, [graph, *others])
    hostile.let_forces_flow()
    hostile.look_round("/half_coupler/coupler", "/restamper/restamper", "/scope", "/recorder")
    yield hostile
    hostile.let_forces_flow()
    hostile.close()
    print(f"{hostile.sent} requests and messages")
    assert "Traceback" not in graph.text, graph.text
    assert graph.end(signal.SIGINT) == 0, graph.text


@pytest.mark.fuzz
@settings(
    settings.get_profile("fuzz"),
    max_examples=max(1, settings.get_profile("fuzz").max_examples // BATCH),
    phases=[Phase.generate],  # what has ended does not come back for a shorter example
)
@given(st.data())
def test_nothing_that_is_sent_ends_a_node(hostile: Hostile, data: st.DataObject) -> None:
    services, topics = sorted(hostile.services), sorted(hostile.topics)
    requests = []
    for name in data.draw(
        st.lists(st.sampled_from(services), min_size=BATCH // 2, max_size=BATCH)
    ):
        request = data.draw(contents(hostile.services[name].Request))
        if harmless(name, request):
            requests.append((name, request))
    for name in data.draw(st.lists(st.sampled_from(topics), max_size=2)):
        messages = contents(hostile.topics[name]).map(serialize_message)
        garbage = mutated(
            messages, st.sampled_from([b"\0", b"\xff" * 4, b"\x80", b"\xed\xa0\x80"])
        )
        hostile.tell(name, data.draw(st.lists(messages | garbage, min_size=5, max_size=12)))
    hostile.ask(requests)
    hostile.let_forces_flow()

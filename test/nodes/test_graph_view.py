# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter events and diagnostics that the scope takes, whoever sends them."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.task import Future

from fuzzing import ODD_TEXTS, fuzz
from haptic_accel.nodes.graph_view import NEEDED, RemoteParameters, admitted
from haptic_accel.scope.server import as_json
from haptic_accel.scope.state import EXPECTED, NodeReport, NodeReports, state_of
from haptic_accel.scope.windows import GraphSettings
from haptic_accel.setup.node_parameters import node_schema

TEXT = ParameterType.PARAMETER_STRING
NUMBER = ParameterType.PARAMETER_DOUBLE
NAN = ParameterValue(type=NUMBER, double_value=float("nan"))
BYTES = ParameterValue(type=ParameterType.PARAMETER_BYTE_ARRAY, byte_array_value=[b"\xff"])
NO_TYPE = ParameterValue(type=99)
HOSTILE = {"nan": NAN, "bytes": BYTES, "no type": NO_TYPE}

LONGEST_CASE = 1.0
"""Longest processor time of a sequence of events, s: each takes a hundredth of a millisecond."""


class Client:
    """Client of a node that answers at once, and may be gone."""

    def __init__(self) -> None:
        self.ready = True
        self.answer: list[ParameterValue] = []
        self.asked = 0

    def service_is_ready(self) -> bool:
        return self.ready

    def call_async(self, request: GetParameters.Request) -> Future:
        self.asked += 1
        future: Future = Future()
        future.set_result(GetParameters.Response(values=self.answer))
        return future


class Asking:
    """Node that only asks another for its parameters."""

    def __init__(self) -> None:
        self.client = Client()

    def get_namespace(self) -> str:
        return "/left"

    def create_client(self, kind: Any, name: str) -> Client:
        return self.client


class Followed:
    """Parameters of a node, with what happened to them; asked once if it is told its values."""

    def __init__(self, name: str = "compensator", **values: ParameterValue) -> None:
        self.node = Asking()
        self.changes = 0
        self.refused: list[str] = []
        node: Any = self.node
        self.remote = RemoteParameters(node, name, NEEDED[name], self._count, self.refused.append)
        if values:  # and no others
            unset = ParameterValue(type=ParameterType.PARAMETER_NOT_SET)
            self.client.answer = [values.get(each, unset) for each in NEEDED[name]]
            self.remote.refresh()

    def _count(self) -> None:
        self.changes += 1

    @property
    def client(self) -> Client:
        return self.node.client

    def receive(self, **values: ParameterValue) -> None:
        given = [Parameter(name=name, value=value) for name, value in values.items()]
        self.remote.receive(ParameterEvent(node=self.remote.path, changed_parameters=given))


def text(value: str) -> ParameterValue:
    return ParameterValue(type=TEXT, string_value=value)


@pytest.mark.parametrize("value", HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("name", ["controller", "actuator.peak_force"])
def test_a_value_that_a_parameter_cannot_have_is_refused_in_one_line(
    name: str, value: ParameterValue
) -> None:
    known, refused = admitted("compensator", NEEDED["compensator"], [(name, value)])
    assert known == {}
    (line,) = refused
    assert line.startswith(f"compensator: {name}: ")
    assert line.isprintable()


def test_a_refused_value_leaves_the_one_that_is_known() -> None:
    followed = Followed()
    followed.receive(controller=text("adaptive"))
    for value in (*HOSTILE.values(), text("no such controller"), text("x" * 10_000)):
        followed.receive(controller=value)
        assert followed.remote.values["controller"] == "adaptive"
    assert followed.changes == 1
    assert len(followed.refused) == len(HOSTILE) + 2


def test_the_node_itself_is_asked_after_an_event_in_its_name() -> None:
    followed = Followed(controller=text("dynamic"))
    assert followed.remote.values["controller"] == "dynamic"
    followed.receive(controller=text("none"))
    assert followed.remote.values["controller"] == "none"
    followed.remote.refresh()
    assert followed.remote.values["controller"] == "dynamic"
    followed.remote.refresh()
    assert followed.client.asked == 2


def test_a_node_of_another_version_has_values_that_are_unknown_here() -> None:
    followed = Followed(controller=text("of tomorrow"))
    assert followed.remote.values["controller"] is None
    assert len(followed.refused) == 1


def test_a_node_that_is_gone_is_forgotten_and_asked_when_it_is_back() -> None:
    followed = Followed(controller=text("dynamic"))
    followed.client.ready = False
    followed.receive(controller=text("none"))
    followed.remote.refresh()
    assert followed.remote.values == {}
    followed.client.ready = True
    followed.remote.refresh()
    assert followed.remote.values["controller"] == "dynamic"


# Whatever comes

words = st.one_of(
    st.sampled_from(ODD_TEXTS),
    st.sampled_from(["dynamic", "pointer", "virtual", "simulated", "/dev/zero", "hook"]),
    st.text(max_size=8),
)
numbers = st.one_of(st.floats(), st.sampled_from([0.0, 1.0, -1.0, 1e300, 5e-324]))
values = st.one_of(
    st.sampled_from(list(HOSTILE.values())),
    st.builds(
        ParameterValue,
        type=st.integers(0, 255),
        bool_value=st.booleans(),
        integer_value=st.integers(-(2**63), 2**63 - 1),
        double_value=numbers,
        string_value=words,
        double_array_value=st.lists(numbers, max_size=2),
        string_array_value=st.lists(words, max_size=2),
    ),
)
nodes = st.sampled_from(list(NEEDED))
names = st.sampled_from(sorted({name for wanted in NEEDED.values() for name in wanted}))
odd_names = st.one_of(names, words, st.sampled_from(list(node_schema("compensator"))))
events = st.tuples(st.just("event"), nodes, st.lists(st.tuples(odd_names, values), max_size=4))
answers = st.tuples(st.just("answer"), nodes, st.lists(values, max_size=4))
presence = st.tuples(st.just("presence"), nodes, st.booleans())
FORCE = [f"actuator force {count}" for count in ("due", "deadlines missed", "age p50 (us)")]
keys = st.sampled_from(["engaged", "one-way delay (ms)", *FORCE])
reports = st.tuples(
    st.just("report"),
    st.sampled_from([*EXPECTED, "scope"]) | words,
    st.tuples(st.integers(0, 255), words, st.dictionaries(keys | words, words, max_size=4)),
)


@fuzz
@given(st.lists(st.one_of(events, answers, presence, reports), max_size=12))
def test_after_any_messages_there_is_a_state_that_a_page_can_read(
    messages: list[tuple[str, str, Any]],
) -> None:
    followed = {name: Followed(name) for name in NEEDED}
    heard = NodeReports()
    begun = time.process_time()
    for kind, who, what in messages:
        if kind == "report":
            level, message, pairs = what
            heard.receive(who, NodeReport(level, message, pairs, time.monotonic()))
        elif kind == "event":
            given = [Parameter(name=name, value=value) for name, value in what]
            remote = followed[who].remote
            remote.receive(ParameterEvent(node=remote.path, new_parameters=given))
        elif kind == "answer":
            followed[who].client.answer = what
        else:
            followed[who].client.ready = what
        for each in followed.values():
            each.remote.refresh()
        known = {name: each.remote.values for name, each in followed.items()}
        stop = {"asked": False, "master": None}
        state = state_of(heard, EXPECTED, known, GraphSettings(), led=False, stop=stop)
        sent = as_json(state)
        assert json.loads(sent, parse_constant=pytest.fail) == json.loads(json.dumps(state))
        assert len(sent) < 100_000
    assert time.process_time() - begun < LONGEST_CASE
    for each in followed.values():
        assert all(line.isprintable() for line in each.refused)
        for name, value in each.remote.values.items():
            kinds = (type(None), type(node_schema(each.remote.path.split("/")[-1])[name][0]))
            assert isinstance(value, kinds)

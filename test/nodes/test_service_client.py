# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of services that answer, refuse, stay silent, or are not there."""

from __future__ import annotations

import asyncio

import pytest
from std_srvs.srv import SetBool, Trigger

from haptic_accel.nodes.service_client import Request, RequestError
from service_double import Answer, Graph, accept, refuse


def test_a_node_that_accepts_is_quoted_and_one_that_refuses_is_named() -> None:
    graph = Graph(recorder__stop=accept, recorder__start=refuse)
    stop, start = (Request(Trigger, f"recorder/{name}", None) for name in ("stop", "start"))
    assert asyncio.run(graph.client.send(stop)) == "done"
    with pytest.raises(RequestError, match="recorder: not now"):
        asyncio.run(graph.client.send(start))


@pytest.mark.parametrize("services", [{}, {"recorder__stop": None}])
def test_a_node_that_is_absent_or_silent_is_named(services: dict[str, Answer]) -> None:
    graph = Graph(**services)
    with pytest.raises(RequestError, match="/left/recorder: does not answer"):
        asyncio.run(graph.client.call(Trigger, "recorder/stop", None))


def test_only_services_that_are_found_are_asked_and_those_answer_one_by_one() -> None:
    graph = Graph(slave_device__estop=refuse, master_device__estop=None)
    names = ("estop", "slave_device/estop", "master_device/estop")
    answers = graph.client.ask(SetBool, names, None)
    assert graph.asked == ["slave_device/estop", "master_device/estop"]
    assert answers.silent == ["master_device"]
    assert list(answers.received) == ["slave_device"]
    assert answers.refusals == ["slave_device: not now"]

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands of the page for the emergency stop."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from haptic_accel.nodes.scope import Commands
from haptic_accel.scope.server import CommandError
from service_double import Answer, Graph, accept

DEVICES = ["master_device", "slave_device"]


def command(graph: Graph, action: str, value: Any, devices: list[str] = DEVICES) -> str:
    node: Any = graph
    return asyncio.run(Commands(node, devices)(action, value))


@pytest.fixture
def services() -> dict[str, Answer]:
    return dict.fromkeys(("estop", "slave_device__estop", "master_device__estop"), accept)


def test_a_stop_goes_to_all_services_and_is_confirmed_by_the_devices(
    services: dict[str, Answer],
) -> None:
    graph = Graph(**services)
    line = command(graph, "estop", True)
    assert line == "stopped: master_device and slave_device without force"
    assert set(graph.asked) == {"estop", "slave_device/estop", "master_device/estop"}


@pytest.mark.parametrize("silent", [True, False])
def test_a_stop_that_a_device_does_not_confirm_is_said_to_be_so(
    services: dict[str, Answer], silent: bool
) -> None:
    if silent:
        services["slave_device__estop"] = None
    else:
        del services["slave_device__estop"]
    with pytest.raises(CommandError, match="estop: not confirmed by slave_device$"):
        command(Graph(**services), "estop", True)


def test_beside_a_peer_host_its_device_is_not_waited_for(services: dict[str, Answer]) -> None:
    del services["slave_device__estop"]
    graph = Graph(**services)
    assert command(graph, "estop", True, ["master_device"]).startswith("stopped: master_device")
    assert command(graph, "estop", False, ["master_device"]) == "done"
    del graph.services["estop"]
    released = command(graph, "estop", False, ["master_device"])
    assert released.startswith("released: master_device take forces again")


def test_a_release_that_no_device_answers_is_said_to_be_none() -> None:
    with pytest.raises(CommandError, match="estop: no release by master_device and slave_device"):
        command(Graph(), "estop", False)

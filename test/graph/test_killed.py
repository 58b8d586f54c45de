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

"""Each process of a graph killed while forces flow, or stopped for a while."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from chaos.live_graph import FORCES as DEVICE_FORCES
from chaos.live_graph import SEPARATE, LiveGraph
from chaos.traced_node import ARM
from haptic_accel.core.coupling.engagement import FREE_TIME
from haptic_accel.core.topics import ACTUATOR_FORCE, MASTER_ARM_FORCE, SLAVE_ARM_FORCE, Topic
from haptic_accel.graph.processes import COMPOSED
from observing import Observer
from running import Command

Start = Callable[..., Command]

NODES = {
    "slave_device": [],
    "master_device": [],
    "compensator": ["--ros-args", "-p", "controller:=constant"],
    "coupler": ["--ros-args", "-p", "compensated:=true"],
}

FORCES: tuple[Topic, ...] = (MASTER_ARM_FORCE, SLAVE_ARM_FORCE, ACTUATOR_FORCE)

KILLED = {
    "compensator": {"master_device": ["actuator force"]},
    "coupler": {"master_device": ["arm force"], "slave_device": ["arm force"]},
    "slave_device": {"master_device": ["arm force", "actuator force"]},
    "master_device": {"slave_device": ["arm force"]},
}
"""Per process the forces that it leaves without a sender."""


def wait_for_silence(observer: Observer, device: str, forces: list[str]) -> None:
    """Wait until a device has noted silence and is without these forces."""
    observer.status(
        device,
        least={f"{force} timeouts": 1 for force in forces},
        **{f"{force} held (N)": "0.000" for force in forces},
    )


@pytest.fixture
def graph(start: Start) -> dict[str, Command]:
    """Start the four nodes that make forces."""
    return {name: start("-m", f"haptic_accel.nodes.{name}", *NODES[name]) for name in NODES}


def test_forces_whose_sender_was_killed_are_taken_off(
    graph: dict[str, Command], start: Start, observer: Observer
) -> None:
    for killed, left in KILLED.items():
        graph["coupler"].wait_for("engaged")
        observer.collect(FORCES, 200)
        os.kill(graph[killed].process.pid, signal.SIGKILL)
        graph[killed].end()
        for device, forces in left.items():
            wait_for_silence(observer, device, forces)
        if killed == "master_device":
            continue
        # All that is left, anew: who couples must not have been engaged before.
        for name in {killed, "coupler"}:
            if name != killed:
                graph[name].end(signal.SIGINT)
            graph[name] = start("-m", f"haptic_accel.nodes.{name}", *NODES[name])
        for device in left:
            graph[device].lines.clear()
    for name in ("slave_device", "compensator", "coupler"):
        assert graph[name].end(signal.SIGINT) == 0, graph[name].text


ARMS = [force for force in DEVICE_FORCES if force[1] == ARM]


@pytest.mark.parametrize(("arrangement", "stopped"), [(COMPOSED, COMPOSED), (SEPARATE, "coupler")])
def test_a_process_that_was_stopped_engages_the_arms_again_where_they_are_then(
    observer: Observer, tmp_path: Path, arrangement: str, stopped: str
) -> None:
    graph = LiveGraph(tmp_path, observer, "constant", arrangement)
    try:
        graph.wait_for(graph.flow(), "forces flow")
        graph.nodes[stopped].process.send_signal(signal.SIGSTOP)
        graph.pause(FREE_TIME)
        graph.forget()
        continued = time.monotonic()
        graph.nodes[stopped].process.send_signal(signal.SIGCONT)
        graph.wait_for(graph.flow(), "forces flow again")
        for force in ARMS:
            assert graph.given(force)[0] >= continued + FREE_TIME, force
        graph.nodes[stopped].wait_for("let go: (no|waiting for the) position of ")
        graph.end_all()
    finally:
        graph.kill_all()

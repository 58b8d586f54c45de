# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each process of a graph killed while forces flow, or stopped for a while."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from chaos.live_graph import FORCES, SEPARATE, LiveGraph
from chaos.traced_node import ARM
from haptic_accel.core.coupling.engagement import FREE_TIME
from haptic_accel.setup.processes import COMPOSED
from observing import Observer

KILLED = {
    "compensator": {"master_device": ["actuator force"]},
    "coupler": {"master_device": ["arm force"], "slave_device": ["arm force"]},
    "slave_device": {"master_device": ["arm force", "actuator force"]},
    "master_device": {"slave_device": ["arm force"]},
}
"""Per process the forces that it leaves without a sender."""

ARMS = [force for force in FORCES if force[1] == ARM]


@contextmanager
def running(folder: Path, observer: Observer, arrangement: str) -> Iterator[LiveGraph]:
    """Run a graph, whose processes end cleanly."""
    graph = LiveGraph(folder, observer, "constant", arrangement)
    try:
        graph.wait_for(graph.flow(), "forces flow")
        yield graph
        graph.end_all()
    finally:
        graph.kill_all()


def stop_for_a_while(graph: LiveGraph, stopped: str) -> None:
    """Stop a process, and check that the arms are engaged again where they are then."""
    graph.nodes[stopped].process.send_signal(signal.SIGSTOP)
    graph.pause(FREE_TIME)
    graph.forget()
    continued = time.monotonic()
    graph.nodes[stopped].process.send_signal(signal.SIGCONT)
    graph.wait_for(graph.flow(), "forces flow again")
    for force in ARMS:
        assert graph.given(force)[0] >= continued + FREE_TIME, force
    graph.nodes[stopped].wait_for("uncoupled: (no|waiting for the) position of ")


def wait_for_silence(observer: Observer, device: str, forces: list[str]) -> None:
    """Wait until a device has noted silence and is without these forces."""
    late = {f"{force} timeouts": 1 for force in forces}
    held = {f"{force} held (N)": "0.000" for force in forces}
    observer.status(device, least=late, **held)


@pytest.mark.slow
def test_a_process_that_was_stopped_engages_the_arms_again_where_they_are_then(
    observer: Observer, tmp_path: Path
) -> None:
    with running(tmp_path, observer, COMPOSED) as graph:
        stop_for_a_while(graph, COMPOSED)


def test_forces_whose_sender_was_stopped_or_killed_are_taken_off(
    observer: Observer, tmp_path: Path
) -> None:
    with running(tmp_path, observer, SEPARATE) as graph:
        for killed, left in KILLED.items():
            graph.wait_for(graph.flow(), "forces flow")
            if killed == "slave_device":  # the devices have noted silence of the coupler before
                stop_for_a_while(graph, "coupler")
            graph.end(killed, signal.SIGKILL, -signal.SIGKILL)
            for device, forces in left.items():
                wait_for_silence(observer, device, forces)
            if killed != "master_device":
                graph.start(killed)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two graphs side by side, each in a namespace of its own."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.analysis import load
from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.core import topics
from haptic_accel.core.coupling.engagement import LATCHED_SETTLING
from observing import Observer
from running import Command, Start, wait_until
from verbs import refusal

CONDITIONS = {
    "left": {"controller": "adaptive", "surface": "vinyl"},
    "right": {"controller": "constant", "surface": "text"},
}
"""Arguments of each graph."""

COMMON = ("/diagnostics", "/parameter_events", "/rosout")
"""Topics that all graphs of a ROS domain share."""


def names_of(bag: Bag) -> set[str]:
    """Return the topics that are in a bag, but for those that all graphs share."""
    return {name for name, count in bag.counts.items() if count and name not in COMMON}


def check_whole(bag: Bag, namespace: str) -> None:
    """Assert that a bag holds one graph, with all signals, and without gaps in a force's."""
    assert bag.problems == []
    assert all(name.startswith(f"/{namespace}/") for name in names_of(bag)), names_of(bag)
    assert set(bag.signals) == {topic.name for topic in topics.SIGNALS}
    assert bag.metadata["arguments"].items() >= CONDITIONS[namespace].items()
    own = [said for said in bag.diagnostics if said.node == "compensator"]
    reported = {said.values["controller"] for said in own}
    assert reported == {CONDITIONS[namespace]["controller"]}


def stop_by_topic(graphs: dict[str, Command], observer: Observer) -> None:
    """Stop the graphs of all namespaces by one topic, which releases none, and release each."""

    def wait_for_states(side: str, stopped: bool) -> None:
        for topic in (topics.COUPLER_STOPPED, topics.MASTER_STOPPED, topics.SLAVE_STOPPED):
            observer.wait_for_state(replace(topic, name=f"{side}/{topic.name}"), stopped)

    def release(side: str) -> bool:
        name = f"{side}/{topics.EMERGENCY_STOP.name}"
        return bool(observer.call(SetBool, name, SetBool.Request(data=False)).success)

    # As `ros2 topic pub --once /estop` does: reliable, nothing latched.
    publisher = observer.node.create_publisher(Bool, topics.COMMON_STOP.name, 1)
    wait_until(lambda: publisher.get_subscription_count() >= 6, "all nodes found")
    seen = {side: len(graph.lines) for side, graph in graphs.items()}
    publisher.publish(Bool(data=True))
    for side in graphs:
        wait_for_states(side, True)
    publisher.publish(Bool(data=False))
    time.sleep(2 * LATCHED_SETTLING)
    for side in graphs:
        wait_for_states(side, True)
    for side, others in (("left", ["right"]), ("right", [])):
        wait_until(lambda side=side: release(side), f"{side} is released")
        wait_for_states(side, False)
        for other in others:
            wait_for_states(other, True)
        graphs[side].wait_for("engaged", after=seen[side])
    observer.node.destroy_publisher(publisher)


def test_two_graphs_run_side_by_side_and_do_not_mix(
    haptic_accel: Start,
    ask: Callable[..., tuple[int, str]],
    observer: Observer,
    tmp_path: Path,
) -> None:
    graphs = {
        name: haptic_accel(
            "teleop",
            *(f"{key}:={value}" for key, value in given.items()),
            *(f"namespace:={name}", f"bag:={name}", "rate:=500"),
        )
        for name, given in CONDITIONS.items()
    }
    for graph in graphs.values():
        graph.wait_for("engaged")
    second = refusal("teleop", "namespace:=left", "record:=false")
    assert "has a graph in /left already" in second
    status, line = ask("control", "namespace:=left", "surface:=plywood")
    assert (status, "surface.name vinyl -> plywood" in line) == (0, True), line

    topic = topics.MASTER_STOPPED
    stopped = {name: replace(topic, name=f"{name}/{topic.name}") for name in graphs}
    stop_by_topic(graphs, observer)
    assert ask("estop", "namespace:=right")[0] == 0
    observer.wait_for_state(stopped["right"], state=True)
    observer.wait_for_state(stopped["left"], state=False)
    force = replace(topics.ACTUATOR_FORCE, name=f"left/{topics.ACTUATOR_FORCE.name}")
    # As long as a trial must be at least, 0.9 s at 500 Hz, and longer.
    forces = observer.collect((force,), 600)[force.name]
    assert np.ptp([message.wrench.force.z for message in forces]) > 0
    status, line = ask("estop", "release:=true", "namespace:=right")
    assert status == 0, line
    observer.wait_for_state(stopped["right"], state=False)
    status, line = ask("estop")
    assert (status, line.startswith("emergency stop: all 4 devices are without")) == (0, True), (
        line
    )
    for topic in stopped.values():
        observer.wait_for_state(topic, state=True)
    assert ask("estop", "release:=true", "namespace:=left")[0] == 0
    observer.wait_for_state(stopped["left"], state=False)
    observer.wait_for_state(stopped["right"], state=True)

    for graph in graphs.values():
        assert graph.end(signal.SIGINT) == 0, graph.text
        graph.wait_for(", 0 dropped")
    bags = {name: read_bag(tmp_path / name) for name in graphs}
    for name, bag in bags.items():
        check_whole(bag, name)
    named = "surface.name"
    surfaces = {
        name: [each.value for each in bag.changes if each.parameter.endswith(named)]
        for name, bag in bags.items()
    }
    # Of its own start, as much as the recorder heard of it: nothing of the other graph.
    assert set(surfaces["right"]) <= {"text"}
    assert surfaces["left"][-1] == "plywood"
    assert {trial.controller for trial in load(tmp_path / "left").trials} == {"adaptive"}

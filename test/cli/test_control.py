# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The controller of a running graph, changed as a user changes it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python

from haptic_accel.bags.delivery import read_delivery
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.setup.arguments import SCENE
from haptic_accel.setup.files import surface_parameters
from observing import Observer
from running import Command, Start, wait_until

Ask = Callable[..., tuple[int, str]]

RATE = 1000.0
"""Hz."""


def take_over(observer: Observer, haptic_accel: Start, ask: Ask) -> None:
    """Let another controller take over, and freeze it."""
    change = haptic_accel("control", "controller:=adaptive", "reset:=true")
    assert change.end() == 0, change.text
    assert change.lines == ["compensator: controller none -> adaptive", "compensator: reset done"]
    assert ask("control", "frozen:=true") == (0, "compensator: adaptive.frozen False -> True")
    observer.status("compensator", frozen="true")


def check_taken_over(bag: Path) -> None:
    """Check that the forces of the other controller began without a jump."""
    values = read_delivery(bag, RATE).nodes["compensator"]
    assert values["controller"] == "adaptive"
    assert values["frozen"] == "true"
    force = read_bag(bag).signals[topics.ACTUATOR_FORCE.name].values[:, 2]
    at = int(np.argmax(force != 0.0))
    assert 0 < at < len(force) - 100, "no change within the recording"
    # Faded in: the first of some five samples is a fifth of what follows, at most.
    assert abs(force[at]) < 3.0


def change_rig(graph: Command, observer: Observer, ask: Ask) -> None:
    """Change surface, grip and engagement of a graph; what is wrong is refused."""

    def value(node: str, name: str) -> Any:
        request = GetParameters.Request(names=[name])
        (found,) = observer.call(GetParameters, f"{node}/get_parameters", request).values
        return parameter_value_to_python(found)

    def reason_of(node: str, **values: Any) -> str:
        named = {f"simulated.{key.replace('__', '.')}": given for key, given in values.items()}
        parameters = [Parameter(key, value=named[key]).to_parameter_msg() for key in named]
        request = SetParametersAtomically.Request(parameters=parameters)
        service = f"{node}/set_parameters_atomically"
        return str(observer.call(SetParametersAtomically, service, request).result.reason)

    status, said = ask("control", "surface:=vinyl", "grip:=hook", "engage:=false")
    surface, grip, arms = said.splitlines()
    assert (status, arms) == (0, "coupler: free on request")
    assert surface.startswith("slave_device: simulated.surface.")
    assert grip == "master_device: simulated.grip.posture average -> hook"
    unchanged = "master_device: nothing changed: it was so already"
    assert ask("control", "grip:=hook") == (0, unchanged)
    graph.wait_for("uncoupled: free on request")
    # All of the surface, also what its file does not name.
    expected = surface_parameters("vinyl")
    assert {name: value("slave_device", name) for name in expected} == expected
    assert value("master_device", "simulated.grip.posture") == "hook"
    observer.status("coupler", "free on request")
    for force in (topics.MASTER_ARM_FORCE, topics.SLAVE_ARM_FORCE):
        name = force.name
        wait_until(lambda name=name: not observer.node.count_publishers(name), "the arms are left")
    so_far = len(graph.lines)
    status, said = ask("control", "engage:=true")
    assert status == 0, said + graph.text
    graph.wait_for("engaged", after=so_far)
    assert ask("control", "arm:=true") == (0, "slave_device: armed\nmaster_device: armed")
    # One by one, as `ros2 param set` does.
    assert reason_of("slave_device", surface__friction=0.7) == ""
    assert reason_of("master_device", grip__gravity=3.0) == ""
    # What is wrong is named, and nothing of it is taken.
    for node, wrong in {
        "slave_device": {"surface__friction": 0.9, "surface__stiffness": -1.0},
        "master_device": {"grip__variation": 0.1, "grip__posture": "fist"},
    }.items():
        assert f"simulated.{list(wrong)[1].replace('__', '.')}" in reason_of(node, **wrong)
    assert "simulated.tool.mass" in reason_of("slave_device", tool__mass=1.0)
    assert value("slave_device", "simulated.surface.friction") == 0.7
    assert value("master_device", "simulated.grip.variation") != 0.1
    both = (topics.TOOL_ACCELERATION, topics.HANDLE_ACCELERATION)
    for messages in observer.collect(both, 200).values():
        felt = np.array([message.accel.linear.z for message in messages])
        assert np.all(np.isfinite(felt))
        assert np.any(felt)


def test_controller_surface_grip_and_engagement_change_while_the_graph_runs(
    haptic_accel: Start, observer: Observer, ask: Ask, tmp_path: Path
) -> None:
    words = "rig:=ideal", "controller:=none", "surface:=plywood", f"rate:={RATE:g}", "bag:=bag"
    graph = haptic_accel("teleop", *words)
    graph.wait_for("engaged")
    take_over(observer, haptic_accel, ask)
    change_rig(graph, observer, ask)
    assert graph.end(signal.SIGINT) == 0, graph.text
    check_taken_over(tmp_path / "bag")


MAT = """materials: {rubber: {stiffness: 800.0}}
objects: {mat: {shape: plane, material: rubber}}
"""


@pytest.mark.slow
def test_another_scene_comes_under_the_tool_while_the_graph_runs(
    haptic_accel: Start, observer: Observer, ask: Ask, tmp_path: Path
) -> None:
    (tmp_path / "mat.yaml").write_text(MAT)
    graph = haptic_accel("teleop", "slave:=virtual", "rate:=500", "bag:=bag")
    graph.wait_for("engaged")
    status, said = ask("control", f"surface:={tmp_path / 'mat.yaml'}")
    assert (status, said.split()[:2]) == (0, ["slave_device:", SCENE])
    assert said.endswith(str(tmp_path / "mat.yaml"))

    def presses() -> bool:
        found = observer.collect((topics.CONTACT_FORCE,), 50)[topics.CONTACT_FORCE.name]
        return max(message.wrench.force.z for message in found) > 0.5

    wait_until(presses, "the hand presses on the mat")
    assert graph.end(signal.SIGINT) == 0, graph.text
    bag = read_bag(tmp_path / "bag")
    scenes = [Path(change.value).stem for change in bag.changes if change.parameter == SCENE]
    # Of the start, as much as the recorder heard of it.
    assert {*scenes[:-1]} <= {"workshop"}
    assert scenes[-1] == "mat"
    assert len(bag.signals[topics.CONTACT_FORCE.name].values) > 100


@pytest.mark.quiet
def test_without_a_graph_it_says_so(ask: Ask) -> None:
    status, line = ask("control", "reset:=true", "namespace:=/nowhere")
    assert status == 1
    assert line == "haptic-accel: /nowhere/compensator: does not answer; is the graph running?"

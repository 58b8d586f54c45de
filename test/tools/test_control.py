"""The controller of a running graph, changed as a user changes it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from haptic_accel.bags.trials import read_trial
from haptic_accel.core.controllers import CONTROLLERS
from running import Command

Start = Callable[..., Command]


def test_another_controller_takes_over_without_a_jump(haptic_accel: Start, tmp_path: Path) -> None:
    graph = haptic_accel("teleop", "rig:=ideal", "controller:=none", "bag:=bag")
    graph.wait_for("engaged")
    change = haptic_accel("control", "controller:=adaptive", "reset:=true")
    assert change.end() == 0, change.text
    # Long enough for what takes over to have listened, and to have been felt.
    graph.wait_for("engaged")
    later = haptic_accel("control", "frozen:=true")
    assert later.end() == 0, later.text
    refused = haptic_accel("control", "controller:=magic")
    assert refused.end() == 2
    assert refused.text.endswith("must be one of keep, " + ", ".join(CONTROLLERS))
    assert graph.end(signal.SIGINT) == 0, graph.text
    trial, delivery = read_trial(tmp_path / "bag", "plywood", "adaptive", 1000.0, 15.0)
    values = delivery.nodes["compensator"]
    assert values["controller"] == "adaptive"
    assert values["frozen"] == "true"
    force = trial.actuator_force
    at = int(np.argmax(force != 0.0))
    assert 0 < at < len(force) - 100, "no change within the recording"
    # Faded in: the first of some five samples is a fifth of what follows, at most.
    assert abs(force[at]) < 3.0


@pytest.mark.parametrize(
    ("words", "status", "named"),
    [
        ([], 2, "control"),
        (["controler:=adaptive"], 2, "controler"),
        (["frozen:=perhaps"], 2, "frozen"),
        (["controller:=none"], 1, "does not answer; is the graph running?"),
        (["reset:=true", "namespace:=/nowhere"], 1, "/nowhere/compensator"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    haptic_accel: Start, words: list[str], status: int, named: str
) -> None:
    command = haptic_accel("control", *words)
    assert command.end() == status, command.text
    assert len(command.lines) == 1, command.text
    assert named in command.text

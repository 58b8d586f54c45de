# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live graph and the same trial in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.analysis.replay import find_divergence
from haptic_accel.core.tick.device_side import PAST_TICK
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.setup import Setup
from nightly import rest_slow
from running import Command, MachineStoodStillError

RATE, LATENCY = 500, 8
"""Samples per second, and samples from one to its force: 16 ms, which a busy host can keep."""

LEAST = RATE
"""Least number of samples that must be compared: a second."""


STOOD_STILL = (PAST_TICK, "missed ticks", "withheld")
"""Counts of nodes whose machine stood still: a late force, ticks left out, a late release."""

LIMITS = """
/**/master_device:
  ros__parameters:
    safety:
      arm: {peak_force: 0.4}
      actuator: {slew_rate: 2000.0}
"""
"""Limits that the coupling's and the compensator's forces reach."""


@pytest.mark.parametrize(
    ("rig", "controller", "words"),
    rest_slow(
        [
            ("paper", "adaptive", ("surface:=text", "composed:=false")),
            ("ideal", "inverse", ("surface:=vinyl", "params_file:=limits.yaml")),
            ("paper", "dynamic", ("surface:=text", "coupling:=passive")),
            ("ideal", "dynamic", ("slave:=virtual", "surface:=workshop")),
        ],
        now=2,
    ),
)
def test_the_live_graph_gives_the_signals_of_lockstep_bit_for_bit(
    haptic_accel: Callable[..., Command],
    tmp_path: Path,
    rig: str,
    controller: str,
    words: tuple[str, ...],
) -> None:
    (tmp_path / "limits.yaml").write_text(LIMITS)
    command = haptic_accel(
        *("teleop", f"rate:={RATE}", f"latency:={LATENCY}", "duration:=1.5", "bag:=bag"),
        *(f"rig:={rig}", f"controller:={controller}", *words),
    )
    assert command.end() == 0, command.text
    check_equal(tmp_path / "bag", command.text)


@pytest.mark.slow
def test_a_recorded_slave_gives_the_signals_of_lockstep_too(
    haptic_accel: Callable[..., Command], tmp_path: Path
) -> None:
    recorded = GraphArguments(surface="text", rate=RATE, latency=LATENCY, duration=3.0)
    setup = Setup.of(recorded)
    record_trial(tmp_path / "played", lockstep_trial(setup), setup, 0)
    command = haptic_accel(
        *("teleop", f"rate:={RATE}", f"latency:={LATENCY}", "slave:=replay", "replay:=played"),
        *("rig:=ideal", "controller:=adaptive", "bag:=bag"),
    )
    assert command.end() == 0, command.text
    check_equal(tmp_path / "bag", command.text)


def check_equal(bag: Path, text: str) -> None:
    """Check that a bag's signals are those of lockstep for `LEAST` samples.

    Without so many, fail with the text of the graph.
    """
    found = find_divergence(bag)
    stood_still = any(reason in found.sentence for reason in STOOD_STILL)
    if found.first is not None and found.first < LEAST and stood_still:
        raise MachineStoodStillError(found.sentence)
    assert found.samples > LEAST, text
    assert found.first is None or found.first >= LEAST, found.sentence

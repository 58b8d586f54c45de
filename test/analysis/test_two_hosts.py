# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of both hosts of one run, with a network and a clock that the test knows."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bag_maker import START, BagContent, meta, write_bag
from haptic_accel.analysis.loading import BOUND, OFFSET, Across, analyse
from haptic_accel.analysis.segments import high_passed
from haptic_accel.analysis.summary import summary
from haptic_accel.analysis.writing import as_json
from haptic_accel.core import topics
from haptic_accel.core.model import FloatArray

RATE, SECONDS = 1000.0, 14.0
AHEAD = 3.2173e9
"""Offset of the robot's clock, ns."""
PLAYED, COMPENSATED = 0.035, 0.002
"""Delay of the channel, and from what was played out to the handle, s."""

FREQUENCIES = np.random.default_rng(5).uniform(60.0, 250.0, 60)
PHASES = np.random.default_rng(6).uniform(0.0, 2 * math.pi, 60)


def felt(time: FloatArray) -> FloatArray:
    """Return the tool's acceleration at true times, m/s^2."""
    return np.asarray(np.sin(2 * np.pi * FREQUENCIES * time[:, None] + PHASES).sum(axis=1))


def arguments(side: str, **others: Any) -> dict[str, Any]:
    stated = meta("constant", "vinyl" if side == "slave" else "plywood")
    stated["arguments"] |= {"side": side, "peer": "10.77.0.2", "namespace": "", **others}
    return stated


def reports(offset: float = AHEAD, bound: float = 0.4, drift: float = 0.0) -> list[Any]:
    offsets = {s: offset / 1e6 + 1e3 * drift * s for s in range(1, round(SECONDS))}
    return [
        (second, "coupler", "OK", {OFFSET: str(known), BOUND: str(bound)})
        for second, known in offsets.items()
    ]


def operator(gain: float = 0.9, wander: float = 0.0, **others: Any) -> BagContent:
    """Return what the operator's host records: the handle does `gain` of what is played out."""
    time = np.arange(round(RATE * SECONDS)) / RATE
    delay = PLAYED + wander * time
    signals = {
        topics.TOOL_ACCELERATION.name: felt(time - delay),
        topics.HANDLE_ACCELERATION.name: gain
        * high_passed(felt(time - delay - COMPENSATED), 15.0, RATE),
    }
    return replace(
        BagContent(signals, RATE, arguments("master")), **{"diagnostics": reports(), **others}
    )


def robot(drift: float = 0.0, **others: Any) -> BagContent:
    """Return what the robot's host records: its clock is ahead, and goes fast by the drift."""
    time = np.arange(round(RATE * SECONDS)) / RATE
    signals = {topics.TOOL_ACCELERATION.name: felt(time / (1 + drift))}
    content = BagContent(signals, RATE, arguments("slave"), arms=False, start=START + int(AHEAD))
    return replace(content, **others)


def compared(folder: Path, *contents: BagContent) -> list[Across]:
    for number, content in enumerate(contents):
        write_bag(folder / str(number), content)
    return analyse([folder]).across


def test_the_handle_is_compared_with_the_robots_own_tool_at_the_delay_of_the_run(
    tmp_path: Path,
) -> None:
    (found,) = compared(tmp_path, operator(), robot())
    assert found.delay_ms == pytest.approx(37.0, abs=0.05)
    assert found.nrmse_percent == pytest.approx(10.0, abs=1.5)
    assert found.bound_ms == pytest.approx(0.4)
    assert found.played_percent > 10.0


def test_a_clock_that_drifts_and_a_playout_that_wanders_change_the_delay_not_the_error(
    tmp_path: Path,
) -> None:
    drift = 80e-6
    there = operator(wander=2e-4, diagnostics=reports(drift=drift))
    (found,) = compared(tmp_path, there, robot(drift))
    assert found.nrmse_percent == pytest.approx(10.0, abs=1.5)
    assert (found.delay_low_ms, found.delay_high_ms) == pytest.approx((37.0, 39.8), abs=0.3)


def test_a_delay_that_changes_by_periods_of_the_vibration_is_found(tmp_path: Path) -> None:
    (found,) = compared(tmp_path, operator(wander=1e-3), robot())  # the limit of playout
    assert (found.delay_low_ms, found.delay_high_ms) == pytest.approx((37.0, 51.0), abs=1.0)
    assert found.nrmse_percent < 25.0


def test_vibration_in_three_axes_is_compared_as_a_vector(tmp_path: Path) -> None:
    scale = np.array([1.0, -0.5, 0.2])
    here, there = (
        replace(
            content,
            signals={name: np.outer(values, scale) for name, values in content.signals.items()},
        )
        for content in (operator(), robot())
    )
    here.metadata["parameters"]["compensator"]["axes"] = "x, y, z"
    (found,) = compared(tmp_path, here, there)
    assert found.delay_ms == pytest.approx(37.0, abs=0.05)
    assert found.nrmse_percent == pytest.approx(10.0, abs=1.5)


def test_the_summary_and_the_file_state_both_errors_and_how_well_the_clocks_are_known(
    tmp_path: Path,
) -> None:
    write_bag(tmp_path / "desk", operator())
    write_bag(tmp_path / "robot", robot())
    analysis = analyse([tmp_path / "desk", tmp_path / "robot"])
    (trial,) = analysis.trials
    assert trial.surface == "vinyl"  # the robot's, which the operator does not know
    text = " ".join(summary(analysis))
    assert "desk: the handle follows the robot's own tool after 37.0 ms" in text
    assert "the clocks are known to 0.4 ms" in text
    (row,) = as_json(analysis)["two_hosts"]
    assert row["robot"] == str(tmp_path / "robot")


def test_only_bags_of_one_run_are_compared(tmp_path: Path) -> None:
    later = robot(start=START + int(AHEAD) + 10**12)
    elsewhere = robot(metadata=arguments("slave", namespace="second"))
    assert compared(tmp_path, operator(), later, elsewhere) == []
    problems = analyse([tmp_path]).problems
    assert {
        name for name, lines in problems.items() for line in lines if "of a robot alone" in line
    } == {"1", "2"}


def test_an_operator_who_never_heard_the_robots_clock_is_on_no_axis_with_it(
    tmp_path: Path,
) -> None:
    assert compared(tmp_path, operator(diagnostics=reports(bound=math.inf)), robot()) == []


def test_a_handle_that_does_not_follow_is_named(tmp_path: Path) -> None:
    there = operator()
    noise = np.random.default_rng(1).normal(0.0, 1.0, round(RATE * SECONDS))
    signals = {**there.signals, topics.HANDLE_ACCELERATION.name: noise}
    write_bag(tmp_path / "desk", replace(there, signals=signals))
    write_bag(tmp_path / "robot", robot())
    problems = analyse([tmp_path]).problems
    assert any("no delay was found" in line for line in problems["desk"])

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tracking error in lockstep against what theory says of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from fidelity_trials import Case, comparison_with_none, run_case, summary, tables
from handle_family import SPREAD, hand
from input_family import band_noise, member

from haptic_accel.core.model import HandleParameters
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial
from haptic_accel.setup.setup import Setup


@pytest.mark.slow
def test_adaptation_halves_what_another_hand_costs() -> None:
    grips = ((1.0, hand(2, 3)),)
    both = (
        GraphArguments(rig="ideal", surface="text", controller=name)
        for name in ("adaptive", "inverse")
    )
    adaptive, inverse = (
        run_case(Case("hands", "text", "hand", each, grips, start=3.0)) for each in both
    )
    assert adaptive["nrmse_percent"] < max(6.0, inverse["nrmse_percent"] / 2)
    assert adaptive["bound_percent"] < adaptive["nrmse_percent"]


def test_hands_lie_within_their_spread_and_are_the_same_again() -> None:
    average = HandleParameters()
    hands = [hand(5, number) for number in range(200)]
    for name, (low, high) in SPREAD.items():
        factors = [getattr(each, name) / getattr(average, name) for each in hands]
        assert low <= min(factors) < low * 1.1
        assert high * 0.9 < max(factors) <= high
    assert hand(5, 7) == hands[7]
    assert hand(6, 7) != hands[7]


@pytest.mark.slow
def test_slow_motion_of_the_hand_is_learnt_as_such() -> None:
    # Noise from 17 Hz on, under a hand that moves to and fro: travel of 3.6 mm is too little for
    # both. A filter that knows the spectrum and stays within it has 2.5 %.
    moved = member(70, 8.0, 1000.0)
    arguments = GraphArguments(rig="ideal", controller="adaptive")
    row = run_case(Case("inputs", moved.name, "Table I", arguments, recording=moved.acceleration))
    assert row["limited_bound_percent"] < 3.0
    assert row["nrmse_percent"] < 8.0
    assert row["nrmse_by_2_s_percent"][-1] < 6.0


# The noise of the paper's rig hides the handle's response outside the band.
def test_of_a_narrow_band_nothing_is_learnt_that_is_worse_than_what_was_known() -> None:
    random, time = np.random.default_rng(2), np.arange(8000) / 1000.0
    line = band_noise(random, len(time), 197.0, 259.0, 1000.0)
    line *= 0.7 / np.std(line) * np.minimum(time / 0.2, 1.0)
    both = (GraphArguments(rig="paper", controller=name) for name in ("inverse", "adaptive"))
    inverse, adaptive = (
        run_case(Case("lines", "beam", "user 0", each, recording=line)) for each in both
    )
    pairs = zip(adaptive["nrmse_by_2_s_percent"], inverse["nrmse_by_2_s_percent"], strict=True)
    assert max(learnt - known for learnt, known in pairs) < 1.0


# On the ideal rig dynamic leaves nothing to tell either.
@pytest.mark.parametrize(("rig", "gain"), [("ideal", 0.0), ("paper", 0.2)])
def test_a_better_controller_leaves_less_that_a_hand_could_tell(rig: str, gain: float) -> None:
    names = ("none", "constant", "dynamic", "adaptive")
    given = {"rig": rig, "surface": "text", "duration": 3.0}
    setups = (Setup.of(GraphArguments(controller=name, **given)) for name in names)
    none, constant, dynamic, adaptive = (
        lockstep_trial(setup).indistinguishable() for setup in setups
    )
    assert none < 0.05
    assert none < constant - 0.2
    assert constant < dynamic - 0.05
    assert dynamic <= adaptive - gain
    assert adaptive > 0.95


def test_trials_without_anything_to_feel_enter_no_mean_share() -> None:
    row = run_case(Case("all", "text", "Table I", GraphArguments(rate=500.0, controller="none")))
    shares = (math.nan, 80.0, 90.0)
    still, *felt = (row | {"indistinguishable_percent": share} for share in shares)
    (line,) = summary([still, *felt])
    assert line["mean_indistinguishable_percent"] == 85.0
    assert line["worst_indistinguishable_percent"] == 80.0
    assert line["trials"] == 3
    assert [table.rows for table in tables(summary([still]))][1] == [("all", "– (–)")]


def test_a_window_that_is_worse_than_none_is_counted() -> None:
    key: dict[str, Any] = {"condition": "c", "input": "i", "grip": "g"}
    names = ["bound_percent", "limited_bound_percent", "indistinguishable_percent"]
    key |= dict.fromkeys([*names, "nrmse_percent", "force_rms_n", "travel_peak_mm"], 1.0)
    errors = {"none": [100.0, None, 99.0, 98.0], "inverse": [101.0, 7.0, 104.0, 1.0]}
    rows = [key | {"controller": name, "nrmse_by_2_s_percent": errors[name]} for name in errors]
    idle, inverse = summary(rows)
    assert inverse["above_none_points"] == 5.0
    assert inverse["windows_above_none_percent"] == pytest.approx(100.0 / 3.0)
    assert idle["above_none_points"] == 0.0
    shown = comparison_with_none([idle, inverse])
    assert shown is not None
    assert "+5.0 (33.3 %)" in shown.rows[0]

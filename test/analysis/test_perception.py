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

"""The perceptual scores of signals whose scores are known."""

from __future__ import annotations

import builtins
import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from haptic_accel.analysis.perception import MISSING, Perception, perceive
from haptic_accel.core.model import FloatArray

RATE = 1000.0


@pytest.fixture
def desired() -> FloatArray:
    pytest.importorskip("vibromaf")
    return np.random.default_rng(1).normal(0.0, 3.0, 4000)


def test_equal_signals_score_one(desired: FloatArray) -> None:
    found = perceive(desired, desired.copy(), RATE)
    assert (found.st_sim, found.note) == (1.0, "")


def test_a_silent_handle_scores_zero(desired: FloatArray) -> None:
    found = perceive(desired, np.zeros_like(desired), RATE)
    assert found.st_sim == pytest.approx(0.0, abs=1e-9)


def test_a_handle_that_vibrates_more_strongly_scores_above_one(desired: FloatArray) -> None:
    assert 1.0 < perceive(desired, 2.0 * desired, RATE).st_sim < 1.1


def test_no_score_ranks_a_silent_handle_above_a_strong_copy(desired: FloatArray) -> None:
    silent, strong = (perceive(desired, gain * desired, RATE) for gain in (0.0, 2.0))
    scores = [score.name for score in fields(Perception) if score.type == "float"]
    assert [name for name in scores if getattr(silent, name) >= getattr(strong, name)] == []


def test_of_a_long_trial_pieces_from_its_beginning_to_its_end_are_scored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("vibromaf")
    monkeypatch.setattr("haptic_accel.analysis.perception.MOST_PIECES", 2)
    wanted = np.random.default_rng(1).normal(0.0, 3.0, 40_000)
    actual = wanted.copy()
    actual[10_000:30_000] = 0.0
    assert perceive(wanted, actual, RATE).st_sim == 1.0
    actual[30_000:] = 0.0
    assert perceive(wanted, actual, RATE).st_sim == pytest.approx(0.5)


def test_the_better_copy_scores_higher(desired: FloatArray) -> None:
    noise = np.random.default_rng(2).normal(0.0, 3.0, 4000)
    near, far = (perceive(desired, desired + share * noise, RATE) for share in (0.1, 0.8))
    assert near.st_sim > far.st_sim


def test_opposed_signals_have_no_st_sim(desired: FloatArray) -> None:
    found = perceive(desired, -desired, RATE)
    assert math.isnan(found.st_sim)
    assert "negatively correlated" in found.note


def test_silence_and_moments_are_not_scored(desired: FloatArray) -> None:
    assert "too weak to be felt" in perceive(np.zeros(4000), desired, RATE).note
    assert "shorter than" in perceive(desired[:20], desired[:20], RATE).note


def test_rests_change_no_score(desired: FloatArray) -> None:
    # A sensor's noise at rest, and what a filter of the desired acceleration leaves there.
    noise = 0.05 * np.random.default_rng(2).normal(0.0, 1.0, 8000)
    fading = 1e-9 * np.sin(2 * np.pi * 100 * np.arange(4000) / RATE)
    rested = np.concatenate([desired[:2000], fading, desired[2000:]])
    found = perceive(rested, rested + noise, RATE)
    active = np.r_[:2000, 6000:8000]
    alone = perceive(rested[active], (rested + noise)[active], RATE)
    assert found.st_sim == pytest.approx(alone.st_sim, abs=0.02)


def test_a_long_trial_is_the_mean_of_its_pieces(desired: FloatArray) -> None:
    rate = 200.0  # 20 s
    noise = np.random.default_rng(2).normal(0.0, 3.0, 4000)
    halves = [
        perceive(desired[half], (desired + noise)[half], rate)
        for half in (slice(2000), slice(2000, None))
    ]
    found = perceive(desired, desired + noise, rate)
    assert found.st_sim == pytest.approx(np.mean([half.st_sim for half in halves]))


def test_without_the_library_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def refusing(name: str, *rest: Any) -> Any:
        if name.startswith("vibromaf"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refusing)
    found = perceive(np.ones(4000), np.ones(4000), RATE)
    assert found.note == MISSING
    assert math.isnan(found.st_sim)

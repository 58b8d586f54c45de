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

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.evaluation import identify_handle
from haptic_accel.core.identification.sweep import (
    IdentificationTrial,
    SweepParameters,
    excitation,
    find_trials,
)
from haptic_accel.core.model import POSTURES, GripParameters, HandleParameters, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.trial import run_identification

RATE = 1000.0
SWEEP = SweepParameters(duration=1.0)
RIG = MasterRigParameters()
SENSOR = RIG.accelerometer


def recorded(rig: MasterRigParameters, trials: int = 1) -> list[IdentificationTrial]:
    return run_identification(rig, SWEEP, RATE, seed=3, trials=trials)


def test_grips_are_fitted_one_by_one_and_together() -> None:
    of_grips = {
        posture: recorded(replace(RIG, grip=GripParameters(posture=posture)), trials=2)
        for posture in ("pinch", "hook")
    }
    found = identify_handle(of_grips, SWEEP, SENSOR.range, SENSOR.bandwidth)
    for posture, grip in found.grips.items():
        true = held(RIG.handle, GripParameters(posture=posture), seed=0)
        assert grip.fit.handle.m_h == pytest.approx(true.m_h, rel=0.02)
        assert grip.fit.handle.k_u == pytest.approx(true.k_u, rel=0.05)
        assert len(grip.trials) == len(grip.responses) == 2
        inside = (grip.averaged_h1.frequency > 30) & (grip.averaged_h1.frequency < 150)
        assert np.all(grip.averaged_h1.coherence[inside] > 0.8)
        # By definition H1 is H2 times the coherence.
        ratio = np.abs(grip.averaged_h1.response / grip.averaged_h2.response)
        assert ratio == pytest.approx(grip.averaged_h1.coherence)
    # Dry friction, here none, is the bearing's and not the grip's.
    assert found.fit.bearing.friction < 3 * found.fit.standard_errors["friction"]
    pinch, hook = (found.grips[name].fit.handle for name in ("pinch", "hook"))
    assert pinch.m_h < found.fit.handle.m_h < hook.m_h
    assert pinch.k_u < found.fit.handle.k_u < hook.k_u


@pytest.mark.parametrize("latency", [0, 1, 20])
def test_the_delay_found_is_that_of_the_hardware_alone(latency: int) -> None:
    rig = replace(RIG, drive=replace(RIG.drive, delay=150e-6))
    trials = run_identification(rig, SWEEP, RATE, seed=3, latency=latency)
    found = identify_handle({"average": trials}, SWEEP, SENSOR.range, SENSOR.bandwidth)
    assert found.fit.delay == pytest.approx(150e-6, abs=5e-6)


def test_table_i_lies_in_the_middle_of_the_postures() -> None:
    assert POSTURES["average"] == (1.0, 1.0, 1.0)
    assert np.multiply(POSTURES["pinch"], POSTURES["hook"]) == pytest.approx(1.0)


def test_an_actuator_measured_on_the_bench_is_taken_as_measured() -> None:
    handle = HandleParameters(m_a=0.03, k_s=500.0)
    trials = {"average": recorded(replace(RIG, handle=handle))}
    found = identify_handle(
        trials, SWEEP, SENSOR.range, SENSOR.bandwidth, known=HandleParameters(m_a=0.03, k_s=500.0)
    )
    assert found.fit.handle.m_h == pytest.approx(handle.m_h, rel=0.02)
    assert found.fit.handle.m_a == 0.03
    freed = identify_handle(
        trials,
        SWEEP,
        SENSOR.range,
        SENSOR.bandwidth,
        known=HandleParameters(k_s=500.0),
        free=("m_a", "b_s", "m_h", "b_u", "delay"),
    )
    assert freed.fit.handle.m_a == pytest.approx(0.03, rel=0.05)


def test_no_trial_at_all_is_refused() -> None:
    for nothing in ({}, {"pinch": []}):
        with pytest.raises(ParameterError, match="at least one trial"):
            identify_handle(nothing, SWEEP, SENSOR.range, SENSOR.bandwidth)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_trials_are_found_where_the_force_looks_like_the_sweep(noise: float) -> None:
    force = excitation(SWEEP, RATE)
    random = np.random.default_rng(0)
    starts = [700, 700 + len(force) + 1234]
    whole = noise * random.standard_normal(starts[-1] + len(force) + 99)
    for start in starts:
        whole[start : start + len(force)] += force
    acceleration = np.arange(len(whole), dtype=float)
    found = find_trials(whole, acceleration, SWEEP, RATE)
    assert [trial.handle_acceleration[0] for trial in found] == starts
    assert all(len(trial.actuator_force) == len(force) for trial in found)
    # With a latency, each force belongs to an acceleration as many samples later.
    late = [trial.aligned for trial in find_trials(whole, acceleration, SWEEP, RATE, latency=4)]
    assert [trial.handle_acceleration[0] for trial in late] == [start + 4 for start in starts]
    assert all(len(trial.handle_acceleration) == len(force) for trial in late)
    for trial, same in zip(late, found, strict=True):
        assert np.array_equal(trial.actuator_force, same.actuator_force)


@pytest.mark.parametrize(
    ("force", "reason"),
    [
        (np.zeros(9000), "correlates"),
        (1e-12 * excitation(SWEEP, RATE), "correlates"),
        (excitation(replace(SWEEP, end_frequency=300.0), RATE), "correlates"),
        (excitation(SWEEP, RATE)[:-1], "must be at least 3000"),
        (np.full(9000, np.nan), "NaN"),
    ],
)
def test_a_recording_without_the_sweep_is_refused(force: np.ndarray, reason: str) -> None:
    with pytest.raises(RecordingError, match=reason):
        find_trials(force, np.zeros(len(force)), SWEEP, RATE)

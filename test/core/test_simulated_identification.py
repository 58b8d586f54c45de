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

"""Trials of an identification of the virtual rig."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.trial import run_identification

SHORT_SWEEP = SweepParameters(duration=0.2)


@pytest.mark.parametrize("latency", [0, 1, 7])
def test_a_force_is_seen_one_sample_after_the_latency(
    ideal_master: MasterRigParameters, latency: int
) -> None:
    (trial,) = run_identification(ideal_master, SHORT_SWEEP, latency=latency)
    first = int(np.flatnonzero(trial.actuator_force)[0])
    assert np.abs(trial.handle_acceleration[: first + latency + 1]).max() < 1e-7
    assert abs(trial.handle_acceleration[first + latency + 1]) > 0.01


def test_an_identification_without_its_latency_is_one_of_the_papers_loop() -> None:
    at_once, late = (
        run_identification(parameters=SHORT_SWEEP, seed=1, latency=latency)[0].aligned
        for latency in (0, 3)
    )
    assert np.array_equal(late.actuator_force, at_once.actuator_force)
    assert np.array_equal(late.handle_acceleration, at_once.handle_acceleration)


def test_the_papers_sweep_keeps_clear_of_the_stops() -> None:
    (trial,) = run_identification()
    assert not any(trial.counters.values())
    assert np.abs(trial.handle_acceleration).max() < 20.0


def test_trials_differ_in_noise_alone_and_repeat_with_their_seed() -> None:
    first, second = run_identification(parameters=SHORT_SWEEP, seed=3, trials=2)
    again, _ = run_identification(parameters=SHORT_SWEEP, seed=3, trials=2)
    assert (first.handle_acceleration == again.handle_acceleration).all()
    difference = first.handle_acceleration - second.handle_acceleration
    noise = MasterRigParameters().accelerometer.noise
    assert difference.std() == pytest.approx(math.sqrt(2) * noise, rel=0.15)


def test_an_impossible_latency_of_an_identification_is_refused() -> None:
    with pytest.raises(ParameterError, match="^latency = 21: must be from 0 to 20 samples$"):
        run_identification(latency=21)


def test_no_trial_is_refused() -> None:
    with pytest.raises(ParameterError, match="^trials = 0: must be at least 1$"):
        run_identification(trials=0)

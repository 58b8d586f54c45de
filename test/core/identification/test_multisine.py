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
"""Orthogonal multisines: their lines, amplitude and travel, and how they are found again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import ALL_AXES, Axes
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.multisine import (
    kept_periods,
    multisine,
    orthogonal_excitation,
    trial_forces,
)
from haptic_accel.core.identification.sweep import SweepParameters, excitation, find_trials, sweep
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tick import TravelEstimator
from three_coils import RATE, SWEEP


def test_a_coils_lines_have_the_power_of_the_sweep() -> None:
    forces = multisine(SWEEP, RATE)
    assert forces.shape == (1000, 3)
    one = sweep(SWEEP, RATE)
    assert forces.std(axis=0) == pytest.approx(one.std(), rel=0.02)
    assert np.abs(forces).max() < 1.3 * np.abs(one).max()
    frequency = np.fft.rfftfreq(1000, 1 / RATE)
    inside = (frequency >= 8.0) & (frequency <= 450.0)
    lines = np.abs(np.fft.rfft(forces, axis=0))
    assert lines[~inside] == pytest.approx(0.0, abs=1e-9)
    assert lines[inside].min() > 0.05 * lines.max()
    wide = np.abs(np.fft.rfft(one))
    for low, high in ((20, 40), (60, 120), (200, 400)):
        part = (frequency >= low) & (frequency < high)
        power = np.sum(lines[part, 0] ** 2)
        assert power == pytest.approx(np.sum(wide[part] ** 2), rel=0.1)


def test_the_coils_are_orthogonal_at_every_line() -> None:
    spectra = np.fft.rfft(kept_periods(orthogonal_excitation(SWEEP, RATE), SWEEP, RATE), axis=2)
    matrix = spectra[:, 0, 8:451].transpose(1, 2, 0)  # line, coil, realisation
    product = matrix @ matrix.conj().swapaxes(1, 2)
    power = np.abs(product[:, 0, 0])
    assert np.abs(product - power[:, None, None] * np.eye(3)).max() < 1e-9 * power.max()


def test_each_realisation_begins_without_a_jump_and_repeats() -> None:
    force = orthogonal_excitation(SWEEP, RATE)
    assert len(force) == 12_000
    for begin in range(0, 12_000, 3000):
        assert np.abs(force[begin : begin + 5]).max() < 0.05
        assert np.array_equal(force[begin + 1000 : begin + 2000], force[begin + 2000 :][:1000])


def test_the_travel_of_each_coil_is_that_of_the_sweep() -> None:
    actuator = ActuatorParameters()

    def travel(force: FloatArray) -> float:
        estimator = TravelEstimator(actuator, RATE)
        return max(abs(estimator.observe(each, 0.0)) for each in force.tolist())

    most = travel(sweep(SWEEP, RATE))
    for force in orthogonal_excitation(SWEEP, RATE).T:
        assert travel(force) == pytest.approx(most, rel=0.05)
    assert most < 0.7 * actuator.travel


def test_a_handle_with_one_coil_has_the_sweep() -> None:
    (along,) = trial_forces(Axes(("z",)), SWEEP, RATE).T
    assert np.array_equal(along, excitation(SWEEP, RATE))
    assert trial_forces(ALL_AXES, SWEEP, RATE).shape == (12_000, 3)
    with pytest.raises(ParameterError, match="axes = x, z: must be one, or x, y, z"):
        trial_forces(Axes(("x", "z")), SWEEP, RATE)


def test_a_band_beyond_half_the_rate_is_refused() -> None:
    with pytest.raises(ParameterError, match="end_frequency = 600"):
        multisine(SweepParameters(end_frequency=600.0), RATE)


def recording(trials: int = 2) -> tuple[FloatArray, FloatArray]:
    """Return forces and accelerations of trials with rests between them."""
    wanted = orthogonal_excitation(SWEEP, RATE)
    rest = np.zeros((700, 3))
    force = np.concatenate([rest, *([wanted, rest] * trials)])
    return force, np.random.default_rng(0).normal(0.0, 1.0, force.shape)


def found(force: FloatArray, acceleration: FloatArray) -> list[int]:
    wanted = orthogonal_excitation(SWEEP, RATE)
    trials = find_trials(force, acceleration, SWEEP, RATE, None, 3, wanted)
    assert all(trial.actuator_force.shape == (12_003, 3) for trial in trials)
    assert all(len(trial.aligned.handle_acceleration) == 12_000 for trial in trials)
    return [
        int(np.flatnonzero((acceleration == trial.handle_acceleration[0]).all(axis=1))[0])
        for trial in trials
    ]


def test_trials_are_found_in_a_recording() -> None:
    assert found(*recording()) == [700, 13_400]


def test_another_excitation_is_refused() -> None:
    force, acceleration = recording()
    with pytest.raises(RecordingError, match="actuator_force: correlates"):
        found(force[:, ::-1].copy(), acceleration)


def test_nan_in_an_axis_is_refused_with_its_name() -> None:
    force, acceleration = recording()
    acceleration[40, 1] = math.nan
    with pytest.raises(RecordingError, match="^axis y: handle_acceleration: holds NaN"):
        found(force, acceleration)

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
"""Estimate of a 3x3 response against a known one, and what is refused by axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.matrix_response import (
    MatrixResponse,
    check_matrix_response,
    matrix_response,
)
from haptic_accel.core.identification.multisine import orthogonal_excitation
from haptic_accel.core.identification.sweep import IdentificationTrial
from haptic_accel.core.model import FloatArray
from three_coils import NOISE, RANGE, RATE, SWEEP, moved, plant, recorded, trials

FORCE = orthogonal_excitation(SWEEP, RATE)
HANDLE = plant()
CLEAN = moved(HANDLE, FORCE)


def estimate(*seeds: int) -> MatrixResponse:
    return matrix_response([recorded(CLEAN, FORCE, seed) for seed in seeds], SWEEP)


def test_settled_periods_give_the_response_without_an_error_of_its_own() -> None:
    found = matrix_response([IdentificationTrial(RATE, FORCE, CLEAN, {})], SWEEP)
    assert found.frequency[[0, -1]] == pytest.approx(SWEEP.band)
    assert found.response == pytest.approx(HANDLE.response(found.frequency, RATE), rel=1e-4)
    assert found.coherence == pytest.approx(1.0)


def test_its_standard_deviation_is_that_of_the_noise() -> None:
    scaled = []
    for seed in range(10):
        found = estimate(seed)
        error = (found.response - HANDLE.response(found.frequency, RATE)) / found.deviation
        scaled += [error.real, error.imag]
    assert np.std(scaled, axis=(0, 1)) == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.mean(scaled, axis=(0, 1))).max() < 0.05


def test_the_multiple_coherence_is_the_share_that_all_forces_explain() -> None:
    found = estimate(0, 1)
    forces = np.abs(np.fft.rfft(FORCE[2000:3000], axis=0)[8:451]) ** 2
    signal = np.sum(np.abs(HANDLE.response(found.frequency, RATE)) ** 2 * forces[:, None], axis=2)
    share = signal / (signal + 1000 * NOISE**2)
    assert found.coherence.mean(axis=0) == pytest.approx(share.mean(axis=0), abs=0.002)


def test_coupling_and_condition_are_those_of_the_plant() -> None:
    found = estimate(0)
    true = HANDLE.response(found.frequency, RATE)
    power = np.mean(np.abs(true) ** 2, axis=0)
    assert found.cross_coupling == pytest.approx(10 * np.log10(power / np.diag(power)), abs=0.1)
    assert found.condition[100] == pytest.approx(np.linalg.cond(true[100]), rel=0.02)


def spoilt(name: str) -> list[IdentificationTrial]:
    """Return trials of a handle with a fault of axis y."""
    handle, (trial, *_) = plant(), trials(HANDLE, 1)
    directions = handle.directions.copy()
    acceleration = trial.handle_acceleration.copy()
    if name in ("coil without current", "coil reversed", "coils swapped", "coil turned"):
        driven: FloatArray = FORCE.copy()
        if name == "coil without current":
            driven[:, 1] = 0.0
        elif name == "coil reversed":
            driven[:, 1] *= -1.0
        elif name == "coils swapped":
            driven = driven[:, [0, 2, 1]]
        else:
            directions[:, 1] = (0.2, 0.3, 1.0)
            handle = plant(directions)
        return [recorded(moved(handle, driven), FORCE)]
    if name == "nan":
        acceleration[77, 1] = np.nan
    elif name == "constant":
        acceleration[:, 1] = 0.5
    elif name == "noise":
        acceleration[:, 1] = np.random.default_rng(1).normal(0.0, NOISE, len(acceleration))
    elif name == "saturated":
        acceleration[:, 1] = np.clip(8 * acceleration[:, 1], -RANGE, RANGE)
    elif name == "silent":
        return [replace(trial, actuator_force=FORCE * (1.0, 1e-3, 1.0))]
    return [replace(trial, handle_acceleration=acceleration)]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("nan", "axis y: handle_acceleration: holds NaN"),
        ("constant", "axis y: handle_acceleration: constant at 0.5 m/s"),
        ("noise", "axis y: multiple coherence = 0.[01]. .* must be at least 0.7"),
        ("saturated", "axis y: handle_acceleration: .* at the sensor's range of 49"),
        ("silent", "axis y: actuator_force: .* N root mean square .* at least 0.01 N"),
        (
            "coil without current",
            "axis y: coherence = 0.[01]. of its coil .* is the coil connected",
        ),
        ("coil reversed", "axis y: its coil pushes against the axis"),
        ("coils swapped", "axes y and z: the coil of each moves the other axis"),
        ("coil turned", "axis y: its coil moves axis z the most, .* is it mounted along y"),
    ],
)
def test_a_fault_is_refused_by_axis(fault: str, message: str) -> None:
    recording = spoilt(fault)
    with pytest.raises(RecordingError, match=f"^{message}") as caught:
        check_matrix_response(matrix_response(recording, SWEEP), recording, RANGE)
    assert "\n" not in str(caught.value)


def test_a_good_recording_passes() -> None:
    recording = trials(HANDLE)
    check_matrix_response(matrix_response(recording, SWEEP), recording, RANGE)

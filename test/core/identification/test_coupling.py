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
"""Coupling of three coils against known ones, and doubts on it."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.identification.coupling import Coupling, above, fit_coupling
from haptic_accel.core.identification.matrix_response import MatrixResponse
from haptic_accel.core.identification.three_axes import coupling_doubts
from haptic_accel.core.model import ComplexArray, MountParameters

RATE = 1000.0
LINES = np.arange(8.0, 451.0)
MOUNTS = (MountParameters(200.0, 0.1), MountParameters(330.0, 0.1), MountParameters(290.0, 0.1))
DIRECTIONS = np.array([[1.0, 0.3, -0.2], [0.25, 1.0, 0.15], [0.2, -0.3, 1.0]])


def responses(frequency: np.ndarray) -> ComplexArray:
    """Return responses of a coil with the mount of each axis, (n, 3)."""
    return np.stack([Plant(mount=each).response(frequency, RATE) for each in MOUNTS], axis=1)


def measured(noise: float) -> tuple[MatrixResponse, ComplexArray, ComplexArray]:
    """Return the noisy response of rigidly coupled, equal coils, and the arguments of a fit."""
    own = responses(LINES)
    clean = DIRECTIONS * own[:, :, np.newaxis]  # the mount is that of the sensor's axis
    random = np.random.default_rng(1)
    deviation = np.full(clean.shape, noise)
    scatter = random.normal(0.0, noise, (2, *clean.shape))
    ones = np.ones((len(LINES), 3))
    lines = np.ones(501, dtype=bool)
    found = MatrixResponse(
        LINES, clean + scatter[0] + 1j * scatter[1], deviation, ones, clean.real, RATE, 8, lines
    )
    with_all = responses(np.append(LINES, above(found)))
    return found, own, with_all[:, :, np.newaxis] / with_all[:, np.newaxis, :]


def worst(found: Coupling, own: ComplexArray) -> float:
    """Return the largest error of the impulse responses' elements, relative to the true ones."""
    turns = np.outer(LINES, np.arange(found.taps.shape[2])) / RATE
    modelled = np.moveaxis(found.taps @ np.exp(-2j * np.pi * turns).T, 2, 0)
    true = DIRECTIONS * own[:, :, np.newaxis] / own[:, np.newaxis, :]
    inside = (LINES >= 20.0) & (LINES <= 400.0)
    return float(np.abs(modelled / true - 1.0)[inside].max())


def test_modes_of_the_axes_need_not_be_found_in_the_noise() -> None:
    found, own, passed = measured(noise=0.2)
    known = fit_coupling(found, own, passed)
    # Least squares knows a constant of 443 complex lines, the largest of them 40 m/s^2 per N.
    assert worst(known, own) < 0.03
    unknown = fit_coupling(found, own, np.ones_like(passed))
    assert worst(unknown, own) > 2.0 * worst(known, own)
    assert coupling_doubts(found, known, own) == []


def test_a_wrong_ratio_of_modes_is_not_used() -> None:
    found, own, passed = measured(noise=0.02)
    wrong = fit_coupling(found, own, passed.conj() ** 2)
    assert worst(wrong, own) < 0.1


def test_what_the_model_does_not_explain_or_noise_hides_is_doubted() -> None:
    found, own, passed = measured(noise=0.02)
    fitted = fit_coupling(found, own, passed)
    off = fitted.taps.copy()
    off[2, 1] *= 1.2
    (doubt,) = coupling_doubts(found, fitted._replace(taps=off), own)
    assert doubt.startswith("axis z, coil y: the model differs from the measured response by 17 %")
    noisy, own, passed = measured(noise=3.0)
    doubts = coupling_doubts(noisy, fit_coupling(noisy, own, passed), own)
    assert doubts
    assert any("is known within" in each and "use more trials" in each for each in doubts)


@pytest.mark.parametrize("noise", [0.02, 0.5])
def test_the_stated_deviation_is_that_of_the_error(noise: float) -> None:
    found, own, passed = measured(noise)
    fitted = fit_coupling(found, own, passed)
    true = DIRECTIONS * own[:, :, np.newaxis] / own[:, np.newaxis, :]
    within = np.abs(fitted.response - true) < 3.0 * np.sqrt(2.0) * fitted.deviation
    assert within.mean() > 0.9

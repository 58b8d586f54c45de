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

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces import line_spectrum

RISING = st.lists(st.floats(0.05, 1.0), min_size=1, max_size=21).map(
    lambda steps: np.cumsum(steps)[:-1] * np.pi / np.sum(steps)
)
"""Up to 20 line spectral frequencies in (0, pi), none close to another."""


def test_known_line_spectra() -> None:
    # 1 / A(z) = 1: the frequencies lie at equal distances; order 1: at arccos(-a_1).
    assert line_spectrum.from_polynomial(np.array([1.0, 0.0, 0.0])) == pytest.approx(
        np.pi / 3 * np.arange(1, 3)
    )
    assert line_spectrum.from_polynomial(np.array([1.0, -0.5])) == pytest.approx(np.arccos(0.5))
    assert line_spectrum.to_polynomial(np.empty((2, 0))).tolist() == [[1.0], [1.0]]


@given(RISING)
def test_rising_frequencies_are_those_of_a_stable_polynomial(lsf: np.ndarray) -> None:
    polynomial = line_spectrum.to_polynomial(lsf)
    assert np.all(np.abs(np.roots(polynomial)) < 1 + 1e-9)
    assert line_spectrum.from_polynomial(polynomial) == pytest.approx(lsf, abs=1e-6)


def test_an_unstable_polynomial_is_refused() -> None:
    with pytest.raises(ParameterError, match="not inside the unit circle"):
        line_spectrum.from_polynomial(np.array([1.0, -2.0, 1.5]))


def test_order_is_strict_and_within_zero_to_pi() -> None:
    assert line_spectrum.is_ordered(np.array([[0.1, 0.2], [1.0, 3.1]]))
    for wrong in ([0.0, 1.0], [0.2, 0.2], [0.3, 0.2], [1.0, np.pi]):
        assert not line_spectrum.is_ordered(np.array([[0.1, 0.2], wrong]))


def test_levinson_finds_the_filter_of_an_autocovariance() -> None:
    polynomial = np.array([1.0, -1.2, 0.72])
    response = lfilter([2.0], polynomial, np.eye(1, 500)[0])
    covariance = np.array([response[lag:] @ response[: 500 - lag] for lag in range(5)])
    (found, white), variances = line_spectrum.levinson(np.array([covariance, np.eye(1, 5)[0]]))
    assert found == pytest.approx([*polynomial, 0.0, 0.0], abs=1e-6)
    assert variances[0, [0, 2, 4]] == pytest.approx([covariance[0], 4.0, 4.0])
    assert white.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]


@given(RISING)
def test_an_autocovariance_solves_the_equations_of_its_polynomial(lsf: np.ndarray) -> None:
    polynomial = line_spectrum.to_polynomial(lsf)
    covariance = line_spectrum.autocovariance(polynomial, lags=len(lsf) + 3)
    extended = np.append(polynomial, np.zeros(3))
    innovation = toeplitz(covariance) @ extended  # Yule and Walker
    assert innovation == pytest.approx(np.eye(1, len(extended))[0], abs=1e-7 * covariance[0])


def test_the_power_of_filtered_noise_is_the_sum_of_the_squares_of_its_response() -> None:
    forward, feedback = np.array([2.0, 0.5, -0.3, 0.1]), np.array([1.0, -1.2, 0.72])
    response = lfilter(forward, feedback, np.eye(1, 500)[0])
    assert line_spectrum.power_gain(forward, feedback) == pytest.approx(response @ response)
    pair = line_spectrum.power_gain(
        np.array([forward, [1, 0, 0, 0]]), np.array([feedback, [1.0, -0.5, 0.0]])
    )
    assert pair == pytest.approx([response @ response, 4 / 3])

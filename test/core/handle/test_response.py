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

"""Responses of the handle against eq. (1) to (3) of the paper, solved by themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.handle.response import inverse_terms, sampled_response, travel_response
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, handle_model

RATE = 1000.0
FREQUENCY = np.linspace(10.0, 450.0, 45)
TABLE_I = HandleParameters()

grips = st.builds(
    HandleParameters, m_h=st.floats(0.02, 1.0), k_u=st.floats(0.0, 1e4), b_u=st.floats(0.0, 100.0)
)


def by_aliases(frequency: FloatArray, rate: float, delay: float) -> ComplexArray:
    """Sum eq. (1) and (2), solved by themselves, behind hold, delay and low-pass over aliases."""
    p = TABLE_I
    total = np.zeros(len(frequency), dtype=complex)
    for turn in range(-2000, 2001):
        alias = frequency + turn * rate
        s = 2j * np.pi * alias
        spring = p.k_s + p.b_s * s
        motion = np.array(
            [
                [p.m_a * s**2 + spring, -spring],
                [-spring, p.m_h * s**2 + spring + p.k_u + p.b_u * s],
            ]
        )
        y_h = np.linalg.solve(np.moveaxis(motion, -1, 0), np.array([[[-1.0], [1.0]]]))[:, 1, 0]
        hold = np.sinc(alias / rate) * np.exp(-1j * np.pi * alias / rate)
        total += hold * s**2 * y_h / (1 + 1j * alias / 500.0) * np.exp(-s * delay)
    return total


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 1.0e-3, 2.4e-3, -0.2e-3])
def test_samples_see_the_sum_of_all_aliases(delay: float) -> None:
    expected = by_aliases(FREQUENCY, RATE, delay)
    response = sampled_response(TABLE_I, FREQUENCY, RATE, delay)
    assert np.abs(response / expected - 1).max() < 1e-3  # the sum's own remainder


def test_at_a_high_rate_it_is_the_continuous_system() -> None:
    sampled = sampled_response(TABLE_I, FREQUENCY, 1e6)
    smooth = handle_model(TABLE_I).response(FREQUENCY) / (1 + 1j * FREQUENCY / 500.0)
    assert sampled == pytest.approx(smooth, rel=2e-3)


@given(grips)
def test_the_terms_add_up_to_the_inverse_of_eq_3(handle: HandleParameters) -> None:
    frequency = np.geomspace(0.5, 2000.0, 40)
    found = np.array([handle.m_h, handle.b_u, handle.k_u, 1.0]) @ inverse_terms(handle, frequency)
    assert found * handle_model(handle).response(frequency) == pytest.approx(1.0, rel=1e-7)


def test_a_slow_force_stretches_the_spring() -> None:
    travel = travel_response(HandleParameters(), np.array([0.01]))
    assert travel == pytest.approx(-1 / 266.0, rel=1e-3)


def test_a_fast_force_moves_both_masses_apart() -> None:
    frequency = 5000.0
    travel = travel_response(HandleParameters(), np.array([frequency]))
    apart = (1 / 0.018 + 1 / 0.128) / (2 * math.pi * frequency) ** 2
    assert abs(travel) == pytest.approx(apart, rel=1e-3)

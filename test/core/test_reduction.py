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

"""Three axes to one, on signals whose reduction is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from haptic_accel.core.reduction import REDUCTIONS, dft321, magnitude, principal, total

TIME = np.arange(1000) / 1000.0
WAVE = np.sin(2 * np.pi * 50.0 * TIME)
recordings = arrays.arrays(
    np.float64, st.tuples(st.integers(1, 64), st.just(3)), elements=st.floats(-50.0, 50.0)
)


@pytest.mark.parametrize("reduced", [dft321, principal, total], ids=lambda each: each.__name__)
def test_a_vibration_along_one_axis_stays_as_it_is(reduced: object) -> None:
    alone = np.column_stack([0 * TIME, WAVE, 0 * TIME])
    np.testing.assert_allclose(reduced(alone), WAVE, atol=1e-9)  # type: ignore[operator]


@settings(deadline=None)
@given(recordings)
def test_dft321_keeps_the_energy_of_all_axes(acceleration: np.ndarray) -> None:
    # Parseval's theorem, as each line of the spectrum has the power of the three.
    assert np.sum(dft321(acceleration) ** 2) == pytest.approx(np.sum(acceleration**2), abs=1e-6)


def test_the_sum_cancels_what_dft321_keeps() -> None:
    opposite = np.column_stack([WAVE, -WAVE, 0 * TIME])
    assert np.abs(total(opposite)).max() < 1e-12
    assert dft321(opposite).std() == pytest.approx(np.sqrt(2) * WAVE.std())


def test_a_circle_has_half_of_its_power_along_one_direction_and_a_constant_length() -> None:
    circle = np.column_stack([WAVE, np.cos(2 * np.pi * 50.0 * TIME), 0 * TIME])
    assert principal(circle).std() == pytest.approx(WAVE.std(), rel=1e-3)
    np.testing.assert_allclose(magnitude(circle), 1.0)
    assert dft321(circle).std() == pytest.approx(np.sqrt(2) * WAVE.std())


def test_an_oscillation_has_its_length_twice_a_period() -> None:
    slanted = np.outer(WAVE, [0.6, 0.0, 0.8])
    lines = np.abs(np.fft.rfft(magnitude(slanted) - magnitude(slanted).mean()))
    assert lines.argmax() == 100
    np.testing.assert_allclose(principal(slanted), WAVE, atol=1e-9)


@settings(deadline=None)
@given(recordings)
def test_every_reduction_gives_one_finite_value_for_each_sample(acceleration: np.ndarray) -> None:
    for reduced in REDUCTIONS.values():
        found = reduced(acceleration)
        assert found.shape == (len(acceleration),)
        assert np.isfinite(found).all()

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

"""Gain and offset from gravity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.model import GRAVITY
from haptic_accel.devices.serial.calibration import (
    CalibrationError,
    Rest,
    calibrate,
    rest,
)

NOMINAL = 49.0 / 32767


@given(st.floats(0.8, 1.2), st.sampled_from([-1, 1]), st.floats(-3000, 3000))
def test_a_flip_finds_gain_and_offset(factor: float, sign: int, offset: float) -> None:
    gain = sign * factor * NOMINAL
    up, down = (Rest(offset + g / gain, 0.3, 40.0) for g in (GRAVITY, -GRAVITY))
    found = calibrate(up, down, NOMINAL)
    assert found.gain == pytest.approx(gain)
    assert found.offset == pytest.approx(offset, abs=1e-6)


def test_standard_errors_are_those_of_repeated_measurements() -> None:
    rng = np.random.default_rng(1)
    noise = 46.0  # counts of an ADXL320J

    def measured() -> tuple[float, float, float, float]:
        up, down = (rest(rng.normal(level, noise, 1000), NOMINAL) for level in (6600.0, -6500.0))
        found = calibrate(up, down, NOMINAL)
        return found.gain, found.gain_error, found.offset, found.offset_error

    gains, gain_errors, offsets, offset_errors = np.array([measured() for _ in range(400)]).T
    assert gain_errors.mean() == pytest.approx(gains.std(), rel=0.1)
    assert offset_errors.mean() == pytest.approx(offsets.std(), rel=0.1)


def test_the_noise_is_that_of_a_sample() -> None:
    rng = np.random.default_rng(1)
    up, down = (rest(rng.normal(level, 50.0, 4000), NOMINAL) for level in (6558.0, -6558.0))
    assert calibrate(up, down, NOMINAL).noise == pytest.approx(50 * NOMINAL, rel=0.05)


@pytest.mark.parametrize(
    ("counts", "named"),
    [
        (1000 * np.sin(np.arange(1000.0)), "it moved"),
        (np.linspace(0, 200, 1000), "it moved"),
        (np.zeros(9), "9 samples"),
        (np.zeros(0), "0 samples"),
    ],
)
def test_what_does_not_rest_is_refused(counts: np.ndarray, named: str) -> None:
    with pytest.raises(CalibrationError, match=named):
        rest(counts, NOMINAL)


@pytest.mark.parametrize("apart", [0.0, 0.5 * GRAVITY, 1.4 * 2 * GRAVITY])
def test_what_is_not_turned_over_is_refused(apart: float) -> None:
    up, down = (Rest(sign * apart / 2 / NOMINAL, 0.3, 40.0) for sign in (1, -1))
    with pytest.raises(CalibrationError, match="should by about 19.6"):
        calibrate(up, down, NOMINAL)

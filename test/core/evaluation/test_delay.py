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

"""The delay of copies whose delay is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.evaluation.delay import LONGEST_DELAY, estimate_delay, shift_back
from haptic_accel.core.model import FloatArray

RATE = 1000.0


def noise(seed: int, length: int = 2000) -> FloatArray:
    return np.random.default_rng(seed).normal(size=length)


def tones(seconds: float, rate: float = RATE, length: int = 3000) -> FloatArray:
    """Return a band-limited signal as it is some time later, from its formula."""
    time = np.arange(length) / rate - seconds
    frequencies = np.array([31.0, 47.0, 83.0, 101.0, 139.0, 167.0, 211.0])
    phases = np.arange(len(frequencies)) ** 2
    return np.asarray(np.sin(2 * np.pi * np.outer(time, frequencies) + phases).sum(axis=1))


@settings(max_examples=30)
@given(st.integers(-15, 15), st.integers(0, 5))
def test_whole_samples_are_found(samples: int, seed: int) -> None:
    long = noise(seed)
    desired, actual = long[20:-20], 0.3 * long[20 - samples : len(long) - 20 - samples]
    found = estimate_delay(desired, actual, RATE)
    assert found.seconds == pytest.approx(samples / RATE, abs=0.01 / RATE)
    assert found.correlation > 0.98


@settings(max_examples=30)
@given(st.floats(-5e-3, 5e-3))
def test_fractions_of_a_sample_are_found(seconds: float) -> None:
    found = estimate_delay(tones(0.0), tones(seconds), RATE)
    assert found.seconds == pytest.approx(seconds, abs=0.02 / RATE)


@settings(max_examples=30)
@given(st.floats(-5e-3, 5e-3))
def test_a_delay_is_taken_back(seconds: float) -> None:
    desired, actual = shift_back(tones(0.0), tones(seconds), RATE, seconds)
    inner = slice(300, -300)  # what the ends lack decays slowly
    error = np.linalg.norm((actual - desired)[inner]) / np.linalg.norm(desired[inner])
    assert error < 0.01


@pytest.mark.parametrize("samples", [0, 1, 7, -3])
def test_whole_samples_are_taken_back_exactly(samples: int) -> None:
    long = noise(1)
    desired, actual = long[20:-20], long[20 - samples : len(long) - 20 - samples]
    first, second = shift_back(desired, actual, RATE, samples / RATE)
    np.testing.assert_array_equal(first, second)
    assert len(first) == len(desired) - abs(samples)


def test_what_is_not_alike_has_no_delay() -> None:
    assert math.isnan(estimate_delay(noise(1), noise(2), RATE).seconds)
    assert math.isnan(estimate_delay(noise(1), np.zeros(2000), RATE).seconds)
    assert math.isnan(estimate_delay(np.ones(2000), noise(2), RATE).seconds)
    assert math.isnan(estimate_delay(np.zeros(0), np.zeros(0), RATE).seconds)


def test_a_delay_beyond_the_longest_is_not_told() -> None:
    long = noise(3)
    lag = round(2 * LONGEST_DELAY * RATE)
    assert math.isnan(estimate_delay(long[lag:], long[:-lag], RATE).seconds)


def test_opposed_signals_are_not_alike_at_no_lag() -> None:
    found = estimate_delay(noise(4), -noise(4), RATE)
    assert math.isnan(found.seconds)


def test_a_signal_shorter_than_the_shift_is_refused() -> None:
    with pytest.raises(ValueError, match="samples"):
        shift_back(np.ones(10), np.ones(10), RATE, 0.02)
    with pytest.raises(ValueError, match="fraction"):
        shift_back(np.ones(40), np.ones(40), RATE, 0.5e-3)

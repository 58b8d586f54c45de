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

"""The position between the counts of encoders: its error is bounded, and none for smooth arms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.coupling.count_observer import CountObserver
from haptic_accel.core.model import FloatArray

COUNT = 55e-6
"""Step of the arm's encoders, m."""


def moved(rate: float, seconds: float = 3.0) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of a tip that vibrates at 40 Hz while it creeps, m and m/s."""
    time = np.arange(round(seconds * rate)) / rate
    turn = 2 * math.pi * 40.0
    return (
        1e-3 * time + 30e-6 * np.sin(turn * time),
        1e-3 + 30e-6 * turn * np.cos(turn * time),
    )


def estimated(measured: FloatArray, velocity: FloatArray, rate: float) -> FloatArray:
    observer = CountObserver(rate)
    pairs = zip(measured.tolist(), velocity.tolist(), strict=True)
    return np.array([x - observer.rounding((0.0, 0.0, x), (0.0, 0.0, v))[2] for x, v in pairs])


def rounded(position: FloatArray) -> FloatArray:
    return np.asarray(np.round(position / COUNT) * COUNT)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_between_counts_the_velocity_tells_where_the_arm_is(rate: float) -> None:
    position, velocity = moved(rate)
    error = estimated(rounded(position), velocity, rate) - position
    settled = round(rate)
    # Rounding alone has the standard deviation of a uniform distribution.
    assert np.std(error[settled:]) < 0.4 * COUNT / math.sqrt(12)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_a_smooth_arm_is_where_it_is_measured(rate: float) -> None:
    position, velocity = moved(rate)
    assert np.array_equal(estimated(position, velocity, rate), position)


def test_an_arm_without_velocity_is_where_it_is_measured() -> None:
    position, _ = moved(1000.0)
    measured = rounded(position)
    assert estimated(measured, np.zeros(len(measured)), 1000.0) == pytest.approx(measured)


def test_a_velocity_from_differences_changes_nothing() -> None:
    position, _ = moved(1000.0)
    measured = rounded(position)
    velocity = np.diff(measured, prepend=measured[0]) * 1000.0
    # The mean of two such velocities is half a sample late.
    assert estimated(measured, velocity, 1000.0) == pytest.approx(measured, abs=COUNT)


@given(
    steps=st.lists(st.floats(-1e-3, 1e-3), min_size=2, max_size=100),
    speeds=st.lists(st.floats(-1.0, 1.0), min_size=100, max_size=100),
)
def test_the_estimate_is_never_farther_away_than_the_largest_unexplained_step(
    steps: list[float], speeds: list[float]
) -> None:
    rate = 1000.0
    measured = np.cumsum(steps)
    velocity = np.array(speeds[: len(steps)])
    explained = (velocity[1:] + velocity[:-1]) / 2 / rate
    largest = max(abs(np.diff(measured) - explained))
    error = estimated(measured, velocity, rate) - measured
    assert max(abs(error)) <= largest + 1e-12


def test_after_a_restart_the_measured_position_counts() -> None:
    observer = CountObserver(1000.0)
    for tick in range(100):
        observer.rounding((0.0, 0.0, COUNT * (tick // 7)), (0.0, 0.0, COUNT * 1000 / 7))
    observer.restart()
    assert observer.rounding((0.0, 1.0, -1.0), (0.1, 0.1, 0.1)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("place", [0.1, math.nan, math.inf])
def test_a_jump_is_no_count(place: float) -> None:
    observer = CountObserver(1000.0)
    for tick in range(100):
        observer.rounding((0.0, 0.0, COUNT * (tick // 7)), (0.0, 0.0, COUNT * 1000 / 7))
    for position in (place, 0.0, 0.0):
        assert observer.rounding((0.0, 0.0, position), (0.0, 0.0, 0.01)) == pytest.approx(
            (0.0, 0.0, 0.0), abs=2e-5
        )

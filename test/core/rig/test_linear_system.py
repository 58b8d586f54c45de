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

"""Linear mechanics against their closed solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.rig.linear_system import LinearSystem

untimed = settings(deadline=None)
STEP = 1e-4


def oscillator(omega: float, zeta: float, longest: int = 50) -> LinearSystem:
    """Return x'' + 2 zeta omega x' + omega^2 x = u as a system with states x, x'."""
    a = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
    return LinearSystem(a, np.array([[0.0], [1.0]]), STEP, longest)


@untimed
@given(
    st.floats(1.0, 1000.0),
    st.floats(0.0, 0.95),
    st.floats(-1.0, 1.0),
    st.floats(-10.0, 10.0),
    st.floats(-100.0, 100.0),
    st.integers(0, 400),
)
def test_a_damped_oscillator_under_a_constant_force(
    omega: float, zeta: float, x0: float, v0: float, force: float, steps: int
) -> None:
    system = oscillator(omega, zeta)
    system.state[:] = x0, v0
    system.inputs[0] = force
    system.advance(steps)

    time = steps * STEP
    rest = force / omega**2
    decay, damped = zeta * omega, omega * math.sqrt(1 - zeta**2)
    cosine, sine = math.cos(damped * time), math.sin(damped * time)
    start, speed = x0 - rest, (v0 + decay * (x0 - rest)) / damped
    envelope = math.exp(-decay * time)
    x = rest + envelope * (start * cosine + speed * sine)
    v = envelope * (
        (-decay * start + damped * speed) * cosine - (decay * speed + damped * start) * sine
    )
    size = abs(start) + abs(speed) + abs(rest)
    assert system.state == pytest.approx([x, v], abs=1e-9 * (1 + omega * size))


def test_a_double_integrator_falls_freely() -> None:
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    system = LinearSystem(a, b, STEP, 10)
    system.inputs[0] = 9.81
    system.advance(10_000)
    assert system.state == pytest.approx([9.81 / 2, 9.81])


@untimed
@given(st.lists(st.integers(0, 60), min_size=1, max_size=10), st.integers(1, 100))
def test_how_an_interval_is_divided_does_not_matter(parts: list[int], longest: int) -> None:
    whole, divided = oscillator(300.0, 0.1, longest), oscillator(300.0, 0.1, longest)
    for system in (whole, divided):
        system.state[:] = 0.001, 0.2
        system.inputs[0] = 5.0
    whole.advance(sum(parts))
    for part in parts:
        divided.advance(part)
    assert divided.state == pytest.approx(whole.state, abs=1e-12)


def test_ten_times_ten_steps_are_a_hundred() -> None:
    whole, divided = oscillator(300.0, 0.1, 100), oscillator(300.0, 0.1, 100)
    for system in (whole, divided):
        system.state[:] = 0.001, 0.2
    whole.advance(100)
    for _ in range(10):
        divided.advance(10)
    assert divided.state == pytest.approx(whole.state, rel=1e-12)


def test_no_step_changes_nothing() -> None:
    system = oscillator(300.0, 0.1)
    system.state[:] = 1.0, 2.0
    system.advance(0)
    assert system.state.tolist() == [1.0, 2.0]


def test_a_step_of_force_on_a_free_mass() -> None:
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0], [0.0, 1.0]])
    time = STEP * np.arange(1, 11)
    response = LinearSystem(a, b, STEP, 10).step_response(1)
    assert response == pytest.approx(np.stack([time**2 / 2, time], axis=1), rel=1e-12)

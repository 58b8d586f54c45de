# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Transitions of linear mechanics against their closed solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import FloatArray
from haptic_accel.core.rig.master_rig import transitions

untimed = settings(deadline=None)
STEP = 1e-4


def advanced(a: FloatArray, b: FloatArray, joint: list[float], *blocks: int) -> FloatArray:
    """Return the state after blocks of steps, from states and constant inputs."""
    found = transitions(a, b, STEP, max(1, *blocks)).reshape(-1, len(joint), len(a))
    state, inputs = np.split(np.array(joint), [len(a)])
    for steps in blocks:
        state = np.concatenate([state, inputs]) @ found[steps - 1] if steps else state
    return state


def oscillator(omega: float, zeta: float) -> tuple[FloatArray, FloatArray]:
    """Return x'' + 2 zeta omega x' + omega^2 x = u as a system with states x, x'."""
    return np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]]), np.array([[0.0], [1.0]])


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
    state = advanced(*oscillator(omega, zeta), [x0, v0, force], steps)
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
    assert state == pytest.approx([x, v], abs=1e-9 * (1 + omega * size))


def test_a_double_integrator_falls_freely() -> None:
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    assert advanced(a, b, [0.0, 0.0, 9.81], *[10] * 1000) == pytest.approx([9.81 / 2, 9.81])


@untimed
@given(st.lists(st.integers(0, 60), min_size=1, max_size=10))
def test_how_an_interval_is_divided_does_not_matter(parts: list[int]) -> None:
    mechanics, joint = oscillator(300.0, 0.1), [0.001, 0.2, 5.0]
    whole = advanced(*mechanics, joint, sum(parts))
    assert advanced(*mechanics, joint, *parts) == pytest.approx(whole, abs=1e-12)

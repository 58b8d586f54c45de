# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The handle model against the equations of motion, and the approximate model's numbers."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from haptic_accel.core.model import ApproximateModel, HandleParameters, handle_model


def acceleration_over_force(frequency: float, p: HandleParameters) -> complex:
    """A_h/F_a by solving eq. (1) and (2) of the paper for Y_a and Y_h, the hand at rest."""
    s = 2j * math.pi * frequency
    spring = p.k_s + p.b_s * s
    motion = np.array(
        [[p.m_a * s**2 + spring, -spring], [-spring, p.m_h * s**2 + spring + p.k_u + p.b_u * s]]
    )
    _, y_h = np.linalg.solve(motion, np.array([-1.0, 1.0]))
    return complex(s**2 * y_h)


# The handle


@given(
    st.floats(1e-3, 1.0),
    st.floats(0.0, 2000.0),
    st.floats(0.0, 20.0),
    st.floats(1e-2, 1.0),
    st.floats(100.0, 3000.0),
    st.floats(1.0, 50.0),
    st.floats(1.0, 300.0),
)
@example(*astuple(HandleParameters()), 500.0)
def test_the_handle_model_solves_the_equations_of_motion(
    m_a: float, k_s: float, b_s: float, m_h: float, k_u: float, b_u: float, frequency: float
) -> None:
    # Without damping a resonance would be hit exactly.
    handle = HandleParameters(m_a, k_s, b_s + 0.1, m_h, k_u, b_u)
    response = handle_model(handle).response(frequency)
    assert response == pytest.approx(acceleration_over_force(frequency, handle), rel=1e-6)


def test_at_high_frequency_the_handle_is_its_mass() -> None:
    response = handle_model(HandleParameters()).response(1e6)
    assert response == pytest.approx(1 / 0.128, rel=1e-3)


def test_at_low_frequency_the_two_springs_decide() -> None:
    # m_a s^4 / (k_s k_u), where inertia and damping no longer matter
    response = handle_model(HandleParameters()).response(0.01)
    s = 2j * math.pi * 0.01
    assert response == pytest.approx(0.018 * s**4 / (266.0 * 1500.0), rel=1e-2)


def test_frequencies_in_an_array_give_an_array() -> None:
    model = handle_model(HandleParameters())
    frequency = np.array([[10.0, 20.0], [50.0, 100.0]])
    response = model.response(frequency)
    assert response.shape == (2, 2)
    assert response[1, 0] == model.response(50.0)


# The approximate model


def test_the_approximate_model_has_unit_gain_at_zero_frequency() -> None:
    assert ApproximateModel().model().response(0.0) == pytest.approx(1.0)


def test_its_high_frequency_gain_is_near_that_of_the_handle() -> None:
    # (15 x 20 / (9 x 12))^2
    response = ApproximateModel().model().response(1e5)
    assert abs(response) == pytest.approx(7.716, abs=5e-4)


def test_its_gain_is_a_factor() -> None:
    frequency = np.array([0.0, 10.0, 100.0])
    twice = ApproximateModel(gain=2.0).model().response(frequency)
    assert twice == pytest.approx(2 * ApproximateModel().model().response(frequency))


@pytest.mark.parametrize(
    ("polynomial", "pairs"),
    [("numerator", [(9.0, 0.5), (12.0, 0.3)]), ("denominator", [(15.0, 0.35), (20.0, 0.4)])],
)
def test_its_poles_and_zeros_are_the_papers(
    polynomial: str, pairs: list[tuple[float, float]]
) -> None:
    expected = []
    for frequency, damping in pairs:
        omega = 2 * math.pi * frequency
        root = omega * complex(-damping, math.sqrt(1 - damping**2))
        expected += [root, root.conjugate()]
    roots = np.roots(getattr(ApproximateModel().model(), polynomial))
    assert np.sort_complex(roots) == pytest.approx(np.sort_complex(np.array(expected)))


@pytest.mark.parametrize(
    ("frequency", "error"), [(30.0, 0.87), (50.0, 0.51), (100.0, 0.24), (200.0, 0.12)]
)
def test_it_differs_from_the_handle_mostly_in_phase(frequency: float, error: float) -> None:
    handle = acceleration_over_force(frequency, HandleParameters())
    approximate = ApproximateModel().model().response(frequency)
    assert abs(handle / approximate - 1) == pytest.approx(error, abs=0.005)

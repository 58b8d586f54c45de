# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The three conditions of the paper."""

from __future__ import annotations

import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.control.channel import build_controller
from haptic_accel.core.control.controllers import Loop
from haptic_accel.core.control.controllers.fixed import (
    ConstantController,
    ConstantParameters,
    DynamicController,
)
from haptic_accel.core.model import ApproximateModel

RATE = 1000.0

accelerations = st.floats(-1e3, 1e3)


@given(st.lists(st.tuples(st.floats(), st.floats())))
def test_no_acceleration_makes_a_force(samples: list[tuple[float, float]]) -> None:
    controller = build_controller("none", Loop(1000.0))
    assert all(controller.force(desired, measured) == 0.0 for desired, measured in samples)
    controller.reset()
    assert controller.force(1.0, 1.0) == 0.0


@given(accelerations, accelerations)
def test_force_is_mass_times_desired_acceleration(desired: float, measured: float) -> None:
    controller = build_controller("constant", Loop(1000.0))
    assert controller.force(desired, measured) == pytest.approx(0.128 * desired)


@given(st.floats(0.0, 10.0), st.lists(accelerations, min_size=1))
def test_the_mass_is_a_parameter_and_there_is_no_memory(mass: float, desired: list[float]) -> None:
    controller = ConstantController(ConstantParameters(mass), Loop(4000.0))
    forces = [controller.force(value, 0.0) for value in desired]
    assert forces == pytest.approx([mass * value for value in desired])
    controller.reset()
    assert controller.force(desired[0], 0.0) == forces[0]


def pair(frequency: float, damping: float, at: float) -> complex:
    """Return a complex pair's factor, one at zero frequency, at a frequency in Hz."""
    ratio = at / frequency
    return complex(1 - ratio**2, 2 * damping * ratio)


@pytest.mark.parametrize("frequency", [5.0, 10.0, 15.0, 20.0, 50.0, 100.0])
def test_a_sine_takes_the_gain_and_phase_of_the_papers_model(frequency: float) -> None:
    controller = build_controller("dynamic", Loop(RATE))
    angle = 2 * math.pi * frequency / RATE
    forces = [controller.force(math.cos(angle * index), 0.0) for index in range(3000)]
    # A whole second, hence whole periods, once it has settled.
    gain = sum(
        2 / 1000 * force * cmath.exp(-1j * angle * index)
        for index, force in enumerate(forces)
        if index >= 2000
    )
    model = (
        pair(9, 0.5, frequency)
        * pair(12, 0.3, frequency)
        / pair(15, 0.35, frequency)
        / pair(20, 0.4, frequency)
    )
    assert gain == pytest.approx(1 / model, rel=5e-3)


@pytest.mark.parametrize("name", ["dynamic", "inverse"])
def test_the_measured_acceleration_is_not_used(name: str) -> None:
    one, other = (build_controller(name, Loop(RATE)) for _ in range(2))
    for index in range(300):
        assert one.force(math.sin(index), 0.0) == other.force(math.sin(index), math.nan)


def test_reset_forgets_the_past() -> None:
    controller, fresh = (DynamicController(ApproximateModel(), Loop(RATE)) for _ in range(2))
    for index in range(100):
        controller.force(math.sin(index), 0.0)
    controller.reset()
    for index in range(100):
        assert controller.force(float(index), 0.0) == fresh.force(float(index), 0.0)

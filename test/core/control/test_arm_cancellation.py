# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The coil cancels what a known force of the arm does to the handle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core import model
from haptic_accel.core.axes import along_actuator
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.control.filters import cancelling_sections, high_passed, section_response
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.rig.master_rig import MasterRig, MasterRigParameters
from haptic_accel.core.tick.control import SampleFilter

CORNER = 5.0
"""A third of the high-pass, Hz: where the hand's own motion ends."""


@given(
    frequency=st.floats(2.0, 400.0),
    m_a=st.floats(0.005, 0.05),
    k_s=st.floats(0.0, 2000.0),
    b_s=st.floats(0.1, 10.0),
)
def test_the_arm_and_the_coil_cancel_above_the_corner(
    frequency: float, m_a: float, k_s: float, b_s: float
) -> None:
    # By eq. (1) and (2) the arm's force moves the handle by s^2 (m_a s^2 + b_s s + k_s) / D, the
    # coil's by m_a s^4 / D. What is left of the arm's part is 1 - (s / (s + w))^3, at any grip.
    rate = 20_000.0
    sections = cancelling_sections(model.Suspension(m_a=m_a, k_s=k_s, b_s=b_s), CORNER, rate)
    s = 2j * math.pi * frequency
    coil = -section_response(sections, np.array([frequency]), rate)[0]
    left = 1.0 + coil * m_a * s**2 / (m_a * s**2 + b_s * s + k_s)
    expected = 1.0 - (s / (s + 2 * math.pi * CORNER)) ** 3
    assert left == pytest.approx(expected, abs=0.02)


def test_a_steady_force_of_the_arm_needs_none_of_the_coil() -> None:
    cancelled = SampleFilter(cancelling_sections(model.Suspension(), CORNER, 1000.0))
    assert cancelled.process(0.1) == pytest.approx(0.1, rel=0.1)
    for _ in range(2000):
        force = cancelled.process(0.1)
    assert abs(force) < 1e-6


def shaken(controller: str, rate: float, gain: float = 1.0) -> tuple[float, float]:
    """Shake a handle by steps of the arm's force; return RMS acceleration and coil force."""
    handle = model.HandleParameters()
    silent = model.AccelerometerParameters(noise_density=0.0)
    rig = MasterRig(MasterRigParameters(handle=handle, accelerometer=silent), rate)
    parameters = CompensationParameters(controller=controller, gain=gain)
    compensation = Compensation(parameters, rate, {"plant": Plant(handle)}, latency=1)
    random = np.random.default_rng(1)
    # Encoder steps of 55 um through 250 N/m, at an interval of 5 ms on average.
    steps = 250.0 * 55e-6 * (random.random(round(3 * rate)) < 200.0 / rate)
    arm = np.cumsum(steps * random.choice([-1, 1], len(steps)))
    felt: list[float] = []
    forces: list[float] = []
    due = pushed = 0.0
    for tick, force in enumerate(arm.tolist()):
        rig.advance(tick / rate)
        sample = rig.measure()
        felt.append(sample.acceleration[2])
        rig.apply_arm_force(along_actuator(pushed))
        rig.apply_actuator_force(along_actuator(due))
        # The tool is still but for a last digit, so that the compensation is awake.
        tool = along_actuator(1e-9 * (tick % 2))
        compensation.count_z = force
        _, coil = compensation.process(tool, sample.acceleration)
        due, pushed = coil[2], force
        forces.append(due)
    settled = round(rate)
    vibration: model.FloatArray = high_passed(np.array(felt), 30.0, rate)
    return float(np.std(vibration[settled:])), float(np.std(forces[settled:]))


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_the_coil_forgives_the_steps_of_the_encoders(rate: float) -> None:
    alone, none = shaken("none", rate)
    cancelled, force = shaken("adaptive", rate)
    assert none == 0.0 < force
    # Above six corners, |1 - (s / (s + w))^3| is below 0.5.
    assert cancelled < 0.5 * alone


def test_without_gain_the_coil_is_still() -> None:
    assert shaken("adaptive", 1000.0, gain=0.0)[1] == 0.0
    # What cancels does not grow with the gain of the tool's acceleration.
    assert shaken("adaptive", 1000.0, gain=2.0)[1] == pytest.approx(
        shaken("adaptive", 1000.0)[1], rel=1e-3
    )

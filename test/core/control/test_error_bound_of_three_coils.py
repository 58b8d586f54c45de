# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The matrix bound against what theory says of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from band_noise import band_noise
from scipy.spatial.transform import Rotation

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.error_bound import Bounds, bounds
from haptic_accel.core.control.filters import high_passed
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import FloatArray, HandleParameters, MountParameters

RATE = 500.0
LATE = Plant(mount=MountParameters(120.0, 0.2), delay=1e-3).coupled()
LIGHT = Plant(handle=HandleParameters(m_h=0.08)).coupled()
COIL = ActuatorParameters()
WITHOUT = np.eye(3)[:, :, np.newaxis]


def textures(rms: float) -> FloatArray:
    return band_noise(20.0, 120.0, 4.0, rms, seed=3, axes=(3,))


def bound(coupling: FloatArray, tool: FloatArray, *axes: Plant, **given: Any) -> Bounds:
    x, y, z = axes or (LATE, LATE, LATE)
    return bounds(MatrixPlant((x, y, z), coupling, RATE), RATE, tool, **given)


def test_without_coupling_it_is_the_mean_of_those_of_the_axes() -> None:
    tool, axes = textures(0.5), (LATE, LIGHT, LATE)
    singles = [
        bounds(
            own, RATE, along, granted_delay=1, noise=0.03, high_pass_frequency=15.0, actuator=COIL
        )
        for own, along in zip(axes, tool.T, strict=True)
    ]
    powers = [float(np.mean(high_passed(each, 15.0, RATE) ** 2)) for each in tool.T]
    for found, each in zip(
        bound(WITHOUT, tool, *axes, noise=0.03), zip(*singles, strict=True), strict=True
    ):
        expected = np.sqrt(np.average(np.square(each), weights=powers))
        assert found == pytest.approx(expected, rel=0.03)


def test_axes_that_can_be_turned_back_change_nothing() -> None:
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()[:, :, np.newaxis]
    tool = textures(0.5)
    assert tuple(bound(turned, tool)) == pytest.approx(tuple(bound(WITHOUT, tool)), rel=5e-3)


@pytest.mark.slow
def test_a_coupling_with_a_causal_inverse_costs_nothing_and_a_late_one_does() -> None:
    tool = textures(0.5)
    early, late = np.zeros((3, 3, 2)), np.zeros((3, 3, 2))
    early[:, :, 0] = late[:, :, 0] = np.eye(3)
    early[0, 1, 1] = 0.9
    # Along the diagonal of x and y the coils act twice as strongly one sample later.
    late[:2, :2, 1] = 1.0
    free = bound(WITHOUT, tool).causal
    assert bound(early, tool).causal == pytest.approx(free, rel=1e-3)
    assert bound(late, tool).causal > free + 4.0


def test_vibration_along_a_line_is_that_of_one_axis() -> None:
    along = textures(10.0)[:, :1] * (0.0, 0.0, 1.0)
    single = bounds(
        LATE,
        RATE,
        along[:, 2],
        granted_delay=1,
        noise=0.0,
        high_pass_frequency=15.0,
        actuator=COIL,
    )
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5])
    for tool in (along, turned.apply(along)):
        assert bound(WITHOUT, tool).causal == pytest.approx(single.causal, rel=0.02)


@pytest.mark.slow
def test_limits_of_the_coils_cost_error() -> None:
    tool, weak = textures(0.5), replace(COIL, peak_force=0.1)
    found = bound(WITHOUT, tool, actuator=weak)
    assert found.causal + 10.0 < found.limited < 100.0

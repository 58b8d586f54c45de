# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits that an actuator or a device cannot have."""

from __future__ import annotations

import math

import pytest

from haptic_accel.core.actuator import ActuatorParameters, MasterSafetyParameters
from haptic_accel.core.parameters import ParameterError, from_flat, schema


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("actuator.m_a", 0.0),
        ("actuator.k_s", -1.0),
        ("actuator.b_s", math.nan),
        ("actuator.travel", 0.0),
        ("actuator.peak_force", math.inf),
        ("actuator.peak_force", -1.0),
        ("actuator.peak_force", math.nan),
        ("actuator.continuous_force", -2.2),
        ("actuator.thermal_time", 0.0),
        ("actuator.force_constant", 0.0),
        ("actuator.max_age", math.nan),
        ("arm.command_timeout", 0.0),
        ("arm.slew_rate", math.inf),
        ("recovery", "perhaps"),
    ],
)
def test_a_limit_that_cannot_be_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=f"^{name} = "):
        from_flat(MasterSafetyParameters, {name: value})


def test_its_parameters_are_in_one_block_wherever_it_is_nested() -> None:
    names = [f"actuator.{name}" for name in vars(ActuatorParameters())]
    assert list(schema(ActuatorParameters, "serial.actuator.")) == names

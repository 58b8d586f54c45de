# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers that an actuator cannot have."""

from __future__ import annotations

import math

import pytest

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.parameters import ParameterError, from_flat, schema


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("m_a", 0.0),
        ("k_s", -1.0),
        ("b_s", math.nan),
        ("travel", 0.0),
        ("peak_force", math.inf),
        ("continuous_force", -2.2),
        ("thermal_time", 0.0),
        ("force_constant", 0.0),
    ],
)
def test_an_impossible_actuator_is_refused(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"^actuator.{name} = "):
        from_flat(ActuatorParameters, {f"actuator.{name}": value}, "anything.")


def test_its_parameters_are_in_one_block_wherever_it_is_nested() -> None:
    names = [f"actuator.{name}" for name in vars(ActuatorParameters())]
    assert list(schema(ActuatorParameters, "serial.actuator.")) == names

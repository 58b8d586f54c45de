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

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.control.channel import build_controller
from haptic_accel.core.control.controllers import Loop
from haptic_accel.core.control.controllers.constant import ConstantController, ConstantParameters
from haptic_accel.core.parameters import ParameterError

accelerations = st.floats(-1e3, 1e3)


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


@pytest.mark.parametrize("mass", [-0.1, math.nan, math.inf])
def test_an_impossible_mass_is_refused(mass: float) -> None:
    with pytest.raises(ParameterError, match=f"^mass = {mass}: must be at least 0 kg$"):
        ConstantParameters(mass)

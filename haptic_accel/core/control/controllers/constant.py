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

"""Constant gain: the handle is assumed to be a mass (the paper's second condition)."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick.control import ConstantForce


@dataclass(frozen=True)
class ConstantParameters(Checked):
    """Parameters of `ConstantController`."""

    mass: float = parameter(
        0.128, "gain of the controller: mass of handle and hand (m_h of Table I)", unit="kg", low=0
    )


class ConstantController(ConstantForce, Controller):
    """f_a = m_h a_hdes."""

    Parameters = ConstantParameters
    needs_plant = False

    def __init__(self, parameters: ConstantParameters, loop: Loop) -> None:
        super().__init__(parameters.mass)

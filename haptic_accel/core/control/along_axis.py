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
"""Compensation of a handle with one coil in a loop whose signals are vectors."""

from __future__ import annotations

from haptic_accel.core.axes import ACTUATOR_AXES, ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.control.reduction_switch import ReductionSwitch
from haptic_accel.core.model import Vector
from haptic_accel.core.reduction import NO_REDUCTION


def component(acceleration: Vector) -> float:
    """Return the component along the actuator."""
    return acceleration[ACTUATOR_AXIS]


class AlongAxis:
    """Apply a compensation along the axis of the only coil.

    Parameters
    ----------
    compensation : Compensation
    rate : float
        Samples per second.
    reduction : str
        Reduction of the tool's three axes; without one, the coil has the component along z.

    Attributes
    ----------
    select, set_gain, adapt, mute, freeze, diagnostics : callable
        Those of the compensation.
    select_reduction : callable
        Change to another reduction without a jump; see `ReductionSwitch`.
    """

    axes = ACTUATOR_AXES
    """Axes of the handle."""

    def __init__(
        self, compensation: Compensation, rate: float, reduction: str = NO_REDUCTION
    ) -> None:
        self._switch = ReductionSwitch(reduction, rate, unreduced=lambda tool: tool)
        self._process, self._reduced = compensation.process, self._switch.process
        self.select_reduction = self._switch.select
        self._compensation = compensation
        self.select, self.adapt = compensation.select, compensation.adapt
        self.set_gain = compensation.set_gain
        self.mute, self.freeze = compensation.mute, compensation.freeze
        self.diagnostics = compensation.diagnostics

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return self._compensation.controller

    def process(self, tool: Vector, handle: Vector | None) -> tuple[Vector, Vector]:
        """Return desired acceleration, m/s^2, and force, N; see `Compensation.process`."""
        measured = None if handle is None else component(handle)
        desired, force = self._process(component(self._reduced(tool)), measured)
        return along_actuator(desired), along_actuator(force)

    def reset(self) -> None:
        """Return to the initial state with the selected reduction; see `Compensation.reset`."""
        self._compensation.reset()
        self._switch.settle()

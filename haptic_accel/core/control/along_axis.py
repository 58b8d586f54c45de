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

from collections.abc import Callable

from haptic_accel.core.axes import ACTUATOR_AXES, ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.model import Vector


def component(acceleration: Vector) -> float:
    """Return the component along the actuator."""
    return acceleration[ACTUATOR_AXIS]


class AlongAxis:
    """Apply a compensation along the axis of the only coil.

    Parameters
    ----------
    compensation : Compensation
    reduction : callable
        Function from the tool's acceleration in three axes to the signal of the coil.

    Attributes
    ----------
    select, adapt, mute, freeze, reset, diagnostics : callable
        Those of the compensation.
    """

    axes = ACTUATOR_AXES
    """Axes of the handle."""

    def __init__(
        self, compensation: Compensation, reduction: Callable[[Vector], float] = component
    ) -> None:
        self._process, self._reduced = compensation.process, reduction
        self._compensation = compensation
        self.select, self.adapt = compensation.select, compensation.adapt
        self.mute, self.freeze = compensation.mute, compensation.freeze
        self.reset, self.diagnostics = compensation.reset, compensation.diagnostics

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return self._compensation.controller

    def process(self, tool: Vector, handle: Vector | None) -> tuple[Vector, Vector]:
        """Return desired acceleration, m/s^2, and force, N; see `Compensation.process`."""
        measured = None if handle is None else component(handle)
        desired, force = self._process(self._reduced(tool), measured)
        return along_actuator(desired), along_actuator(force)

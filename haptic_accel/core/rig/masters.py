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
"""Simulated masters: the handle with one coil, and the handle with three."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.handle.three_axis import BodyParameters, CoilMounting, SensorMounts
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.rig.held_rig import Hand
from haptic_accel.core.rig.master_rig import MasterRig, MasterRigParameters
from haptic_accel.core.rig.three_axis_rig import ThreeAxisParameters, ThreeAxisRig


@dataclass(frozen=True)
class SimulatedMasterParameters(MasterRigParameters, Checked):
    """Parameters of the simulated master, with one coil or with three."""

    axes: str = parameter("z", "axes of coils and accelerometer: z, or x, y, z")
    body: BodyParameters = field(default_factory=BodyParameters)
    coils: CoilMounting = field(default_factory=CoilMounting)
    mounts: SensorMounts = field(default_factory=SensorMounts)

    def __post_init__(self) -> None:
        """Check all fields; the axes must be those of one coil or of three."""
        super().__post_init__()
        if Axes.parsed(self.axes) not in (ACTUATOR_AXES, ALL_AXES):
            raise ParameterError(f"axes = {self.axes}: must be z, or x, y, z")


def axes_of(parameters: MasterRigParameters) -> Axes:
    """Return the axes of a simulated master."""
    if isinstance(parameters, SimulatedMasterParameters):
        return Axes.parsed(parameters.axes)
    return ACTUATOR_AXES


def three_axis_parameters(parameters: SimulatedMasterParameters) -> ThreeAxisParameters:
    """Return the parameters of the handle with three coils alone."""
    names = [each.name for each in fields(ThreeAxisParameters)]
    return ThreeAxisParameters(**{name: getattr(parameters, name) for name in names})


def simulated_master(
    parameters: MasterRigParameters, rate: float, seed: int = 0, hand: Hand | None = None
) -> MasterRig | ThreeAxisRig:
    """Return the simulated master with its number of coils; arguments as for `MasterRig`."""
    if isinstance(parameters, SimulatedMasterParameters) and axes_of(parameters) == ALL_AXES:
        return ThreeAxisRig(three_axis_parameters(parameters), rate, seed, hand)
    return MasterRig(parameters, rate, seed, hand)

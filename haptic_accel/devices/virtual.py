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

"""Virtual slave: a tool in a scene from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from haptic_accel.core.axes import Axes
from haptic_accel.core.bounded_work import without_bounded_work
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import parameter
from haptic_accel.core.surfaces.virtual_rig import VirtualRig, VirtualRigParameters
from haptic_accel.devices.interface import DeviceDescription
from haptic_accel.devices.simulated import SimulatedDevice
from haptic_accel.materials.scenes import read_scene

TOO_LONG = "takes longer than a running graph can wait: must be named at its start"
"""Reason to refuse, for a running tool, a moving scene or a mesh without a grid."""


@dataclass(frozen=True)
class VirtualSlaveParameters(VirtualRigParameters):
    """All parameters of the virtual slave."""

    scene: str = parameter("", "file of the scene")


class VirtualSlave(SimulatedDevice):
    """Tool and arm in a scene."""

    Parameters = VirtualSlaveParameters
    description = DeviceDescription(changeable=("scene",), framed=True)

    _rig: VirtualRig

    def __init__(self, parameters: VirtualSlaveParameters, rate: float, seed: int) -> None:
        scene = read_scene(Path(parameters.scene))
        self._rig = VirtualRig(parameters, scene, rate, seed)
        self.axes = Axes.parsed(parameters.tool.axes)

    @property
    def contact_force(self) -> Vector:
        """Force of the scene on the tool at the last sample, N."""
        return self._rig.contact_force

    def change(self, parameters: VirtualSlaveParameters) -> None:
        """Put another scene under the tool.

        Raises
        ------
        ParameterError
            The scene's file is not usable, or checking it would block the device.
        """
        with without_bounded_work(TOO_LONG):
            self._rig.change_scene(read_scene(Path(parameters.scene)))

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The virtual slave: a tool in a scene that is a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import parameter
from haptic_accel.core.surfaces.virtual_rig import VirtualRig, VirtualRigParameters
from haptic_accel.devices.simulated import SimulatedDevice
from haptic_accel.materials.scenes import read_scene


@dataclass(frozen=True)
class VirtualSlaveParameters(VirtualRigParameters):
    """All parameters of the virtual slave."""

    scene: str = parameter("", "file of the scene")


class VirtualSlave(SimulatedDevice):
    """Tool and arm in a scene."""

    Parameters = VirtualSlaveParameters
    CHANGEABLE = ("scene",)

    _rig: VirtualRig

    def __init__(self, parameters: VirtualSlaveParameters, rate: float, seed: int) -> None:
        scene = read_scene(Path(parameters.scene))
        self._rig = VirtualRig(parameters, scene, rate, seed)

    @property
    def contact_force(self) -> Vector:
        """Force of the scene on the tool at the last sample, N."""
        return self._rig.contact_force

    def change(self, parameters: VirtualSlaveParameters) -> None:
        """Put another scene under the tool.

        Raises
        ------
        ParameterError
            Its file is not usable.
        """
        self._rig.change_scene(read_scene(Path(parameters.scene)))

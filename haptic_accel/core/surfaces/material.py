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

"""Materials of virtual surfaces."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.surfaces.taps import TapModel
from haptic_accel.core.surfaces.texture import TextureModel


@dataclass(frozen=True)
class Material(Checked):
    """Material of an object: stiffness, friction, texture and taps.

    Attributes
    ----------
    name : str
    texture : TextureModel, optional
        Acceleration of a sliding tool.
    tap : TapModel, optional
        Acceleration after an impact.

    Raises
    ------
    ParameterError
        A value is out of range, or friction is above static friction.
    """

    name: str = "material"
    stiffness: float = parameter(2000.0, "stiffness of the contact", "N/m", 1.0, 10e3)
    damping: float = parameter(5.0, "damping of the contact", "N s/m", 0.0, 100.0)
    static_friction: float = parameter(0.4, "friction coefficient of a tool that sticks", "", 0, 2)
    friction: float = parameter(0.3, "friction coefficient of a tool that slides", "", 0, 2)
    texture: TextureModel | None = None
    tap: TapModel | None = None

    def __post_init__(self) -> None:
        """Check each value, and that sliding friction is not above static friction."""
        super().__post_init__()
        if self.friction > self.static_friction:
            raise ParameterError(
                f"friction = {self.friction}: must be at most static_friction,"
                f" {self.static_friction}"
            )

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

"""State of a contact at one sample."""

from __future__ import annotations

from typing import NamedTuple

from haptic_accel.core.model import Vector
from haptic_accel.core.surfaces.scene import SceneObject


class Contact(NamedTuple):
    """Contact of a tool with a scene during one sampling period.

    If the tool touches several objects, `force` is the sum for all. The other values are those of
    an object touched in this sample, or else of the one with the largest force.

    Attributes
    ----------
    object : SceneObject
    normal : tuple of float
        Outward direction of the object's surface.
    depth : float
        Penetration depth of the tool, m.
    force : tuple of float
        Mean force on the tool, N.
    normal_force : float
        Normal component of this object's force, N; never negative.
    velocity : tuple of float
        Tangential velocity of the tool, m/s.
    speed : float
        Tangential speed, m/s.
    impact_speed : float
        Impact speed, m/s; 0 except in the first sample of a contact.
    sliding : bool
        True if the tool slides, False if it sticks.
    """

    object: SceneObject
    normal: Vector
    depth: float
    force: Vector
    normal_force: float
    velocity: Vector
    speed: float
    impact_speed: float
    sliding: bool

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""State of a contact at one sample."""

from __future__ import annotations

from typing import NamedTuple

from haptic_accel.core.model import Vector
from haptic_accel.core.surfaces.scene import SceneObject


class Contact(NamedTuple):
    """Contact of a tool with a scene during one sampling period.

    If the tool touches several objects, `force` is that of all; the rest is of the one that
    was touched just now, else of the one that presses most.

    Attributes
    ----------
    object : SceneObject
    normal : tuple of float
        Direction out of the object.
    depth : float
        Depth of the tool in the object, m.
    force : tuple of float
        Mean force on the tool, N.
    normal_force : float
        Its part along the normal, of this object, N; never negative.
    velocity : tuple of float
        Velocity of the tool along the surface, m/s.
    speed : float
        Size of that, m/s.
    impact_speed : float
        Speed against the surface when it was touched, m/s; 0 but in the sample of the onset.
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

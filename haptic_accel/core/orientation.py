# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientation of tool and handle, so that vibration has the same direction at both.

A tool's acceleration is rotated from the tool's axes to those of its base, and from the base of
the handle to the handle's axes. Positions are coupled along the axes of both bases, so that a
direction is the same in both. CRTK's `measured_cp` contains the orientation of tool or handle
relative to its base.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from haptic_accel.core.model import IDENTITY, Quaternion, Vector

UNIT_ERROR = 0.01
"""Maximum deviation of a quaternion's length from 1: far above rounding errors, also of float32,
and far below the deviation of an unset quaternion."""


def unit_quaternion(values: Sequence[float]) -> Quaternion | None:
    """Return a quaternion of unit length; None for values that are not a rotation.

    Examples
    --------
    >>> unit_quaternion([0.0, 0.0, 0.0, 1.001])
    (0.0, 0.0, 0.0, 1.0)
    >>> unit_quaternion([0.0, 0.0, 0.0, 0.0])
    """
    length = math.hypot(*values)
    if len(values) != len(IDENTITY) or not abs(length - 1.0) <= UNIT_ERROR:
        return None
    x, y, z, w = (value / length for value in values)
    return x, y, z, w


def to_base(orientation: Quaternion, vector: Vector) -> Vector:
    """Convert a vector from rotated axes to those of the base.

    Examples
    --------
    >>> upright = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # a quarter turn about z
    >>> [round(abs(each), 9) for each in to_base(upright, (1.0, 0.0, 0.0))]
    [0.0, 1.0, 0.0]
    """
    x, y, z, w = orientation
    if not (x or y or z):
        return vector
    v_x, v_y, v_z = vector
    # v + 2 w (q x v) + 2 q x (q x v), with the vector part q.
    t_x, t_y, t_z = 2 * (y * v_z - z * v_y), 2 * (z * v_x - x * v_z), 2 * (x * v_y - y * v_x)
    return (
        v_x + w * t_x + y * t_z - z * t_y,
        v_y + w * t_y + z * t_x - x * t_z,
        v_z + w * t_z + x * t_y - y * t_x,
    )


def from_base(orientation: Quaternion, vector: Vector) -> Vector:
    """Convert a vector from the base's axes to rotated axes, the inverse of `to_base`."""
    x, y, z, w = orientation
    return to_base((-x, -y, -z, w), vector)


def is_turned(orientation: Quaternion, acceleration: Vector) -> bool:
    """Return True if a vibration has to be rotated.

    A single-axis sensor has no direction: its other components are zero, and its vibration is
    reproduced along the coil, regardless of the orientation.

    Examples
    --------
    >>> is_turned((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    False
    >>> is_turned((1.0, 0.0, 0.0, 0.0), (0.1, 0.0, 2.0))
    True
    """
    return orientation is not IDENTITY and acceleration.count(0.0) < len(acceleration) - 1


class Orientation:
    """Newest orientation of a tool or handle, from values that may not be a rotation.

    The last valid orientation is kept, as a change to another one would suddenly rotate the
    vibration. Before the first one, the axes are those of the base.

    Attributes
    ----------
    newest : tuple of float
    problem : str
        One-line warning while the values are not a rotation; empty otherwise.

    Examples
    --------
    >>> tool = Orientation()
    >>> tool.put([0.0, 0.0, 0.0, 0.0])
    >>> tool.newest == IDENTITY, tool.problem
    (True, 'the orientation is not a unit quaternion: the last valid one is kept')
    """

    def __init__(self) -> None:
        self.newest = IDENTITY
        self.problem = ""

    def put(self, values: Sequence[float]) -> None:
        """Add the orientation of a pose."""
        if found := unit_quaternion(values):
            self.newest, self.problem = found, ""
        else:
            self.problem = "the orientation is not a unit quaternion: the last valid one is kept"

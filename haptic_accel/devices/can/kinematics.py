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

"""Kinematics of arms: motor turns to tip motion, tip force to torques.

Base frame: z up, x forwards when the waist is at zero, y to the left (REP-103).

The articulated arm is a Phantom Omni without its wrist: link lengths and forward map from
Jarillo-Silva et al., PHANToM OMNI Haptic Device: Kinematic and Manipulability (CERMA 2009),
rotated into this frame, origin in the shoulder. Joint 1 is the waist, about z, positive to the
left. Joint 2 is the shoulder, the upper link's angle above the horizontal. Joint 3 is the elbow:
the forearm's angle from the downward vertical, positive forwards. Both motors are in the base, so
joints 2 and 3 are independent.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from haptic_accel.core.model import FloatArray, Vector, vector
from haptic_accel.devices.can.parameters import CanParameters, LinkParameters, StageParameters

SHORTEST = 1e-9
"""Shortest distance to divide by, m."""

Angles: TypeAlias = tuple[float, ...]
"""One value per joint: rad, rad/s or N m."""


class LinearStage:
    """Motor that moves the tip along an axis.

    Attributes
    ----------
    home : tuple of float
        Angles in the middle of the workspace, rad.
    """

    home: Angles = (0.0,)

    def __init__(self, parameters: StageParameters) -> None:
        self._axis = "xyz".index(parameters.axis)
        self._jacobian = np.zeros((3, 1))
        self._jacobian[self._axis] = parameters.travel / math.tau

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position, m, for an angle in rad."""
        return vector(self._jacobian @ angles)

    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the Jacobian, shape (3, 1), m/rad: the travel per angle."""
        return self._jacobian

    def angles(self, position: Vector) -> Angles:
        """Return the angle for a position along the axis, rad."""
        return (position[self._axis] / float(self._jacobian[self._axis, 0]),)


class ArticulatedArm:
    """Waist, shoulder and elbow.

    Attributes
    ----------
    home : tuple of float
        Angles in the middle of the workspace, far from singularities, rad.
    """

    # Upper link horizontal, forearm hanging: the links are at right angles.
    home: Angles = (0.0, 0.0, 0.0)

    def __init__(self, parameters: LinkParameters) -> None:
        self._upper, self._fore = parameters.upper, parameters.fore
        self._relative = parameters.elbow == "shoulder"

    def _pose(self, angles: Sequence[float]) -> tuple[float, complex, complex]:
        """Return the waist's angle, and both links as outwards + j upwards, m."""
        waist, shoulder, elbow = (0.0, *angles)[-3:]
        if self._relative:
            elbow += shoulder
        return waist, cmath.rect(self._upper, shoulder), -1j * cmath.rect(self._fore, elbow)

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position from the shoulder, m, for angles in rad."""
        waist, upper, fore = self._pose(angles)
        tip = upper + fore
        return tip.real * math.cos(waist), tip.real * math.sin(waist), tip.imag

    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the Jacobian, shape (3, joints), m/rad, at angles in rad.

        It is singular where the links are in line, or the tip is above or below the waist.
        """
        waist, upper, fore = self._pose(angles)
        tip = upper + fore
        cos_waist, sin_waist = math.cos(waist), math.sin(waist)
        columns = [(-tip.real * sin_waist, tip.real * cos_waist, 0.0)]
        for turned in (tip if self._relative else upper, fore):
            by_angle = 1j * turned
            columns.append((by_angle.real * cos_waist, by_angle.real * sin_waist, by_angle.imag))
        return np.array(columns[-len(self.home) :]).T

    def angles(self, position: Vector) -> Angles:
        """Return the angles, rad, that bring the tip to a position, m, or as near as possible.

        The elbow is above the line from shoulder to tip.
        """
        x, y, z = position
        out = math.hypot(x, y)
        distance = math.hypot(out, z)
        # Law of cosines; out of reach, the arm stretches towards the position.
        cosine = (self._upper**2 + distance**2 - self._fore**2) / (
            2 * self._upper * max(distance, SHORTEST)
        )
        shoulder = math.atan2(z, out) + math.acos(min(1.0, max(-1.0, cosine)))
        fore = complex(out, z) - cmath.rect(self._upper, shoulder)
        elbow = math.atan2(fore.real, -fore.imag) - self._relative * shoulder
        return (math.atan2(y, x), shoulder, elbow)[-len(self.home) :]


class PlanarArm(ArticulatedArm):
    """Shoulder and elbow of the articulated arm, in the plane of x and z."""

    home: Angles = ArticulatedArm.home[1:]

    def angles(self, position: Vector) -> Angles:
        """Return the angles with the elbow above the line from shoulder to tip, rad."""
        return super().angles((position[0], 0.0, position[2]))


Kinematics: TypeAlias = LinearStage | ArticulatedArm
"""Relation between the angles of the joints and the position of the tip."""


def kinematics_of(parameters: CanParameters) -> Kinematics:
    """Return the kinematics with the parameters of stage or links."""
    if parameters.kinematics == "stage":
        return LinearStage(parameters.stage)
    kind = PlanarArm if parameters.kinematics == "planar" else ArticulatedArm
    return kind(parameters.links)

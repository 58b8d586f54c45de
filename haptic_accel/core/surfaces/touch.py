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

"""Mechanics of a tool on one object: spring, damper, and friction by the bristle model."""

from __future__ import annotations

import math

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.surfaces.proxy import LocalPlane
from haptic_accel.core.surfaces.scene import SceneObject


class Touch:
    """Spring and damper normal to an object's tangent plane, friction along it.

    Friction is the force of a bristle with the stiffness of the surface. It sticks up to the
    static coefficient. Beyond, it slides with the sliding coefficient until the tool stops.

    Parameters
    ----------
    touched : SceneObject
    mass : float
        Mass of the tool, kg.

    Attributes
    ----------
    object : SceneObject
    normal : tuple of float
    depth : float
        Compression of the spring, m.
    begun : bool
        True if the object was touched since the plane was set.
    impact_speed : float
        Impact speed in m/s if the first contact was since then, or 0.
    impulse : tuple of float
        Impulse on the tool since then, N s.
    sliding : bool
    """

    def __init__(self, touched: SceneObject, mass: float) -> None:
        material = touched.material
        self.object = touched
        self._mass = mass
        self._stiffness, self._damping = material.stiffness, material.damping
        self._static, self._kinetic = material.static_friction, material.friction
        self._offset = 0.0
        self.normal = ZERO
        self.impulse = ZERO
        self.impact_speed = 0.0
        self.begun = False
        self._pushed = ZERO
        self._balance = 0.0
        self.end()

    def end(self) -> None:
        """End the contact."""
        self.depth = 0.0
        self.bristle = ZERO
        self.sliding = False
        self._pressed = False

    def energy(self) -> float:
        """Return the elastic energy of spring and bristle, J."""
        x, y, z = self.bristle
        return self._stiffness / 2 * (self.depth**2 + x * x + y * y + z * z)

    def force(self) -> float:
        """Return the elastic force, N."""
        return self._stiffness * self.depth

    def take_over(self, other: Touch) -> None:
        """Start with the elastic forces of another instance."""
        softer = other._stiffness / self._stiffness
        x, y, z = other.bristle
        self.depth = softer * other.depth
        self.bristle = (softer * x, softer * y, softer * z)
        self.sliding, self._pressed = other.sliding, True

    def lay(self, plane: LocalPlane, place: Vector, spare: float) -> float:
        """Set the plane of the surface for the next period, with the tool at a position.

        Parameters
        ----------
        plane : LocalPlane
        place : tuple of float
            Position of the tool, m.
        spare : float
            Energy that the spring may gain from the new plane, J. If it would gain more, for
            example between a soft and a hard object, the surface is set below the plane.

        Returns
        -------
        float
            Energy gained by the spring; negative for a loss.
        """
        self.normal = n_x, n_y, n_z = plane.normal
        self.impulse, self.impact_speed, self.begun = ZERO, 0.0, self._pressed
        b_x, b_y, b_z = self.bristle
        outwards = along(self.normal, self.bristle)
        self.bristle = (b_x - outwards * n_x, b_y - outwards * n_y, b_z - outwards * n_z)
        self._offset = plane.offset
        depth, before = max(0.0, -plane.height(place)), self.depth
        won = self._stiffness / 2 * (depth * depth - before * before)
        if won > spare:
            permitted = math.sqrt(max(0.0, before * before + 2 * spare / self._stiffness))
            self._offset -= depth - permitted
            depth = permitted
            won = self._stiffness / 2 * (depth * depth - before * before)
        self.depth = depth
        self._balance = -self.energy()
        return won

    def settle(self, place: Vector) -> float:
        """Return the energy in J generated since the last call, with the tool at a position.

        Negative if damping and friction have dissipated energy.
        """
        n_x, n_y, n_z = self.normal
        self.depth = self._offset - n_x * place[0] - n_y * place[1] - n_z * place[2]
        if self.depth <= 0:
            self.end()
        return self._balance + self.energy()

    def push(self, place: Vector, came: Vector, velocity: Vector, step: float) -> Vector:
        """Return the tool's velocity after a step, given the position at its middle.

        Parameters
        ----------
        place : tuple of float
            Position, m.
        came : tuple of float
            Velocity of the tool before the step, m/s.
        velocity : tuple of float
            Velocity including the effect of the motors, m/s.
        step : float
            Duration of the step, s.
        """
        (n_x, n_y, n_z), mass = self.normal, self._mass
        v_x, v_y, v_z = velocity
        depth = self._offset - n_x * place[0] - n_y * place[1] - n_z * place[2]
        if depth <= 0:
            if self._pressed:
                self.end()
            return velocity
        away = n_x * v_x + n_y * v_y + n_z * v_z
        if not self._pressed:
            self._pressed = self.begun = True
            self.impact_speed = max(self.impact_speed, -along(self.normal, came))
        per_mass = step / mass
        held = 1 / (1 + self._damping * per_mass)  # implicit: stable for any value
        # A surface can only push.
        push = max(0.0, (away + self._stiffness * depth * per_mass) * held - away)
        v_x, v_y, v_z = v_x - away * n_x, v_y - away * n_y, v_z - away * n_z  # tangential
        bound = push / (per_mass * self._stiffness)
        b_x, b_y, b_z = self._within_cone(self.bristle, bound)
        if self.sliding:
            held = 1.0
        pull = self._stiffness * per_mass
        v_x, v_y, v_z = (
            held * (v_x - pull * b_x),
            held * (v_y - pull * b_y),
            held * (v_z - pull * b_z),
        )
        stretched = b_x + step * v_x, b_y + step * v_y, b_z + step * v_z
        self.bristle = self._within_cone(stretched, bound)
        self.sliding = self.bristle is not stretched
        away += push
        w_x, w_y, w_z = v_x + away * n_x, v_y + away * n_y, v_z + away * n_z
        v_x, v_y, v_z = velocity
        g_x, g_y, g_z = mass * (w_x - v_x), mass * (w_y - v_y), mass * (w_z - v_z)
        i_x, i_y, i_z = self.impulse
        self.impulse = (i_x + g_x, i_y + g_y, i_z + g_z)
        self._pushed = (g_x, g_y, g_z)
        return w_x, w_y, w_z

    def _within_cone(self, bristle: Vector, bound: float) -> Vector:
        """Return the bristle, shortened if it exceeds a bound in m."""
        x, y, z = bristle
        length = math.sqrt(x * x + y * y + z * z)
        if length <= (self._kinetic if self.sliding else self._static) * bound:
            return bristle
        self.sliding = True
        shrunk = self._kinetic * bound / length
        return shrunk * x, shrunk * y, shrunk * z

    def note_work(self, before: Vector, after: Vector) -> None:
        """Add the work of the last step, from the tool's velocities before and after it."""
        if self._pressed:
            g_x, g_y, g_z = self._pushed
            self._balance += (
                g_x * (before[0] + after[0])
                + g_y * (before[1] + after[1])
                + g_z * (before[2] + after[2])
            ) / 2


def along(direction: Vector, vector: Vector) -> float:
    """Return the component of a vector along a direction."""
    return direction[0] * vector[0] + direction[1] * vector[1] + direction[2] * vector[2]

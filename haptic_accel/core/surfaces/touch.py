# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Mechanics of a tool on one object: spring, damper, and friction by a bristle."""

from __future__ import annotations

import math

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.surfaces.proxy import LocalPlane
from haptic_accel.core.surfaces.scene import SceneObject


class Touch:
    """Spring and damper along the normal of an object's tangent plane, friction along it.

    Friction is the force of a bristle as stiff as the surface. It sticks up to the static
    coefficient; beyond, it is dragged along at the sliding one, until the tool stops.

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
        True if the object was touched since the plane was laid.
    impact_speed : float
        Speed against the surface in m/s if it was touched for the first time since then, or 0.
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
        """Leave the surface."""
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
        """Begin with another touch's elastic forces."""
        softer = other._stiffness / self._stiffness
        x, y, z = other.bristle
        self.depth = softer * other.depth
        self.bristle = (softer * x, softer * y, softer * z)
        self.sliding, self._pressed = other.sliding, True

    def lay(self, plane: LocalPlane, place: Vector, spare: float) -> float:
        """Put the surface onto a plane for the next period, with the tool at a place.

        Parameters
        ----------
        plane : LocalPlane
        place : tuple of float
            Place of the tool, m.
        spare : float
            Energy that the spring may win by it, J. Where it would win more, as on the way from a
            soft object to a hard one, the surface is lower than the plane.

        Returns
        -------
        float
            The energy that the spring has won; negative if it lost some.
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
        """Return the energy in J that it has given out but did not hold, with the tool at a place.

        Negative where damping and friction have taken some.
        """
        n_x, n_y, n_z = self.normal
        self.depth = self._offset - n_x * place[0] - n_y * place[1] - n_z * place[2]
        if self.depth <= 0:
            self.end()
        return self._balance + self.energy()

    def push(self, place: Vector, came: Vector, velocity: Vector, step: float) -> Vector:
        """Return the velocity of the tool after a step, whose middle is at a place.

        Parameters
        ----------
        place : tuple of float
            m.
        came : tuple of float
            Velocity with which the tool came there, m/s.
        velocity : tuple of float
            The same after the motors' push, m/s.
        step : float
            s.
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
        held = 1 / (1 + self._damping * per_mass)  # implicit: stable however large
        # A surface can only push.
        push = max(0.0, (away + self._stiffness * depth * per_mass) * held - away)
        v_x, v_y, v_z = v_x - away * n_x, v_y - away * n_y, v_z - away * n_z  # along the surface
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
        """Return a bristle that is dragged along if it is too long for a depth in m."""
        x, y, z = bristle
        length = math.sqrt(x * x + y * y + z * z)
        if length <= (self._kinetic if self.sliding else self._static) * bound:
            return bristle
        self.sliding = True
        shrunk = self._kinetic * bound / length
        return shrunk * x, shrunk * y, shrunk * z

    def note_work(self, before: Vector, after: Vector) -> None:
        """Note the work of the last push on a tool whose velocity was this before and after it."""
        if self._pressed:
            g_x, g_y, g_z = self._pushed
            self._balance += (
                g_x * (before[0] + after[0])
                + g_y * (before[1] + after[1])
                + g_z * (before[2] + after[2])
            ) / 2


def along(direction: Vector, vector: Vector) -> float:
    """Return the part of a vector along a direction."""
    return direction[0] * vector[0] + direction[1] * vector[1] + direction[2] * vector[2]

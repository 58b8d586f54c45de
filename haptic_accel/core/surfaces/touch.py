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
        along = n_x * b_x + n_y * b_y + n_z * b_z
        self.bristle = (b_x - along * n_x, b_y - along * n_y, b_z - along * n_z)
        self._offset = plane.offset
        depth, before = max(0.0, -plane.height(place)), self.depth
        won = self._stiffness / 2 * (depth * depth - before * before)
        if won > spare:
            won = spare
            permitted = math.sqrt(before * before + 2 * spare / self._stiffness)
            self._offset -= depth - permitted
            depth = permitted
        self.depth = depth
        return won

    def settle(self, place: Vector) -> None:
        """Note the compression with the tool at a place."""
        n_x, n_y, n_z = self.normal
        self.depth = self._offset - n_x * place[0] - n_y * place[1] - n_z * place[2]
        if self.depth <= 0:
            self.end()

    def push(self, place: Vector, velocity: Vector, step: float) -> Vector:
        """Return the velocity of the tool after a step, whose middle is at a place.

        Parameters
        ----------
        place : tuple of float
            m.
        velocity : tuple of float
            m/s.
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
            self.impact_speed = max(self.impact_speed, -away)
        per_mass = step / mass
        held = 1 / (1 + self._damping * per_mass)  # implicit: stable however large
        # A surface can only push.
        push = max(0.0, (away + self._stiffness * depth * per_mass) * held - away)
        v_x, v_y, v_z = v_x - away * n_x, v_y - away * n_y, v_z - away * n_z  # along the surface
        before = v_x, v_y, v_z
        b_x, b_y, b_z = self.bristle
        length = math.sqrt(b_x * b_x + b_y * b_y + b_z * b_z)
        bound = push / (per_mass * self._stiffness)
        self.sliding = length > (self._kinetic if self.sliding else self._static) * bound
        if self.sliding:
            shrunk = self._kinetic * bound / length
            b_x, b_y, b_z = shrunk * b_x, shrunk * b_y, shrunk * b_z
            held = 1.0
        pull = self._stiffness * per_mass
        v_x, v_y, v_z = (
            held * (v_x - pull * b_x),
            held * (v_y - pull * b_y),
            held * (v_z - pull * b_z),
        )
        self.bristle = b_x + step * v_x, b_y + step * v_y, b_z + step * v_z
        i_x, i_y, i_z = self.impulse
        self.impulse = (
            i_x + mass * (v_x - before[0] + push * n_x),
            i_y + mass * (v_y - before[1] + push * n_y),
            i_z + mass * (v_z - before[2] + push * n_z),
        )
        away += push
        return v_x + away * n_x, v_y + away * n_y, v_z + away * n_z

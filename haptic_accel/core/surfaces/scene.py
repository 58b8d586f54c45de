# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes: objects with shape, material and pose; materials of their surfaces."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from operator import add
from typing import Any

import numpy as np

from haptic_accel.core.axes import product
from haptic_accel.core.model import ZERO, FloatArray, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.surfaces.shapes import Shape
from haptic_accel.core.surfaces.taps import TapModel
from haptic_accel.core.surfaces.texture import TextureModel

MOST_STEPS = 1000
"""Maximum number of steps along a ray; a ray that needs more passes close to a surface."""

_REACHED = 1e-7  # m

SECTION_POINTS = 200
"""Number of points along each side of a section: 1 mm spacing on 20 cm."""


@dataclass(frozen=True, eq=False)
class SceneObject:
    """Shape with a material and a pose.

    Attributes
    ----------
    name : str
    shape : Shape
    material : Material
    position : tuple of float
        Origin of the shape's frame in the arm's base frame, m.
    rotation : tuple of float
        Roll, pitch and yaw about the fixed axes x, y, z, in this order, rad (as in URDF).
    """

    name: str
    shape: Shape
    material: Material
    position: Vector = ZERO
    rotation: Vector = ZERO
    _matrix: FloatArray = field(init=False, repr=False)
    _rows: tuple[Vector, ...] = field(init=False, repr=False)
    _columns: tuple[Vector, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Compute the rotation matrix from the shape's frame to the base frame."""
        roll, pitch, yaw = self.rotation
        matrix = _turn(2, yaw) @ _turn(1, pitch) @ _turn(0, roll)
        object.__setattr__(self, "_matrix", matrix)
        object.__setattr__(self, "_rows", tuple(map(tuple, matrix.tolist())))
        object.__setattr__(self, "_columns", tuple(map(tuple, matrix.T.tolist())))

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the signed distance of a point in the base frame, m."""
        return self.shape.distance(*self._inside(x, y, z))

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the gradient of the distance at a point, in the base frame."""
        gradient = self.shape.gradient(*self._inside(x, y, z))
        return gradient if self.rotation == ZERO else product(self._rows, *gradient)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3) in the base frame, m."""
        return self.shape.distances((points - self.position) @ self._matrix)

    def _inside(self, x: float, y: float, z: float) -> Vector:
        """Transform a point from the base frame to the shape's frame."""
        o_x, o_y, o_z = self.position
        x, y, z = x - o_x, y - o_y, z - o_z
        return (x, y, z) if self.rotation == ZERO else product(self._columns, x, y, z)


@dataclass(frozen=True, eq=False)
class Scene:
    """Objects that a tool can touch.

    Attributes
    ----------
    objects : tuple of SceneObject
    start : tuple of float
        Position above which the tool starts, m.
    name : str
    mover : callable, optional
        Function that creates the tool of a moving scene from parameters, scene and rate.

    Raises
    ------
    ParameterError
        Two objects have the same name.
    """

    objects: tuple[SceneObject, ...]
    start: Vector = ZERO
    name: str = "scene"
    mover: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        """Check that the objects' names differ."""
        counts = Counter(each.name for each in self.objects)
        for name, count in counts.items():
            if count > 1:
                raise ParameterError(f"name = {name!r}: must be that of one object, not {count}")

    def moved(self, by: Vector) -> Scene:
        """Return the scene with all objects moved, m; the start position remains."""
        objects = (
            replace(each, position=tuple(map(add, each.position, by))) for each in self.objects
        )
        return replace(self, objects=tuple(objects))

    def first_hit(self, point: Vector, direction: Vector, way: float) -> tuple[int, float]:
        """Return the first object hit by a ray of limited length, and the distance to it.

        Parameters
        ----------
        point : tuple of float
            Start of the ray, m.
        direction : tuple of float
            Unit vector.
        way : float
            Maximum length of the ray, m.

        Returns
        -------
        number : int
            Index of the object in the scene; -1 for none, or if the ray starts inside one.
        way : float
            Distance along the ray, m.
        """
        (x, y, z), (d_x, d_y, d_z) = point, direction
        gone = 0.0
        for _ in range(MOST_STEPS):
            at = (x + gone * d_x, y + gone * d_y, z + gone * d_z)
            distances = [each.distance(*at) for each in self.objects]
            nearest = min(distances, default=math.inf)
            if gone + nearest > way or nearest < 0 == gone:
                break
            if nearest < _REACHED:
                return distances.index(nearest), gone
            gone += nearest
        return -1, gone

    def section(
        self, x: tuple[float, float], z: tuple[float, float], y: float = 0.0
    ) -> dict[str, list[FloatArray]]:
        """Return the outlines of all objects in a plane perpendicular to y, by object name.

        Parameters
        ----------
        x, z : tuple of float
            Limits of the section, m.
        y : float
            Position of the plane, m.

        Returns
        -------
        dict
            Lines of shape (k, 2), x and z in m; objects without an outline are omitted.
        """
        from contourpy import contour_generator  # part of matplotlib; for drawing only

        across, up = np.linspace(*x, SECTION_POINTS), np.linspace(*z, SECTION_POINTS)
        points = np.stack(np.broadcast_arrays(across, y, up[:, np.newaxis]), axis=-1)
        found = {}
        for each in self.objects:
            distances = each.distances(points.reshape(-1, 3)).reshape(len(up), len(across))
            if lines := contour_generator(across, up, distances).lines(0.0):
                found[each.name] = [np.asarray(line) for line in lines]
        return found


def _turn(axis: int, angle: float) -> FloatArray:
    """Return the matrix of a rotation about a base axis by an angle in rad."""
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[[first, second], [first, second]] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


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

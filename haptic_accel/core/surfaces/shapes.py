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

"""Shapes by their signed distance in their own frame: m, negative inside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.core.parameters import Checked, parameter

UP: Vector = (0.0, 0.0, 1.0)


class Shape(Protocol):
    """Solid with a distance whose magnitude never exceeds the true distance to its surface.

    Attributes
    ----------
    stride : float
        Tangential step in m that cannot skip any part of the shape; infinite for a convex one.
    """

    @property
    def stride(self) -> float:
        """Tangential step that cannot skip any part of the shape, m."""

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the signed distance of a point, m."""

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the gradient of the distance; its length is at most 1."""

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3), m."""


class Convex(Checked):
    """Convex solid, which lies below each of its tangent planes."""

    stride: ClassVar[float] = math.inf


@dataclass(frozen=True)
class Plane(Convex):
    """Half-space below z = 0."""

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the height above the plane, m."""
        return z

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the direction of z."""
        return UP

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the heights of points of shape (n, 3), m."""
        return points[:, 2]


@dataclass(frozen=True)
class Sphere(Convex):
    """Sphere around the origin."""

    radius: float = parameter(0.02, "radius", "m", 1e-3, 1.0)

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the signed distance of a point, m."""
        return math.sqrt(x * x + y * y + z * z) - self.radius

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the direction away from the centre; upwards at the centre."""
        return unit(x, y, z)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3), m."""
        return np.asarray(np.linalg.norm(points, axis=1) - self.radius)


@dataclass(frozen=True)
class Box(Convex):
    """Box around the origin, with edges along the axes."""

    length: float = parameter(0.05, "size along x", "m", 1e-4, 2.0)
    width: float = parameter(0.05, "size along y", "m", 1e-4, 2.0)
    height: float = parameter(0.02, "size along z", "m", 1e-4, 2.0)

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the signed distance of a point, m."""
        x, y, z = abs(x) - self.length / 2, abs(y) - self.width / 2, abs(z) - self.height / 2
        deepest = max(x, y, z)
        if deepest <= 0:
            return deepest
        x, y, z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
        return math.sqrt(x * x + y * y + z * z)

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the direction away from the nearest point of the surface."""
        a, b, c = abs(x) - self.length / 2, abs(y) - self.width / 2, abs(z) - self.height / 2
        deepest = max(a, b, c)
        if deepest <= 0:
            a, b, c = float(a == deepest), float(a < b == deepest), float(a < c > b)
        else:
            a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
        return unit(math.copysign(a, x), math.copysign(b, y), math.copysign(c, z))

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3), m."""
        return _outside_corner(
            np.abs(points) - np.array([self.length, self.width, self.height]) / 2
        )


@dataclass(frozen=True)
class Cylinder(Convex):
    """Cylinder around the origin, with its axis along z."""

    radius: float = parameter(0.01, "radius", "m", 1e-3, 1.0)
    height: float = parameter(0.05, "size along z", "m", 1e-4, 2.0)

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the signed distance of a point, m."""
        aside, above = math.hypot(x, y) - self.radius, abs(z) - self.height / 2
        if aside > 0 and above > 0:
            return math.hypot(aside, above)
        return max(aside, above)

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the direction away from the nearest point of the surface."""
        aside, above = math.hypot(x, y) - self.radius, abs(z) - self.height / 2
        if aside > 0 and above > 0:
            to_rim = math.hypot(aside, above)
            aside, above = aside / to_rim, above / to_rim
        else:
            aside, above = float(aside > above), float(aside <= above)
        n_x, n_y, _ = unit(x, y, 0.0) if x or y else (1.0, 0.0, 0.0)
        return aside * n_x, aside * n_y, math.copysign(above, z)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3), m."""
        aside = np.hypot(points[:, 0], points[:, 1]) - self.radius
        return _outside_corner(np.column_stack([aside, np.abs(points[:, 2]) - self.height / 2]))


def _outside_corner(beyond: FloatArray) -> FloatArray:
    """Return distances of points of shape (n, axes) from a convex corner at the origin."""
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return np.asarray(outside + np.minimum(beyond.max(axis=1), 0))


def unit(x: float, y: float, z: float) -> Vector:
    """Return a direction as a unit vector; upwards for zero."""
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length else UP

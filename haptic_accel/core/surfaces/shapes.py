# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shapes by their signed distance in their own frame: m, negative inside.

Shapes are solids by formula, height fields, and distance grids, for example of meshes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, cast

import numpy as np

from haptic_accel.core.model import ZERO, FloatArray, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter

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
        half = np.array([self.length, self.width, self.height]) / 2
        return _outside_corner(np.abs(points) - half)


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


SHAPES: Mapping[str, Any] = {"plane": Plane, "sphere": Sphere, "box": Box, "cylinder": Cylinder}
"""Solids by formula, by name in a file."""


def _outside_corner(beyond: FloatArray) -> FloatArray:
    """Return distances of points of shape (n, axes) from a convex corner at the origin."""
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return np.asarray(outside + np.minimum(beyond.max(axis=1), 0))


def unit(x: float, y: float, z: float) -> Vector:
    """Return a direction as a unit vector; upwards for zero."""
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length else UP


@dataclass(frozen=True, eq=False)
class HeightField:
    """Solid below a grid of heights around the origin; the heights continue beyond its border.

    Heights are interpolated bilinearly between samples.

    Attributes
    ----------
    heights : ndarray, shape (n, m)
        Heights in m, by index along x and y; at least two along each.
    spacing : float
        Distance between two samples, m.
    """

    heights: FloatArray
    spacing: float
    _corner: tuple[float, float] = field(init=False, repr=False)
    _rows: list[list[float]] = field(init=False, repr=False)
    _scale: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the samples.

        Raises
        ------
        ParameterError
            The samples are not a table of finite numbers, or the spacing is not above 0.
        """
        _check("heights", self.heights, self.spacing, axes=2)
        steepest = _slopes(self.heights, self.spacing).max()
        object.__setattr__(self, "_rows", self.heights.tolist())
        n, m = self.heights.shape
        corner = (-(n - 1) * self.spacing / 2, -(m - 1) * self.spacing / 2)
        object.__setattr__(self, "_corner", corner)
        # The distance is at least the height times the cosine of the steepest slope.
        object.__setattr__(self, "_scale", 1 / math.hypot(1, steepest))

    @property
    def stride(self) -> float:
        """Half of the spacing, m."""
        return self.spacing / 2

    def distance(self, x: float, y: float, z: float) -> float:
        """Return a lower bound of a point's signed distance, m; exact for a constant slope."""
        (a, b), (c, d), u, v = self._cell(x, y)
        return (z - (1 - u) * ((1 - v) * a + v * b) - u * ((1 - v) * c + v * d)) * self._scale

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the gradient of the distance: normal to the surface below a point."""
        (a, b), (c, d), u, v = self._cell(x, y)
        share = self._scale / self.spacing
        return (
            ((1 - v) * (a - c) + v * (b - d)) * share,
            ((1 - u) * (a - b) + u * (c - d)) * share,
            self._scale,
        )

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3), m."""
        positions = (points[:, :2] - self._corner) / self.spacing
        return (points[:, 2] - _interpolated(self.heights, positions)) * self._scale

    def _cell(self, x: float, y: float) -> tuple[Sequence[float], Sequence[float], float, float]:
        """Return the heights of a position's cell, two by two along x and y, and the weights."""
        row, u = _interval((x - self._corner[0]) / self.spacing, len(self._rows))
        column, v = _interval((y - self._corner[1]) / self.spacing, len(self._rows[0]))
        before, behind = self._rows[row], self._rows[row + 1]
        return before[column : column + 2], behind[column : column + 2], u, v


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Solid defined by signed distances on a grid, with trilinear interpolation.

    Parts thinner than two spacings are lost.

    Attributes
    ----------
    grid : ndarray, shape (n, m, k)
        Signed distances in m, by index along x, y and z; at least two along each.
    spacing : float
        Distance between two samples, m.
    corner : tuple of float
        Position of the first sample, m.
    """

    grid: FloatArray
    spacing: float
    corner: Vector = ZERO
    _flat: Sequence[float] = field(init=False, repr=False)
    _scale: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the samples.

        Raises
        ------
        ParameterError
            The samples are not a table of finite numbers, the spacing is not above 0, or the solid
            reaches the border.
        """
        _check("distances", self.grid, self.spacing, axes=3)
        inner = self.grid[1:-1, 1:-1, 1:-1]
        if (self.grid <= 0).sum() != (inner <= 0).sum():
            raise ParameterError("distances: must be above 0 m at the border of the grid")
        # A memory view returns Python floats without a copy.
        flat = np.ascontiguousarray(self.grid, dtype=float).ravel()
        object.__setattr__(self, "_flat", cast(Sequence[float], flat.data))
        # Interpolated distances may have a gradient above 1; this does not matter inside the
        # solid.
        outside = _largest_of_cells(self.grid) > 0
        steepest = _slopes(self.grid, self.spacing)[outside].max()
        object.__setattr__(self, "_scale", 1 / max(1.0, float(steepest)))

    @property
    def stride(self) -> float:
        """Half of the spacing, m."""
        return self.spacing / 2

    def distance(self, x: float, y: float, z: float) -> float:
        """Return a lower bound of the signed distance of a point, m; exact without steep cells."""
        value, _, outside = self._look(x, y, z)
        if outside == ZERO:
            return value * self._scale
        # The solid is within the grid: the distance to it is at least that of the nearest grid
        # position.
        return math.hypot(value * self._scale, *outside)

    def gradient(self, x: float, y: float, z: float) -> Vector:
        """Return the gradient of the distance; its length is only as exact as the distance."""
        value, (g_x, g_y, g_z), (o_x, o_y, o_z) = self._look(x, y, z)
        if o_x or o_y or o_z:
            return unit(value * g_x + o_x, value * g_y + o_y, value * g_z + o_z)
        g_x, g_y, g_z = unit(g_x, g_y, g_z)
        return self._scale * g_x, self._scale * g_y, self._scale * g_z

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points of shape (n, 3), m."""
        positions = (points - self.corner) / self.spacing
        last = np.array(self.grid.shape) - 1
        outside = np.linalg.norm(positions - positions.clip(0, last), axis=1) * self.spacing
        values = _interpolated(self.grid, positions) * self._scale
        return np.where(outside > 0, np.hypot(values, outside), values)

    def _look(self, x: float, y: float, z: float) -> tuple[float, Vector, Vector]:
        """Return distance and gradient at the nearest grid position, and the vector from it."""
        step, (c_x, c_y, c_z), (n, m, k) = self.spacing, self.corner, self.grid.shape
        a, b, c = (x - c_x) / step, (y - c_y) / step, (z - c_z) / step
        (i, u), (j, v), (h, w) = _interval(a, n), _interval(b, m), _interval(c, k)
        outside = ((a - i - u) * step, (b - j - v) * step, (c - h - w) * step)
        f, at = self._flat, (i * m + j) * k + h
        # Interpolate along z, then y, then x.
        rows = (at, at + k, at + m * k, at + m * k + k)
        p, q, r, s = ((1 - w) * f[row] + w * f[row + 1] for row in rows)
        p_z, q_z, r_z, s_z = (f[row + 1] - f[row] for row in rows)
        low, high = (1 - v) * p + v * q, (1 - v) * r + v * s
        gradient = (
            (high - low) / step,
            ((1 - u) * (q - p) + u * (s - r)) / step,
            ((1 - u) * ((1 - v) * p_z + v * q_z) + u * ((1 - v) * r_z + v * s_z)) / step,
        )
        return (1 - u) * low + u * high, gradient, outside


def _check(name: str, samples: FloatArray, spacing: float, axes: int) -> None:
    """Reject samples that are not a table of finite numbers, and a spacing not above 0."""
    if samples.ndim != axes or min(samples.shape) < 2:
        raise ParameterError(
            f"{name}: shape {samples.shape}: must have {axes} axes with at least 2 samples each"
        )
    if not np.all(np.isfinite(samples)):
        raise ParameterError(f"{name}: must be finite numbers")
    if not (math.isfinite(spacing) and spacing > 0):
        raise ParameterError(f"spacing = {spacing}: must be above 0 m")


def _slopes(samples: FloatArray, spacing: float) -> FloatArray:
    """Return an upper bound of the gradient between samples for each cell."""
    squares: FloatArray = np.zeros(())
    for axis in range(samples.ndim):
        steps = np.abs(np.diff(samples, axis=axis)) / spacing
        squares = squares + _largest_of_cells(steps, besides=axis) ** 2
    return np.asarray(np.sqrt(squares))


def _largest_of_cells(values: FloatArray, besides: int = -1) -> FloatArray:
    """Return the largest value at each cell's corners, along all axes but one."""
    for axis in set(range(values.ndim)) - {besides}:
        along = values.swapaxes(0, axis)
        values = np.maximum(along[1:], along[:-1]).swapaxes(0, axis)
    return values


def _interval(position: float, samples: int) -> tuple[int, float]:
    """Return the index of the sample before a position, in units of the spacing, and weight."""
    if position <= 0:
        return 0, 0.0
    if position >= samples - 1:
        return samples - 2, 1.0
    before = int(position)
    return before, position - before


def _interpolated(samples: FloatArray, positions: FloatArray) -> FloatArray:
    """Return interpolated values at positions of shape (n, axes) in units of the spacing."""
    from scipy import ndimage

    return np.asarray(ndimage.map_coordinates(samples, positions.T, order=1, mode="nearest"))

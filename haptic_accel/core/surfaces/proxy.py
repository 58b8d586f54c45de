# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tip position for rigid surfaces: a god-object (Zilles and Salisbury, 1995)."""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.surfaces.scene import Scene

SKIN = 1e-6
"""Distance between proxy and surfaces, m: below the resolution of encoders."""

STEPS = 8
"""Maximum number of steps of the proxy in a sample; it continues in the next sample."""

_ABOVE = 1e-9  # m; a position this far below a plane counts as above it: rounding
_PARALLEL = 1e-9  # sine squared of the angle between planes that count as parallel
_ARRIVED = 3e-6  # m; a shorter step is the last: planes rotate by less than 0.1 mrad
_SHORTER = 0.1  # fraction of a sample's first step; a shorter step is the last


class LocalPlane(NamedTuple):
    """Tangent plane of an object near the proxy; its points satisfy normal * point = offset.

    Attributes
    ----------
    number : int
        Index of the object in the scene.
    normal : tuple of float
        Outward direction of the object's surface.
    offset : float
        Distance of the plane from the origin along its normal, m.
    """

    number: int
    normal: Vector
    offset: float

    def height(self, position: Vector) -> float:
        """Return the height of a position above the plane, m."""
        n_x, n_y, n_z = self.normal
        return n_x * position[0] + n_y * position[1] + n_z * position[2] - self.offset


class Proxy:
    """Follow the tool outside all objects, as closely as possible.

    The proxy moves to the position nearest to the tool above the tangent planes of all nearby
    objects. A convex object lies below its tangent plane, so the path crosses no object, however
    thin or fast. Other shapes limit the step to their `stride`.

    Parameters
    ----------
    scene : Scene
    position : tuple of float
        Initial position, m; inside an object, the proxy leaves it at the nearest side.
    """

    def __init__(self, scene: Scene, position: Vector) -> None:
        self._objects = scene.objects
        self.position = position
        # Travelled distance at which each object's distance is due for recomputation, since the
        # proxy may then have reached it. Few objects are thus computed.
        self._travelled = 0.0
        self._due = [0.0] * len(scene.objects)

    def follow(self, tool: Vector, margin: float) -> list[LocalPlane]:
        """Move towards the tool; return the planes of all objects within a distance.

        Parameters
        ----------
        tool : tuple of float
            Position of the tool, m.
        margin : float
            Maximum distance of an object, m.
        """
        near: list[tuple[LocalPlane, float]] = []
        short = _ARRIVED
        for _ in range(STEPS):
            x, y, z = self.position
            near, clearance = self._near(x, y, z, math.dist(self.position, tool) + margin)
            goal = _nearest_outside(tool, [plane for plane, _ in near]) if near else tool
            d_x, d_y, d_z = step = goal[0] - x, goal[1] - y, goal[2] - z
            length = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
            share = min(_allowed(step, near), clearance / length) if length else 0.0
            self.position = (x + share * d_x, y + share * d_y, z + share * d_z)
            self._travelled += share * length
            if not near or length < short:
                break
            short = max(short, _SHORTER * length)
        return [plane for plane, height in near if height <= margin]

    def _near(
        self, x: float, y: float, z: float, reach: float
    ) -> tuple[list[tuple[LocalPlane, float]], float]:
        """Return planes of nearby objects, heights above them, and the longest safe step."""
        travelled, due = self._travelled, self._due
        near = []
        clearance = math.inf
        for index, at in enumerate(due):
            if at > travelled + reach:
                continue
            each = self._objects[index]
            distance = each.distance(x, y, z)
            due[index] = travelled + distance
            if distance > reach:
                continue
            g_x, g_y, g_z = each.gradient(x, y, z)
            slope = math.sqrt(g_x * g_x + g_y * g_y + g_z * g_z)
            normal = n_x, n_y, n_z = g_x / slope, g_y / slope, g_z / slope
            # Where the distance is only a lower bound, the tangent plane is further away.
            height = distance / slope
            plane = LocalPlane(index, normal, n_x * x + n_y * y + n_z * z - height)
            near.append((plane, height))
            clearance = min(clearance, max(distance, each.shape.stride))
        return near, clearance


def _allowed(step: Vector, near: list[tuple[LocalPlane, float]]) -> float:
    """Return the fraction of a step that stays above all planes, from the initial heights."""
    share = 1.0
    for (_, normal, _), height in near:
        approach = -(normal[0] * step[0] + normal[1] * step[1] + normal[2] * step[2])
        if approach > max(height, 0.0):
            share = min(share, max(height, 0.0) / approach)
    return share


def _nearest_outside(tool: Vector, planes: list[LocalPlane]) -> Vector:
    """Return the position nearest to a tool that is above all planes.

    Dual active-set method (Goldfarb and Idnani, 1983): the number of steps does not depend on the
    angles between the planes. If there is no such position, for example between planes that face
    each other, the result is above the planes of the last step.
    """
    x, y, z = tool
    active: list[Vector] = []
    shares: list[float] = []
    for _ in range(2 * len(planes)):
        gap, normal = _deepest((x, y, z), planes)
        if gap <= _ABOVE:
            break
        if not active:  # most often the only step
            active, shares = [normal], [gap]
            x, y, z = x + gap * normal[0], y + gap * normal[1], z + gap * normal[2]
            if len(planes) == 1:
                break
            continue
        share = 0.0
        while True:
            (f_x, f_y, f_z), parts = _split(normal, active)
            lift = normal[0] * f_x + normal[1] * f_y + normal[2] * f_z
            push = gap / lift if lift > _PARALLEL else math.inf
            limits = [u / part for u, part in zip(shares, parts, strict=True) if part > 0]
            step = min([push, *limits])
            if step == math.inf:
                return x, y, z
            if lift > _PARALLEL:
                x, y, z = x + step * f_x, y + step * f_y, z + step * f_z
                gap -= step * lift
            shares = [u - step * part for u, part in zip(shares, parts, strict=True)]
            share += step
            if step == push:
                active.append(normal)
                shares.append(share)
                break
            least = shares.index(min(shares))
            del active[least], shares[least]
    return x, y, z


def _deepest(position: Vector, planes: list[LocalPlane]) -> tuple[float, Vector]:
    """Return the depth of a position below the plane furthest above it, and the plane's normal."""
    x, y, z = position
    most, found = -math.inf, ZERO
    for _, normal, offset in planes:
        gap = offset + SKIN - (normal[0] * x + normal[1] * y + normal[2] * z)
        if gap > most:
            most, found = gap, normal
    return most, found


def _split(normal: Vector, active: list[Vector]) -> tuple[Vector, list[float]]:
    """Split a normal into a part orthogonal to up to three others, and components along those."""
    x, y, z = normal
    if not active:
        return normal, []
    a = active[0]
    if len(active) == 1:
        part = a[0] * x + a[1] * y + a[2] * z
        return (x - part * a[0], y - part * a[1], z - part * a[2]), [part]
    b = active[1]
    ab = _cross(a, b)
    c = ab if len(active) == 2 else active[2]
    bc, ca = _cross(b, c), _cross(c, a)
    volume = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2]
    parts = [(each[0] * x + each[1] * y + each[2] * z) / volume for each in (bc, ca, ab)]
    if len(active) > 2:
        return ZERO, parts
    part = parts.pop()
    return (part * c[0], part * c[1], part * c[2]), parts


def _cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]

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

"""Tip position for rigid surfaces: a god-object (Zilles and Salisbury, 1995)."""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_accel.core.model import Vector
from haptic_accel.core.surfaces.scene import Scene

SKIN = 1e-6
"""Distance between proxy and surfaces, m: below the resolution of encoders."""

STEPS = 8
"""Maximum number of steps of the proxy in a sample; it continues in the next sample."""

_SWEEPS = 4  # maximum sweeps over the planes to find the nearest position outside all
_ARRIVED = 3e-6  # m; a shorter step is the last: planes turn by less than 0.1 mrad


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

    def height(self, place: Vector) -> float:
        """Return the height of a position above the plane, m."""
        n_x, n_y, n_z = self.normal
        return n_x * place[0] + n_y * place[1] + n_z * place[2] - self.offset


class Proxy:
    """Follow the tool outside all objects, as closely as possible.

    The proxy moves to the position nearest to the tool above the tangent planes of all nearby
    objects. A convex object lies below its tangent plane, so the path crosses no object, however
    thin or fast. Other shapes limit the step to their `stride`.

    Parameters
    ----------
    scene : Scene
    place : tuple of float
        Initial position, m; inside an object, the proxy leaves it at the nearest side.
    """

    def __init__(self, scene: Scene, place: Vector) -> None:
        self._objects = scene.objects
        self.place = place
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
            Distance in m.
        """
        near: list[tuple[LocalPlane, float]] = []
        for _ in range(STEPS):
            x, y, z = self.place
            way = math.dist(self.place, tool)
            near, clearance = self._near(x, y, z, way + margin)
            goal = _nearest_outside(tool, [plane for plane, _ in near]) if near else tool
            d_x, d_y, d_z = step = goal[0] - x, goal[1] - y, goal[2] - z
            length = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
            share = min(_allowed(step, near), clearance / length) if length else 0.0
            self.place = (x + share * d_x, y + share * d_y, z + share * d_z)
            self._travelled += share * length
            if not near or length < _ARRIVED:
                break
        return [plane for plane, distance in near if distance <= margin]

    def _near(
        self, x: float, y: float, z: float, reach: float
    ) -> tuple[list[tuple[LocalPlane, float]], float]:
        """Return planes and distances of objects within reach, and the longest safe step."""
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
            normal = n_x, n_y, n_z = each.normal(x, y, z)
            plane = LocalPlane(index, normal, n_x * x + n_y * y + n_z * z - distance)
            near.append((plane, distance))
            clearance = min(clearance, max(distance, each.shape.stride))
        return near, clearance


def _allowed(step: Vector, near: list[tuple[LocalPlane, float]]) -> float:
    """Return the fraction of a step that stays above all planes at given distances."""
    share = 1.0
    for (_, normal, _), distance in near:
        approach = -(normal[0] * step[0] + normal[1] * step[1] + normal[2] * step[2])
        if approach > max(distance, 0.0):
            share = min(share, max(distance, 0.0) / approach)
    return share


def _nearest_outside(tool: Vector, planes: list[LocalPlane]) -> Vector:
    """Return the position nearest to a tool that is above all planes (Hildreth, 1957)."""
    x, y, z = tool
    shares = [0.0] * len(planes)
    for _ in range(_SWEEPS if len(planes) > 1 else 1):
        moved = False
        for index, ((_, (n_x, n_y, n_z), offset), share) in enumerate(
            zip(planes, shares, strict=True)
        ):
            push = max(-share, offset + SKIN - (n_x * x + n_y * y + n_z * z))
            if push:
                shares[index] = share + push
                x, y, z = x + push * n_x, y + push * n_y, z + push * n_z
                moved = True
        if not moved:
            break
    return x, y, z

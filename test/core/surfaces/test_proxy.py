# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The proxy is never inside, never behind, and as near to the tool as it can be."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from haptic_accel.core.model import Vector
from haptic_accel.core.surfaces.proxy import SKIN, Proxy
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Box, Cylinder, DistanceGrid, Plane, Shape, Sphere

few = settings(deadline=None, max_examples=20)

ROUNDING = 1e-12
PERIOD = 1e-3
MARGIN = 1e-4

WOOD = Material("wood")

places = st.tuples(*[st.floats(-0.06, 0.06)] * 3)
turns = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)
sizes = st.floats(1e-3, 0.04)
shapes: st.SearchStrategy[Shape] = st.one_of(
    st.builds(Sphere, sizes),
    st.builds(Box, sizes, sizes, sizes),
    st.builds(Cylinder, sizes, sizes),
)
Placed = tuple[Shape, Vector, Vector]
scenes = st.lists(st.tuples(shapes, places, turns), min_size=1, max_size=4)


def scene(*objects: Placed) -> Scene:
    return Scene(
        tuple(
            SceneObject(str(number), shape, WOOD, place, turn)
            for number, (shape, place, turn) in enumerate(objects)
        )
    )


def way(*stations: Vector, speed: float) -> list[Vector]:
    """Return the places of a tool, sample by sample."""
    found = [stations[0]]
    for start, end in itertools.pairwise(stations):
        samples = max(1, math.ceil(math.dist(start, end) / (speed * PERIOD)))
        steps = np.linspace(start, end, samples + 1)[1:]
        found += [(x, y, z) for x, y, z in steps.tolist()]
    return found


@few
@given(scenes, st.lists(places, min_size=2, max_size=5), st.floats(0.5, 5.0))
def test_it_is_never_inside_of_an_object(
    objects: list[Placed], stations: list[Vector], speed: float
) -> None:
    there = scene(*objects)
    proxy = Proxy(there, (0.0, 0.0, 0.1))
    for tool in way((0.0, 0.0, 0.1), *stations, speed=speed)[:200]:
        proxy.follow(tool, MARGIN)
        assert min(each.distance(*proxy.position) for each in there.objects) > -ROUNDING


PLATE = 1.2e-3
BAKED = DistanceGrid(
    Box(0.04, 0.04, PLATE)
    .distances(
        np.mgrid[-0.025:0.0251:5e-4, -0.025:0.0251:5e-4, -0.003:0.0031:5e-4].reshape(3, -1).T
    )
    .reshape(101, 101, 13),
    5e-4,
    (-0.025, -0.025, -0.003),
)


@few
@given(
    st.sampled_from([Box(0.04, 0.04, PLATE), BAKED]),
    st.floats(0.05, 20.0),
    st.tuples(*[st.floats(-0.01, 0.01)] * 4),
    turns,
)
def test_a_thin_plate_holds_it_however_fast_the_tool_is(
    plate: Shape, speed: float, aside: tuple[float, float, float, float], turn: Vector
) -> None:
    there = scene((plate, (0.0, 0.0, 0.0), turn))
    matrix = Rotation.from_euler("xyz", turn).as_matrix()
    start, end = (
        tuple((matrix @ (*beside, z)).tolist())
        for beside, z in ((aside[:2], 0.02), (aside[2:], -0.01))
    )
    proxy = Proxy(there, start)
    for tool in way(start, end, speed=speed):
        proxy.follow(tool, MARGIN)
        assert np.dot(proxy.position, matrix[:, 2]) > PLATE / 2 - 1e-6
    assert np.dot(proxy.position, matrix[:, 2]) == pytest.approx(PLATE / 2, abs=2e-6) or speed > 1


@pytest.mark.parametrize(
    ("tool", "nearest"),
    [
        ((0.0, 0.0, -0.01), (0.0, 0.0, 0.0)),
        ((0.01, 0.02, -0.03), (0.01, 0.02, 0.0)),
        ((0.01, 0.02, 0.03), (0.01, 0.02, 0.03)),
    ],
)
def test_on_a_plane_it_is_above_the_tool(tool: Vector, nearest: Vector) -> None:
    proxy = Proxy(scene((Plane(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))), (0.0, 0.0, 0.05))
    for _ in range(3):
        proxy.follow(tool, MARGIN)
    assert proxy.position == pytest.approx(nearest, abs=1.1 * SKIN)


@few
@given(places, st.floats(0.01, 0.04))
def test_on_a_sphere_it_comes_to_the_place_nearest_to_the_tool(
    tool: Vector, radius: float
) -> None:
    proxy = Proxy(scene((Sphere(radius), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))), (0.0, 0.0, 0.1))
    for _ in range(40):
        proxy.follow(tool, MARGIN)
    size = math.hypot(*tool)
    if size > radius:
        assert proxy.position == pytest.approx(tool, abs=1e-5)
    elif size > 0.1 * radius and tool[2] > -0.9 * size:
        nearest = [radius / size * part for part in tool]
        assert proxy.position == pytest.approx(nearest, abs=1e-4)


def test_it_slides_off_an_edge_and_down_the_side() -> None:
    proxy = Proxy(scene((Box(0.04, 0.04, 0.02), (0.0, 0.0, -0.01), (0.0, 0.0, 0.0))), (0, 0, 0.01))
    for tool in way((0.0, 0.0, 0.01), (0.0, 0.0, -0.001), (0.03, 0.0, -0.001), speed=0.2):
        planes = proxy.follow(tool, MARGIN)
        if tool[0] < 0.0199:
            assert proxy.position[2] >= 0.0
    assert planes == []
    assert proxy.position == tool


def test_in_a_corner_of_three_walls_it_stays_in_the_corner() -> None:
    quarter = math.pi / 2
    corner = scene(
        (Plane(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (Plane(), (0.0, 0.0, 0.0), (0.0, quarter, 0.0)),
        (Plane(), (0.0, 0.0, 0.0), (-quarter, 0.0, 0.0)),
    )
    proxy = Proxy(corner, (0.03, 0.03, 0.03))
    for tool in way((0.03, 0.03, 0.03), (-0.01, -0.02, -0.03), speed=0.5):
        planes = proxy.follow(tool, MARGIN)
    assert proxy.position == pytest.approx((0.0, 0.0, 0.0), abs=2 * SKIN)
    assert sorted(plane.number for plane in planes) == [0, 1, 2]


slopes = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@few
@given(
    st.lists(slopes, min_size=1, max_size=5),
    st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.02, 0.0)),
)
def test_between_planes_it_comes_at_once_to_the_place_nearest_to_the_tool(
    turned: list[tuple[float, float]], tool: Vector
) -> None:
    plane = scene(*((Plane(), (0.0, 0.0, 0.0), (roll, pitch, 0.0)) for roll, pitch in turned))
    proxy = Proxy(plane, (0.0, 0.0, 0.06))
    for _ in range(2):
        proxy.follow(tool, MARGIN)
    normals = np.array([each.gradient(*tool) for each in plane.objects])
    # The nearest place in a cone: the tool, and a positive sum of normals (Moreau, 1962).
    shares, _ = nnls(normals.T, -np.array(tool))
    assert proxy.position == pytest.approx(tool + shares @ normals, abs=1e-4)


@pytest.mark.parametrize("angle", [5.0, 15.0, 60.0])
def test_in_an_acute_groove_it_stays_at_the_bottom(angle: float) -> None:
    steep = math.radians(90.0 - angle / 2)
    groove = scene(
        (Plane(), (0.0, 0.0, 0.0), (0.0, steep, 0.0)),
        (Plane(), (0.0, 0.0, 0.0), (0.0, -steep, 0.0)),
    )
    proxy = Proxy(groove, (0.0, 0.0, 0.03))
    bottom = SKIN / math.sin(math.radians(angle / 2))
    for tool in way((0.0, 0.0, -0.01), (0.001, 0.02, -0.01), speed=0.5):
        planes = proxy.follow(tool, MARGIN)
        assert proxy.position == pytest.approx((0.0, tool[1], bottom), abs=1e-8)
        assert len(planes) == 2

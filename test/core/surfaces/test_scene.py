# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes: objects at their places, what a straight way meets, and outlines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Box, Plane, Sphere

few = settings(deadline=None, max_examples=30)
places = st.tuples(*[st.floats(-0.1, 0.1)] * 3)
turns = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)

WOOD = Material("wood")
BOX = Box(0.02, 0.04, 0.06)
BENCH = Scene(
    (
        SceneObject("table", Plane(), WOOD),
        SceneObject("ball", Sphere(0.02), WOOD, (0.05, 0.0, 0.01)),
    )
)


@few
@given(places, turns, places)
def test_an_object_is_its_shape_turned_and_moved(
    position: Vector, turn: Vector, place: Vector
) -> None:
    turned = SceneObject("box", BOX, WOOD, position, turn)
    # Roll, pitch, yaw about fixed axes: the intrinsic order is z, y, x.
    rotation = Rotation.from_euler("xyz", turn)
    own = rotation.inv().apply(np.subtract(place, position)).tolist()
    assert turned.distance(*place) == pytest.approx(BOX.distance(*own), abs=1e-12)
    assert turned.distances(np.array([place])) == pytest.approx([BOX.distance(*own)], abs=1e-12)
    # Along the normal the distance grows by the way; in the middle several directions are normal.
    outwards = np.add(place, np.multiply(1e-3, turned.gradient(*place)))
    assert turned.distance(*outwards) == pytest.approx(turned.distance(*place) + 1e-3, abs=1e-9)


@pytest.mark.parametrize(
    ("place", "hit"),
    [
        ((0.0, 0.0, 0.2), (0, 0.2)),
        ((0.05, 0.0, 0.2), (1, 0.2 - 0.03)),
        ((0.05, 0.0, 0.02), (-1, 0.0)),
        ((0.0, 0.0, 2.0), (-1, None)),
    ],
)
def test_a_way_meets_the_first_object(place: Vector, hit: tuple[int, float | None]) -> None:
    number, way = BENCH.first_hit(place, (0.0, 0.0, -1.0), 1.0)
    assert number == hit[0]
    assert hit[1] is None or way == pytest.approx(hit[1], abs=1e-6)


def test_a_section_shows_the_outlines_of_what_it_cuts() -> None:
    lines = BENCH.section((-0.1, 0.1), (-0.05, 0.05))
    assert sorted(lines) == ["ball", "table"]
    (table,), (ball,) = lines["table"], lines["ball"]
    assert table[:, 1] == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(ball[:, 0] - 0.05, ball[:, 1] - 0.01) == pytest.approx(0.02, abs=1e-5)
    assert list(BENCH.section((-0.1, 0.1), (-0.05, 0.05), y=0.03)) == ["table"]


def test_a_moved_scene_has_all_objects_elsewhere() -> None:
    moved = BENCH.moved((0.0, 0.0, 0.1))
    assert [each.distance(0.0, 0.0, 0.1) for each in moved.objects] == pytest.approx(
        [each.distance(0.0, 0.0, 0.0) for each in BENCH.objects]
    )
    assert moved.start == BENCH.start


def test_two_objects_of_one_name_are_refused() -> None:
    with pytest.raises(ParameterError, match="name = 'table': must be that of one object, not 2"):
        Scene((BENCH.objects[0], BENCH.objects[0]))


def test_a_material_that_sticks_less_than_it_slides_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"friction = 0.5: must be at most static_friction"):
        Material(static_friction=0.4, friction=0.5)

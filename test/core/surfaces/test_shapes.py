# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shapes: signed distances, normals, and both of sampled ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.shapes import (
    Box,
    Cylinder,
    DistanceGrid,
    HeightField,
    Plane,
    Shape,
    Sphere,
)

few = settings(deadline=None, max_examples=50)

RNG = np.random.default_rng(1)
HILLS = HeightField(RNG.normal(0.0, 1e-3, (12, 9)), 5e-3)

STEP = 2e-3
AXIS = np.arange(-0.03, 0.0301, STEP)
BALL = Sphere(0.02)
BAKED = DistanceGrid(
    BALL.distances(
        np.stack(np.meshgrid(AXIS, AXIS, AXIS, indexing="ij"), -1).reshape(-1, 3)
    ).reshape([len(AXIS)] * 3),
    STEP,
    (-0.03, -0.03, -0.03),
)

SHAPES: list[Shape] = [*(Plane(), BALL, Box(0.03, 0.05, 0.02), Cylinder(0.02, 0.03), HILLS, BAKED)]
shapes = st.sampled_from(SHAPES)
places = st.tuples(*[st.floats(-0.05, 0.05)] * 3)


@few
@given(shapes, places, places)
def test_no_distance_changes_by_more_than_the_way(
    shape: Shape, one: Vector, other: Vector
) -> None:
    if shape is BAKED:  # which keeps to it on the way to the surface, not within
        one, other = (tuple(4.0 * part for part in place) for place in (one, other))
        assume(np.linalg.norm([one, other], axis=1).min() > 0.02)
    change = abs(shape.distance(*one) - shape.distance(*other))
    assert change <= math.dist(one, other) + 1e-12


@few
@given(shapes, places)
def test_the_distance_grows_along_its_gradient_at_most_as_fast_as_the_way(
    shape: Shape, place: Vector
) -> None:
    gradient = np.array(shape.gradient(*place))
    slope = np.linalg.norm(gradient)
    assert 0.2 < slope <= 1.0 + 1e-12
    step = 1e-6 * gradient / slope
    ahead, behind = np.array(place) + step, np.array(place) - step
    growth = (shape.distance(*ahead) - shape.distance(*behind)) / 2e-6
    # On an edge, in the middle and between cells there are several directions.
    assert growth > 0.5 * slope or _has_a_crease(shape, np.array(place))


def _has_a_crease(shape: Shape, place: np.ndarray) -> bool:
    around = [
        shape.gradient(*(place + shift)) for shift in 2e-6 * np.vstack([np.eye(3), -np.eye(3)])
    ]
    return bool(np.ptp(np.array(around), axis=0).max() > 0.01)


@few
@given(shapes, st.lists(places, min_size=1, max_size=5))
def test_distances_are_those_of_each_place(shape: Shape, several: list[Vector]) -> None:
    expected = [shape.distance(*place) for place in several]
    assert shape.distances(np.array(several)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("shape", "place", "distance"),
    [
        (Plane(), (1.0, 2.0, -0.3), -0.3),
        (Sphere(0.02), (0.03, 0.0, 0.04), 0.03),
        (Box(0.02, 0.04, 0.06), (0.013, 0.024, 0.0), 0.005),
        (Box(0.02, 0.04, 0.06), (0.0, 0.018, 0.0), -0.002),
        (Cylinder(0.02, 0.06), (0.0, 0.023, 0.034), 0.005),
        (Cylinder(0.02, 0.06), (0.015, 0.0, 0.0), -0.005),
        (HeightField(np.full((2, 2), 0.01), 0.1), (3.0, 0.0, 0.03), 0.02),
    ],
)
def test_known_distances(shape: Shape, place: Vector, distance: float) -> None:
    assert shape.distance(*place) == pytest.approx(distance)


@few
@given(places)
def test_a_grid_of_a_ball_is_that_ball(place: Vector) -> None:
    exact, baked = BALL.distance(*place), BAKED.distance(*place)
    # Between samples a convex distance is overestimated by less than h^2 / r.
    assert baked < exact + STEP**2 / 0.02 or exact < 0
    if abs(exact) < STEP:
        assert baked == pytest.approx(exact, abs=STEP**2 / 0.02 + 0.1 * abs(exact))
        assert np.dot(BAKED.gradient(*place), BALL.gradient(*place)) > 0.9


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: Sphere(-1.0), "radius = -1.0: must be from 0.001 to 1 m"),
        (lambda: HeightField(np.zeros(3), 1e-3), "heights: shape .3,.: must have 2 axes"),
        (lambda: HeightField(np.full((2, 2), np.nan), 1e-3), "heights: must be finite numbers"),
        (lambda: HeightField(np.zeros((2, 2)), 0.0), "spacing = 0.0: must be above 0 m"),
        (lambda: DistanceGrid(np.full((3, 3, 3), -1.0), 1e-3), "above 0 m at the border"),
    ],
)
def test_wrong_values_are_refused(make: object, error: str) -> None:
    assert callable(make)
    with pytest.raises(ParameterError, match=error):
        make()

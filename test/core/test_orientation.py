# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Directions of vibration at a turned tool and a turned handle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from haptic_accel.core.model import IDENTITY, Quaternion, Vector
from haptic_accel.core.orientation import Orientation, from_base, to_base, unit_quaternion

part = st.floats(-1.0, 1.0)
quaternions = (
    st.tuples(part, part, part, part)
    .filter(lambda parts: math.hypot(*parts) > 0.1)
    .map(lambda parts: tuple(each / math.hypot(*parts) for each in parts))
)
number = st.floats(-100.0, 100.0)
vectors = st.tuples(number, number, number)


@given(quaternions, vectors)
def test_a_turn_is_that_of_the_rotation_matrix(turn: Quaternion, vector: Vector) -> None:
    assert to_base(turn, vector) == pytest.approx(Rotation(turn).apply(vector), abs=1e-9)


@given(quaternions, vectors)
def test_a_handle_turned_like_the_tool_feels_its_components(
    turn: Quaternion, vector: Vector
) -> None:
    assert from_base(turn, to_base(turn, vector)) == pytest.approx(vector, abs=1e-9)


@given(quaternions, vectors)
def test_both_quaternions_of_a_rotation_turn_alike(turn: Quaternion, vector: Vector) -> None:
    x, y, z, w = turn
    assert to_base((-x, -y, -z, -w), vector) == pytest.approx(to_base(turn, vector), abs=1e-9)


@given(quaternions, quaternions, vectors)
def test_tool_and_handle_are_composed(tool: Quaternion, handle: Quaternion, a: Vector) -> None:
    composed = Rotation(handle).inv() * Rotation(tool)
    assert from_base(handle, to_base(tool, a)) == pytest.approx(composed.apply(a), abs=1e-9)


@given(vectors)
def test_without_a_turn_a_vector_stays_bit_for_bit(vector: Vector) -> None:
    assert to_base(IDENTITY, vector) is vector
    assert from_base(IDENTITY, vector) is vector


def test_a_turned_wrist_feels_the_direction_that_the_tool_has() -> None:
    # The tool points along the base's x axis, and vibrates along it: its own z axis.
    pitched = unit_quaternion([0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)])
    assert pitched
    assert to_base(pitched, (0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    # A handle held upright needs its x coil for this, one pitched as the tool its z coil.
    assert from_base(pitched, (1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)


@pytest.mark.parametrize(
    "values",
    [[0.0] * 4, [0.0, 0.0, 0.0, 1.02], [math.nan, 0.0, 0.0, 1.0], [math.inf] * 4, [1.0], []],
    ids=str,
)
def test_what_is_no_rotation_is_told_and_turns_nothing(values: list[float]) -> None:
    assert unit_quaternion(values) is None
    tool = Orientation()
    tool.put(values)
    assert tool.newest == IDENTITY
    assert "is not a unit quaternion" in tool.problem
    tool.put([1.0, 0.0, 0.0, 0.0])
    assert tool.newest == (1.0, 0.0, 0.0, 0.0)
    assert tool.problem == ""
    tool.put(values)
    assert tool.newest == (1.0, 0.0, 0.0, 0.0)
    assert tool.problem


@given(quaternions, st.floats(0.991, 1.009))
def test_a_rounded_quaternion_is_made_one_of_unit_length(turn: Quaternion, factor: float) -> None:
    found = unit_quaternion(np.multiply(turn, factor).tolist())
    assert found is not None
    assert found == pytest.approx(turn, abs=1e-12)

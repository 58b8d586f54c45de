# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Axes and orientation of a device's vibration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from haptic_accel.core.axes import (
    ACTUATOR_AXES,
    ALL_AXES,
    HIGHEST_CONDITION,
    NAMES,
    Axes,
    Mounting,
    Orientation,
    from_base,
    read_mounting,
    read_numbers,
    to_base,
    unit_quaternion,
)
from haptic_accel.core.model import IDENTITY, Quaternion, Vector
from haptic_accel.core.parameters import ParameterError


@given(st.sets(st.sampled_from(NAMES), min_size=1), st.tuples(*[st.floats(-1, 1)] * 3))
def test_a_vector_keeps_its_components_along_the_axes_and_loses_the_others(
    names: set[str], vector: tuple[float, float, float]
) -> None:
    axes = Axes(tuple(sorted(names)))
    kept = axes.vector(axes.components(vector))
    assert all(
        each == (before if name in names else 0.0)
        for name, each, before in zip(NAMES, kept, vector, strict=True)
    )


@pytest.mark.parametrize("text", ["x y z", "x,y,z", " x, y , z"])
def test_axes_are_read_with_commas_or_spaces(text: str) -> None:
    assert Axes.parsed(text) == ALL_AXES


@pytest.mark.parametrize("text", ["", "w", "z, x", "x, x", "X"])
def test_other_axes_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ParameterError, match="axes = .*must be some of x, y, z"):
        Axes.parsed(text)


number = st.floats(-1, 1)
directions = st.lists(number, min_size=9, max_size=9).filter(
    lambda numbers: min(np.linalg.norm(np.reshape(numbers, (3, 3)), axis=1)) > 0.01
)


@given(directions, st.tuples(number, number, number))
def test_a_mounting_finds_what_its_axes_see_and_sums_to_what_is_wanted(
    numbers: list[float], vector: tuple[float, float, float]
) -> None:
    rows = np.reshape(numbers, (3, 3))
    units = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    if np.linalg.cond(units) > HIGHEST_CONDITION:
        with pytest.raises(ParameterError, match="not orthogonal enough to be inverted"):
            Mounting(rows)
        return
    mounting = Mounting(rows)
    x, y, z = units @ vector
    assert mounting.acceleration((x, y, z)) == pytest.approx(vector, abs=1e-12)
    assert units.T @ mounting.coil_forces(vector) == pytest.approx(vector, abs=1e-12)


def test_a_mounting_is_read_from_nine_numbers() -> None:
    mounting = read_mounting("mounting", "0 1 0, -1,0,0, 0 0 1", ALL_AXES)
    assert mounting
    assert mounting.coil_forces((1.0, 2.0, 3.0)) == (2.0, -1.0, 3.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 0 0, 0 1 0", "must be 9 finite numbers"),
        ("1 0 0, 0 1 0, 0 0 nan", "must be 9 finite numbers"),
        ("1 0 0, 0 1 0, 0 0 1e999", "must be 9 finite numbers"),
        ("1 0 0, 0 1 0, 0 0 0", "number is inf, must be at most 10"),
        ("1 0 0, 0 1 0, 1 0.1 0.05", "must be at most 10"),
    ],
)
def test_another_mounting_is_refused_in_one_line(text: str, told: str) -> None:
    with pytest.raises(ParameterError, match=f"^audio.coil_mounting.*{told}") as raised:
        read_mounting("audio.coil_mounting", text, ALL_AXES)
    assert "\n" not in str(raised.value)


def test_a_device_with_one_axis_has_no_mounting() -> None:
    assert read_mounting("mounting", "", ALL_AXES) is None
    assert read_mounting("mounting", "1 0 0, 0 1 0, 0 0 1", ACTUATOR_AXES) is None


def test_numbers_are_counted() -> None:
    with pytest.raises(ParameterError, match="offsets = '1 2': must be 3 finite numbers"):
        read_numbers("offsets", "1 2", 3)


part = st.floats(-1.0, 1.0)
quaternions = (
    st.tuples(part, part, part, part)
    .filter(lambda parts: math.hypot(*parts) > 0.1)
    .map(lambda parts: tuple(each / math.hypot(*parts) for each in parts))
)
component = st.floats(-100.0, 100.0)
vectors = st.tuples(component, component, component)


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

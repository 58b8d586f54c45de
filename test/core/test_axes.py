# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the axes of a device."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.axes import (
    ACTUATOR_AXES,
    ALL_AXES,
    HIGHEST_CONDITION,
    NAMES,
    Axes,
    Mounting,
    read_mounting,
    read_numbers,
)
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

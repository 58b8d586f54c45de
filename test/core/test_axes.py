# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from haptic_accel.core.axes import (
    ACTUATOR_AXES,
    ALL_AXES,
    HIGHEST_CONDITION,
    LATER_TURN,
    LEARNING,
    LIVE_REDUCTIONS,
    NAMES,
    REDUCTIONS,
    Axes,
    Mounting,
    Orientation,
    PrincipalDirection,
    coil_component,
    dft321,
    from_base,
    live_reduction,
    magnitude,
    principal,
    read_mounting,
    read_numbers,
    to_base,
    total,
    unit_quaternion,
)
from haptic_accel.core.model import IDENTITY, FloatArray, Quaternion, Vector, vector
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


TIME = np.arange(1000) / 1000.0
WAVE = np.sin(2 * np.pi * 50.0 * TIME)
recordings = arrays.arrays(
    np.float64, st.tuples(st.integers(1, 64), st.just(3)), elements=st.floats(-50.0, 50.0)
)


@pytest.mark.parametrize(
    "reduced",
    [dft321, principal, total],
    ids=lambda each: each.__name__,
)
def test_a_vibration_along_one_axis_stays_as_it_is(reduced: object) -> None:
    alone = np.column_stack([0 * TIME, WAVE, 0 * TIME])
    np.testing.assert_allclose(reduced(alone), WAVE, atol=1e-9)  # type: ignore[operator]


def test_dft321_has_the_power_of_all_axes_in_each_line_and_the_phase_of_the_sum() -> None:
    noise = np.random.default_rng(1).standard_normal((1000, 3))
    found, lines = np.fft.rfft(dft321(noise)), np.fft.rfft(noise, axis=0)
    np.testing.assert_allclose(np.abs(found) ** 2, np.sum(np.abs(lines) ** 2, axis=1))
    # The lines at zero and at half the rate are real.
    np.testing.assert_allclose(np.angle(found / lines.sum(axis=1))[1:-1], 0.0, atol=1e-9)


def test_the_axis_is_that_of_the_coil() -> None:
    np.testing.assert_array_equal(coil_component(np.array([[1.0, 2.0, 3.0]])), [3.0])


@settings(deadline=None)
@given(recordings)
def test_dft321_keeps_the_energy_of_all_axes(acceleration: np.ndarray) -> None:
    # Parseval's theorem, as each line of the spectrum has the power of the three.
    assert np.sum(dft321(acceleration) ** 2) == pytest.approx(np.sum(acceleration**2), abs=1e-6)


def test_the_sum_cancels_what_dft321_keeps() -> None:
    opposite = np.column_stack([WAVE, -WAVE, 0 * TIME])
    assert np.abs(total(opposite)).max() < 1e-12
    assert dft321(opposite).std() == pytest.approx(np.sqrt(2) * WAVE.std())


def test_a_circle_has_half_of_its_power_along_one_direction_and_a_constant_length() -> None:
    circle = np.column_stack([WAVE, np.cos(2 * np.pi * 50.0 * TIME), 0 * TIME])
    assert principal(circle).std() == pytest.approx(WAVE.std(), rel=1e-3)
    np.testing.assert_allclose(magnitude(circle), 1.0)
    assert dft321(circle).std() == pytest.approx(np.sqrt(2) * WAVE.std())


def test_an_oscillation_has_its_length_twice_a_period() -> None:
    slanted = np.outer(WAVE, [0.6, 0.0, 0.8])
    lines = np.abs(np.fft.rfft(magnitude(slanted) - magnitude(slanted).mean()))
    assert lines.argmax() == 100
    np.testing.assert_allclose(principal(slanted), WAVE, atol=1e-9)
    np.testing.assert_allclose(dft321(slanted), WAVE, atol=1e-9)


@settings(deadline=None)
@given(recordings)
def test_every_reduction_gives_one_finite_value_for_each_sample(acceleration: np.ndarray) -> None:
    for reduced in REDUCTIONS.values():
        found = reduced(acceleration)
        assert found.shape == (len(acceleration),)
        assert np.isfinite(found).all()


# Sample by sample

RATE = 1000.0


def played(acceleration: FloatArray, reduced: PrincipalDirection) -> FloatArray:
    return np.array([reduced(vector(each)) for each in acceleration])


def texture(seconds: float, direction: list[float], seed: int = 1) -> FloatArray:
    noise = np.random.default_rng(seed).standard_normal(round(seconds * RATE))
    return np.outer(3.0 * noise, direction)


@pytest.mark.parametrize("name", ["axis", "sum"])
def test_live_and_whole_are_the_same(name: str) -> None:
    noise = np.random.default_rng(1).standard_normal((50, 3))
    live = live_reduction(name, RATE)
    np.testing.assert_allclose([live(vector(each)) for each in noise], REDUCTIONS[name](noise))


def test_every_live_reduction_has_its_name() -> None:
    assert [live_reduction(name, RATE)((0.0, 0.0, 2.0)) for name in LIVE_REDUCTIONS] == [2.0] * 3


@pytest.mark.parametrize(
    "direction", [[0.6, 0.0, 0.8], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [-0.48, -0.64, 0.6]], ids=str
)
def test_a_line_is_found_while_learning(direction: list[float]) -> None:
    reduced = PrincipalDirection(RATE)
    gravity = np.array([1.0, -2.0, 9.5])
    played(gravity + texture(LEARNING, direction), reduced)
    # The nearer of both opposite directions to the coil.
    assert abs(np.dot(reduced.direction, direction)) == pytest.approx(1.0, abs=1e-6)
    assert reduced.direction[2] >= -1e-9
    assert np.linalg.norm(reduced.direction) == pytest.approx(1.0)


def test_the_direction_never_jumps_and_follows_slowly_later() -> None:
    reduced = PrincipalDirection(RATE)
    directions = []
    changed = np.concatenate([texture(3.0, [0.8, 0, 0.6]), texture(3.0, [-0.6, 0, 0.8])])
    for each in changed:
        reduced(vector(each))
        directions.append(reduced.direction)
    cosines = np.sum(np.array(directions[1:]) * directions[:-1], axis=1)
    turned = np.arccos(np.clip(cosines, -1.0, 1.0)) * RATE
    assert turned.max() < np.radians(91.0)
    assert turned[round(LEARNING * RATE) + 1 :].max() < 1.01 * LATER_TURN
    back = np.degrees(np.arccos(np.dot(directions[3000], directions[-1])))
    assert 2.0 < back <= 15.1


def test_of_two_independent_axes_the_stronger_is_taken() -> None:
    reduced = PrincipalDirection(RATE)
    weak = texture(4.0, [0.0, 0.0, 0.3], seed=2)
    found = played(texture(4.0, [0.0, 1.0, 0.0]) + weak, reduced)
    assert abs(reduced.direction[1]) > 0.98
    assert found[2000:].std() == pytest.approx(3.0, rel=0.1)


def test_a_circle_has_no_direction_to_turn_to() -> None:
    reduced = PrincipalDirection(RATE)
    time = np.arange(4000) / RATE
    turning = np.column_stack(
        [0 * time, 3 * np.sin(2 * np.pi * 60 * time), 3 * np.cos(2 * np.pi * 60 * time)]
    )
    found = played(turning, reduced)
    assert reduced.direction[2] > 0.97
    assert found.std() == pytest.approx(3.0 / np.sqrt(2), rel=0.02)


def test_without_contact_the_direction_is_the_coil() -> None:
    reduced = PrincipalDirection(RATE)
    noise = 0.07 * np.random.default_rng(1).standard_normal((3000, 3))  # an ADXL320 at rest
    played(np.array([9.8, 0.0, 0.0]) + noise, reduced)
    assert reduced.direction == (0.0, 0.0, 1.0)


def test_a_missing_sample_leaves_the_direction_as_it_is() -> None:
    reduced = PrincipalDirection(RATE)
    played(texture(3.0, [0.6, 0.0, 0.8]), reduced)
    before = reduced.direction
    assert np.isnan(reduced((float("nan"), 0.0, 0.0)))
    played(texture(1.0, [0.6, 0.0, 0.8]), reduced)
    np.testing.assert_allclose(reduced.direction, before, atol=1e-6)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three axes to one, on signals whose reduction is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from haptic_accel.core import reduction
from haptic_accel.core.model import FloatArray, vector

TIME = np.arange(1000) / 1000.0
WAVE = np.sin(2 * np.pi * 50.0 * TIME)
recordings = arrays.arrays(
    np.float64, st.tuples(st.integers(1, 64), st.just(3)), elements=st.floats(-50.0, 50.0)
)


@pytest.mark.parametrize(
    "reduced",
    [reduction.dft321, reduction.principal, reduction.total],
    ids=lambda each: each.__name__,
)
def test_a_vibration_along_one_axis_stays_as_it_is(reduced: object) -> None:
    alone = np.column_stack([0 * TIME, WAVE, 0 * TIME])
    np.testing.assert_allclose(reduced(alone), WAVE, atol=1e-9)  # type: ignore[operator]


def test_dft321_has_the_power_of_all_axes_in_each_line_and_the_phase_of_the_sum() -> None:
    noise = np.random.default_rng(1).standard_normal((1000, 3))
    found, lines = np.fft.rfft(reduction.dft321(noise)), np.fft.rfft(noise, axis=0)
    np.testing.assert_allclose(np.abs(found) ** 2, np.sum(np.abs(lines) ** 2, axis=1))
    # The lines at zero and at half the rate are real.
    np.testing.assert_allclose(np.angle(found / lines.sum(axis=1))[1:-1], 0.0, atol=1e-9)


def test_the_axis_is_that_of_the_coil() -> None:
    np.testing.assert_array_equal(reduction.coil_component(np.array([[1.0, 2.0, 3.0]])), [3.0])


@settings(deadline=None)
@given(recordings)
def test_dft321_keeps_the_energy_of_all_axes(acceleration: np.ndarray) -> None:
    # Parseval's theorem, as each line of the spectrum has the power of the three.
    assert np.sum(reduction.dft321(acceleration) ** 2) == pytest.approx(
        np.sum(acceleration**2), abs=1e-6
    )


def test_the_sum_cancels_what_dft321_keeps() -> None:
    opposite = np.column_stack([WAVE, -WAVE, 0 * TIME])
    assert np.abs(reduction.total(opposite)).max() < 1e-12
    assert reduction.dft321(opposite).std() == pytest.approx(np.sqrt(2) * WAVE.std())


def test_a_circle_has_half_of_its_power_along_one_direction_and_a_constant_length() -> None:
    circle = np.column_stack([WAVE, np.cos(2 * np.pi * 50.0 * TIME), 0 * TIME])
    assert reduction.principal(circle).std() == pytest.approx(WAVE.std(), rel=1e-3)
    np.testing.assert_allclose(reduction.magnitude(circle), 1.0)
    assert reduction.dft321(circle).std() == pytest.approx(np.sqrt(2) * WAVE.std())


def test_an_oscillation_has_its_length_twice_a_period() -> None:
    slanted = np.outer(WAVE, [0.6, 0.0, 0.8])
    lines = np.abs(np.fft.rfft(reduction.magnitude(slanted) - reduction.magnitude(slanted).mean()))
    assert lines.argmax() == 100
    np.testing.assert_allclose(reduction.principal(slanted), WAVE, atol=1e-9)
    np.testing.assert_allclose(reduction.dft321(slanted), WAVE, atol=1e-9)


@settings(deadline=None)
@given(recordings)
def test_every_reduction_gives_one_finite_value_for_each_sample(acceleration: np.ndarray) -> None:
    for reduced in reduction.REDUCTIONS.values():
        found = reduced(acceleration)
        assert found.shape == (len(acceleration),)
        assert np.isfinite(found).all()


# Sample by sample

RATE = 1000.0


def played(acceleration: FloatArray, reduced: reduction.PrincipalDirection) -> FloatArray:
    return np.array([reduced(vector(each)) for each in acceleration])


def texture(seconds: float, direction: list[float], seed: int = 1) -> FloatArray:
    noise = np.random.default_rng(seed).standard_normal(round(seconds * RATE))
    return np.outer(3.0 * noise, direction)


@pytest.mark.parametrize("name", ["axis", "sum"])
def test_live_and_whole_are_the_same(name: str) -> None:
    noise = np.random.default_rng(1).standard_normal((50, 3))
    live = reduction.live_reduction(name, RATE)
    np.testing.assert_allclose(
        [live(vector(each)) for each in noise], reduction.REDUCTIONS[name](noise)
    )


def test_every_live_reduction_has_its_name() -> None:
    assert [
        reduction.live_reduction(name, RATE)((0.0, 0.0, 2.0)) for name in reduction.LIVE_REDUCTIONS
    ] == [2.0] * 3


@pytest.mark.parametrize(
    "direction", [[0.6, 0.0, 0.8], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [-0.48, -0.64, 0.6]], ids=str
)
def test_a_line_is_found_while_learning(direction: list[float]) -> None:
    reduced = reduction.PrincipalDirection(RATE)
    gravity = np.array([1.0, -2.0, 9.5])
    played(gravity + texture(reduction.LEARNING, direction), reduced)
    # The nearer of both opposite directions to the coil.
    assert abs(np.dot(reduced.direction, direction)) == pytest.approx(1.0, abs=1e-6)
    assert reduced.direction[2] >= -1e-9
    assert np.linalg.norm(reduced.direction) == pytest.approx(1.0)


def test_the_direction_never_jumps_and_follows_slowly_later() -> None:
    reduced = reduction.PrincipalDirection(RATE)
    directions = []
    changed = np.concatenate([texture(3.0, [0.8, 0, 0.6]), texture(3.0, [-0.6, 0, 0.8])])
    for each in changed:
        reduced(vector(each))
        directions.append(reduced.direction)
    cosines = np.sum(np.array(directions[1:]) * directions[:-1], axis=1)
    turned = np.arccos(np.clip(cosines, -1.0, 1.0)) * RATE
    assert turned.max() < np.radians(91.0)
    assert turned[round(reduction.LEARNING * RATE) + 1 :].max() < 1.01 * reduction.LATER_TURN
    back = np.degrees(np.arccos(np.dot(directions[3000], directions[-1])))
    assert 2.0 < back <= 15.1


def test_of_two_independent_axes_the_stronger_is_taken() -> None:
    reduced = reduction.PrincipalDirection(RATE)
    weak = texture(4.0, [0.0, 0.0, 0.3], seed=2)
    found = played(texture(4.0, [0.0, 1.0, 0.0]) + weak, reduced)
    assert abs(reduced.direction[1]) > 0.98
    assert found[2000:].std() == pytest.approx(3.0, rel=0.1)


def test_a_circle_has_no_direction_to_turn_to() -> None:
    reduced = reduction.PrincipalDirection(RATE)
    time = np.arange(4000) / RATE
    turning = np.column_stack(
        [0 * time, 3 * np.sin(2 * np.pi * 60 * time), 3 * np.cos(2 * np.pi * 60 * time)]
    )
    found = played(turning, reduced)
    assert reduced.direction[2] > 0.97
    assert found.std() == pytest.approx(3.0 / np.sqrt(2), rel=0.02)


def test_without_contact_the_direction_is_the_coil() -> None:
    reduced = reduction.PrincipalDirection(RATE)
    noise = 0.07 * np.random.default_rng(1).standard_normal((3000, 3))  # an ADXL320 at rest
    played(np.array([9.8, 0.0, 0.0]) + noise, reduced)
    assert reduced.direction == (0.0, 0.0, 1.0)


def test_a_missing_sample_leaves_the_direction_as_it_is() -> None:
    reduced = reduction.PrincipalDirection(RATE)
    played(texture(3.0, [0.6, 0.0, 0.8]), reduced)
    before = reduced.direction
    assert np.isnan(reduced((float("nan"), 0.0, 0.0)))
    played(texture(1.0, [0.6, 0.0, 0.8]), reduced)
    np.testing.assert_allclose(reduced.direction, before, atol=1e-6)

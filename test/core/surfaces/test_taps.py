# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Taps: their first sample, their peak, what two of them do, and modes found again."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces import taps
from tap_modes import fitted_modes

RATE = 1000.0
WOOD = taps.Mode(frequency=230.0, decay=90.0, amplitude=60.0)
METAL = taps.Mode(frequency=410.0, decay=25.0, amplitude=30.0, phase=0.7)


def theory(modes: tuple[taps.Mode, ...], rate: float, count: int) -> FloatArray:
    """Return A exp(-B t) sin(2 pi f t + phase), from one period after contact onwards."""
    time = np.arange(1, count + 1) / rate
    return sum(
        mode.amplitude
        * np.exp(-mode.decay * time)
        * np.sin(2 * np.pi * mode.frequency * time + mode.phase)
        for mode in modes
    ) + np.zeros(count)


def played(tap: taps.Tap, count: int) -> FloatArray:
    return np.array([tap.synthesize() for _ in range(count)])


@pytest.mark.parametrize("rate", [1000.0, 4000.0, 10000.0])
def test_a_tap_is_there_with_the_next_sample_and_rings_down_to_nothing(rate: float) -> None:
    tap = taps.Tap(taps.TapModel(modes=(WOOD, METAL)), rate)
    assert tap.synthesize() == 0.0
    tap.strike(0.2)
    expected = 0.2 * theory((WOOD, METAL), rate, round(0.2 * rate))
    assert played(tap, len(expected)) == pytest.approx(expected)
    assert expected[0] > 1.0
    assert not np.any(played(tap, round(rate))[round(0.4 * rate) :])


def test_a_mode_beyond_half_the_rate_is_left_out() -> None:
    high = taps.Mode(frequency=700.0)
    tap = taps.Tap(taps.TapModel(modes=(WOOD, high)), RATE)
    tap.strike(1.0)
    assert played(tap, 20) == pytest.approx(theory((WOOD,), RATE, 20))


def test_slow_contact_and_bouncing_begin_no_tap() -> None:
    tap = taps.Tap(taps.TapModel(modes=(WOOD,)), RATE)
    tap.strike(0.9 * taps.THRESHOLD_SPEED)
    assert not played(tap, 10).any()
    tap.strike(0.1)
    first = played(tap, round(taps.REFRACTORY_TIME * RATE) - 1)
    tap.strike(0.5)
    rest = played(tap, 1)
    assert np.append(first, rest) == pytest.approx(0.1 * theory((WOOD,), RATE, len(first) + 1))


def test_a_second_tap_adds_to_the_ringing_of_the_first() -> None:
    tap = taps.Tap(taps.TapModel(modes=(METAL,)), RATE)
    tap.strike(0.1)
    first = 0.1 * theory((METAL,), RATE, 140)
    assert played(tap, 40) == pytest.approx(first[:40])
    tap.strike(0.3)
    assert played(tap, 100) == pytest.approx(first[40:] + 0.3 * theory((METAL,), RATE, 100))


def test_the_texture_comes_in_while_the_tap_fades() -> None:
    tap = taps.Tap(taps.TapModel(modes=(WOOD,)), RATE)
    assert tap.texture_share == 1.0
    tap.strike(0.1)
    shares = []
    for _ in range(round(taps.CROSS_FADE * RATE) + 1):
        shares.append(tap.texture_share)
        tap.synthesize()
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert np.all(np.diff(shares) > 0)


@pytest.mark.parametrize(
    ("speed", "row"),
    [
        (0.1, [1.0, -2.0]),
        (0.3, [9.0, -4.0]),
        (0.05, [0.5, -1.0]),  # slower than all: a part of the slowest
        (0.2, [5.0, -3.0]),  # between: mixed
        (0.6, [18.0, -8.0]),  # faster than all: more of the fastest
    ],
)
def test_recorded_taps_follow_the_impact_speed(speed: float, row: list[float]) -> None:
    model = taps.TapModel(
        speeds=np.array([0.1, 0.3]), samples=np.array([[1.0, -2.0], [9.0, -4.0]]), rate=RATE
    )
    tap = taps.Tap(model, RATE)
    tap.strike(speed)
    assert played(tap, 3) == pytest.approx([*row, 0.0])


def test_a_recorded_tap_keeps_its_peak_at_another_rate() -> None:
    fast = theory((WOOD,), 10e3, 1000)
    tap = taps.Tap(taps.TapModel(speeds=np.ones(1), samples=fast[np.newaxis], rate=10e3), 4000.0)
    tap.strike(1.0)
    assert np.abs(played(tap, 400)).max() == pytest.approx(np.abs(fast).max(), rel=0.1)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(
        st.builds(
            taps.Mode,
            frequency=st.sampled_from([40.0, 90.0, 160.0, 230.0, 310.0, 440.0]),
            decay=st.floats(10.0, 120.0),
            amplitude=st.floats(5.0, 100.0),
            phase=st.floats(-3.0, 3.0),
        ),
        min_size=1,
        max_size=3,
        unique_by=lambda mode: mode.frequency,
    )
)
def test_modes_are_found_again(modes: list[taps.Mode]) -> None:
    found = sorted(map(astuple, fitted_modes(theory(tuple(modes), RATE, 200), RATE, len(modes))))
    for mode, expected in zip(found, sorted(map(astuple, modes)), strict=True):
        assert mode == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_modes_are_found_in_noise_with_their_peak() -> None:
    clean = theory((WOOD, METAL), RATE, 150)
    noise = np.random.default_rng(4).normal(0.0, 0.5, len(clean))
    found = fitted_modes(clean + noise, RATE, 2)
    assert sorted(mode.frequency for mode in found) == pytest.approx([230.0, 410.0], rel=0.02)
    again = theory(found, RATE, len(clean))
    assert np.abs(again).max() == pytest.approx(np.abs(clean).max(), rel=0.1)


def test_a_signal_without_ringing_has_no_modes() -> None:
    assert fitted_modes(np.zeros(100), RATE, 2) == ()
    assert fitted_modes(np.exp(-np.arange(100) / 20), RATE, 1) == ()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "either modes or a recorded set"),
        ({"modes": (WOOD,) * 4}, "4 modes: must be at most 3"),
        ({"modes": (WOOD,), "speeds": np.ones(1)}, "either"),
        ({"speeds": np.array([0.2, 0.1]), "samples": np.ones((2, 4))}, "must increase"),
        ({"speeds": np.ones(1), "samples": np.ones((2, 4))}, r"\(2, 4\).*one row"),
        ({"speeds": np.ones(1), "samples": np.full((1, 4), math.nan)}, "finite"),
        ({"modes": (WOOD,), "rate": 0.0}, "rate = 0"),
    ],
)
def test_a_wrong_model_is_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        taps.TapModel(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(("length", "count", "words"), [(100, 4, "count = 4"), (10, 2, "10 samp")])
def test_a_fit_that_cannot_be_is_refused(length: int, count: int, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        fitted_modes(np.ones(length), RATE, count)

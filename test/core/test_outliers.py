# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Outliers of sensors, against everything that a tool can do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from input_family import MEMBERS, member

from haptic_accel.core.model import FloatArray
from haptic_accel.core.outliers import LONGEST_OUTLIER, outliers, without_outliers
from haptic_accel.core.parameters import ParameterError, from_flat
from haptic_accel.core.rig.slave_rig import SlaveRigParameters, SurfaceParameters
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import run_trial
from haptic_accel.setup.files import surface_parameters

REAL = Path(__file__).resolve().parents[3] / "shared/data"
FULL_SCALE = 49.0
"""Full scale of a +-5 g sensor, m/s^2."""


def family(number: int, rate: float = 1000.0) -> FloatArray:
    return member(number, 2.0, rate, seed=7).acceleration


def quiet(number: int) -> FloatArray:
    """Return a tool acceleration of 1 m/s^2 RMS."""
    found = family(number)
    return np.asarray(found / found.std())


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_taps_scratches_strokes_and_steps_of_level_are_no_outliers(rate: float) -> None:
    marked = {number: int(outliers(family(number, rate)).sum()) for number in range(MEMBERS)}
    assert not {number: count for number, count in marked.items() if count}


@pytest.mark.parametrize("name", ["plywood", "text", "vinyl"])
def test_contact_with_simulated_surfaces_has_no_outliers(name: str) -> None:
    surface = from_flat(SurfaceParameters, surface_parameters(name), "simulated.surface.")
    trial = run_trial("none", RigParameters(slave=SlaveRigParameters(surface=surface)), duration=3)
    assert trial.tool_acceleration.std() > 0.1
    assert not outliers(trial.tool_acceleration).any()
    assert not outliers(trial.handle_acceleration).any()


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real surfaces are not here")
@pytest.mark.parametrize("surface", ["wood", "leather"])
def test_real_recordings_of_speed_force_and_acceleration_have_no_outliers(surface: str) -> None:
    columns = np.loadtxt(REAL / f"{surface}.csv", delimiter=",", skiprows=1, usecols=(0, 1, 2))
    assert not any(outliers(column).any() for column in columns.T)


@given(
    number=st.integers(0, MEMBERS - 1),
    place=st.integers(3, 1996),
    size=st.floats(100.0, 1e9),
    sign=st.sampled_from([-1, 1]),
)
@settings(deadline=None, max_examples=60)
def test_a_single_glitch_is_found_and_nothing_else(
    number: int, place: int, size: float, sign: int
) -> None:
    samples = quiet(number)
    samples[place] = sign * size
    assert np.flatnonzero(outliers(samples)).tolist() == [place]


@given(
    number=st.integers(0, MEMBERS - 1),
    place=st.integers(3, 1980),
    length=st.integers(1, LONGEST_OUTLIER),
    sign=st.sampled_from([-1, 1]),
)
@settings(deadline=None, max_examples=60)
def test_a_code_stuck_at_full_scale_is_found_and_nothing_else(
    number: int, place: int, length: int, sign: int
) -> None:
    samples = quiet(number)
    samples[place : place + length] = sign * FULL_SCALE * max(1.0, np.abs(samples).max() / 8)
    assert np.flatnonzero(outliers(samples)).tolist() == list(range(place, place + length))


@pytest.mark.parametrize("places", [[0], [1], [1999], [1998], [0, 1999], [700, 706, 713]])
def test_glitches_at_the_ends_and_close_to_each_other_are_found(places: list[int]) -> None:
    samples = quiet(1)
    samples[places] = 1000.0
    assert np.flatnonzero(outliers(samples)).tolist() == places


@given(width=st.floats(3.0, 20.0), onset=st.floats(100.0, 101.0), noise=st.floats(1e-4, 0.1))
@settings(deadline=None)
def test_a_half_sine_impact_of_three_samples_or_more_in_silence_is_no_outlier(
    width: float, onset: float, noise: float
) -> None:
    since = np.arange(300) - onset
    pulse = np.where((since > 0) & (since < width), np.sin(np.pi * since / width), 0.0)
    samples = 30.0 * pulse + np.random.default_rng(1).normal(0.0, noise, 300)
    assert not outliers(samples).any()


@given(decay=st.floats(3.0, 30.0), angle=st.floats(0.06, 0.45), onset=st.floats(0.0, 1.0))
@settings(deadline=None)
def test_the_ringing_of_a_tap_in_silence_is_no_outlier(
    decay: float, angle: float, onset: float
) -> None:
    since = np.maximum(np.arange(300) - 100 - onset, 0.0)
    tap = 20.0 * np.exp(-since / decay) * np.sin(2 * np.pi * angle * since)
    assert not outliers(tap + np.random.default_rng(1).normal(0.0, 0.01, 300)).any()


@pytest.mark.parametrize(
    "samples",
    [
        np.zeros(500),
        np.repeat([0.0, 1.0], 250),
        np.linspace(0.0, 1.0, 500) ** 2,
        np.random.default_rng(0).normal(size=100_000),
        # A quiet sensor that toggles between two codes, beside contact.
        np.round(np.random.default_rng(0).normal(size=9000) * np.repeat([0.18, 5.0], 4500)),
        np.full(3, 5.0),
        np.empty(0),
    ],
    ids=["silence", "step", "ramp", "normal", "codes", "three", "none"],
)
@pytest.mark.filterwarnings("error")
def test_ordinary_signals_have_no_outliers(samples: FloatArray) -> None:
    assert not outliers(samples).any()


@given(scale=st.integers(-20, 20), offset=st.integers(-1000, 1000))
@settings(deadline=None, max_examples=20)
def test_the_unit_and_the_offset_of_a_signal_do_not_matter(scale: int, offset: int) -> None:
    samples = np.round(quiet(2) * 4096)  # whole numbers, so that an offset rounds nothing
    samples[[400, 1200]] = 4e6
    found = outliers(samples)
    assert np.flatnonzero(found).tolist() == [400, 1200]
    np.testing.assert_array_equal(outliers(2.0**scale * (samples + offset)), found)


def test_outliers_are_replaced_by_a_line_between_their_neighbours() -> None:
    samples = np.linspace(0.0, 99.9, 1000)
    damaged = samples.copy()
    damaged[[0, 300, 301, 302, 700]] = [9e3, 5e4, 5e4, 5e4, -1e9]
    cleaned, rejected = without_outliers("speed", damaged)
    assert rejected == 5
    np.testing.assert_allclose(cleaned[1:], samples[1:])
    assert cleaned[0] == samples[1]
    assert damaged[0] == 9e3  # the argument is left alone


def test_a_recording_of_many_outliers_is_refused_in_one_line() -> None:
    samples = quiet(3)
    samples[40:1900:80] = 1e4
    with pytest.raises(
        ParameterError,
        match=r"^drag\.csv: force: 24 of 2000 samples are outliers: must be at most 1 %$",
    ):
        without_outliers("drag.csv: force", samples)

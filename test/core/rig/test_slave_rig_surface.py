# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Height profiles: their size, their wavelengths, their bumps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import FloatArray
from haptic_accel.core.rig.slave_rig import (
    PROFILE_POINTS,
    PROFILE_STEP,
    SurfaceParameters,
    height_profile,
)

LENGTH = PROFILE_POINTS * PROFILE_STEP

few = settings(deadline=None, max_examples=10)

rough = SurfaceParameters(
    roughness=5e-6, shortest_wavelength=0.5e-3, longest_wavelength=5e-3, roughness_exponent=2.0
)
embossed = SurfaceParameters(bump_height=30e-6, bump_width=0.6e-3, bump_pitch=2e-3)


def power(heights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Spatial frequency in 1/m, without zero, and the power there."""
    spectrum: FloatArray = np.abs(np.fft.rfft(heights)) ** 2
    frequency = np.asarray(np.fft.rfftfreq(PROFILE_POINTS, PROFILE_STEP), dtype=float)
    return frequency[1:], spectrum[1:]


def band(heights: FloatArray, low: float, high: float) -> float:
    frequency, spectrum = power(heights)
    return float(spectrum[(frequency >= low) & (frequency < high)].sum())


# Roughness


@few
@given(st.floats(1e-7, 1e-4), st.floats(0.0, 4.0), st.integers(0, 2**31 - 1))
def test_rms_height_is_as_asked(roughness: float, exponent: float, seed: int) -> None:
    surface = SurfaceParameters(roughness=roughness, roughness_exponent=exponent)
    heights = height_profile(surface, seed)
    assert heights.shape == (PROFILE_POINTS,)
    assert np.sqrt(np.mean(heights**2)) == pytest.approx(roughness)
    assert abs(heights.mean()) < 1e-6 * roughness


def test_wavelengths_are_within_their_limits_and_the_profile_is_periodic() -> None:
    # Whatever does not fit its period a whole number of times would leak over the spectrum.
    heights = height_profile(rough, 1)
    inside = band(heights, 1 / 5.001e-3, 1 / 0.499e-3)
    frequency, spectrum = power(heights)
    assert inside == pytest.approx(spectrum.sum(), rel=1e-12)
    within = (frequency >= 1 / 5e-3) & (frequency <= 1 / 0.5e-3)
    assert (spectrum[within] > 0).all()


def test_power_falls_with_the_exponent_asked_for() -> None:
    frequency, spectrum = power(height_profile(rough, 1))
    low, high = np.searchsorted(frequency, [300.0, 1500.0])
    slope = np.log(spectrum[high] / spectrum[low]) / np.log(frequency[high] / frequency[low])
    assert slope == pytest.approx(-2.0, abs=0.01)


def test_heights_are_normally_distributed() -> None:
    heights = height_profile(rough, 1) / 5e-6
    # 650 wavelengths of the shortest kind: kurtosis 3 to some tenths.
    assert np.mean(heights**4) == pytest.approx(3.0, abs=0.5)
    assert np.abs(heights).max() < 5.0


def test_a_band_without_a_wavelength_is_smooth() -> None:
    surface = SurfaceParameters(roughness=1e-6, shortest_wavelength=5e-3, longest_wavelength=1e-3)
    assert not height_profile(surface, 0).any()


# Bumps


def ridges(heights: FloatArray) -> FloatArray:
    """Widths in m of what is higher than half the bumps' height, around the period's end."""
    above = heights > 15e-6
    valley = np.roll(above, -int(np.flatnonzero(~above)[0]))
    edges = np.diff(np.append(valley, False).astype(int))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return np.asarray((ends - starts) * PROFILE_STEP, dtype=float)


def test_regular_bumps_have_number_height_and_width_as_asked() -> None:
    heights = height_profile(embossed, 0)
    widths = ridges(heights)
    assert len(widths) == round(LENGTH / 2e-3)
    assert widths == pytest.approx(0.6e-3, abs=3 * PROFILE_STEP)
    # Each is a little higher by the tail of its neighbours.
    assert heights.max() == pytest.approx(30e-6, rel=1e-3)
    assert heights.min() > -1e-12


def test_regular_bumps_have_a_line_at_their_pitch() -> None:
    frequency, spectrum = power(height_profile(embossed, 0))
    assert 1 / frequency[spectrum.argmax()] == pytest.approx(2e-3, rel=2e-3)


def test_irregular_bumps_differ_in_distance() -> None:
    surface = SurfaceParameters(
        bump_height=30e-6, bump_width=0.2e-3, bump_pitch=2e-3, bump_irregularity=0.1
    )
    heights = height_profile(surface, 5)
    peaks = np.flatnonzero(
        (heights > 15e-6) & (heights >= np.roll(heights, 1)) & (heights > np.roll(heights, -1))
    )
    distances = np.diff(peaks) * PROFILE_STEP
    assert len(peaks) == round(LENGTH / 2e-3)
    assert distances.mean() == pytest.approx(2e-3, rel=0.01)
    # Each of two neighbours strays by a tenth of the pitch.
    assert distances.std() == pytest.approx(math.sqrt(2) * 0.2e-3, rel=0.25)


def test_texture_and_bumps_add_up() -> None:
    both = SurfaceParameters(roughness=1e-6, bump_height=30e-6)
    texture = height_profile(SurfaceParameters(roughness=1e-6), 7)
    bumps = height_profile(SurfaceParameters(bump_height=30e-6), 7)
    assert height_profile(both, 7) == pytest.approx(texture + bumps, abs=1e-15)


# Seeds


def test_without_texture_it_is_flat() -> None:
    assert not height_profile(SurfaceParameters(), 0).any()


@few
@given(st.integers(0, 2**31 - 2))
def test_the_seed_decides_about_the_piece(seed: int) -> None:
    surface = SurfaceParameters(roughness=1e-6, bump_height=30e-6, bump_irregularity=0.2)
    assert np.array_equal(height_profile(surface, seed), height_profile(surface, seed))
    assert not np.array_equal(height_profile(surface, seed), height_profile(surface, seed + 1))

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The error within bands, of signals whose error at each frequency is known."""

from __future__ import annotations

import cmath
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.evaluation.metrics import BAND_EDGES, band_nrmse, bands, nrmse
from haptic_accel.core.model import FloatArray

RATE = 1000.0


def sine(frequency: float, gain: float = 1.0, phase: float = 0.0, seconds: int = 2) -> FloatArray:
    time = np.arange(round(seconds * RATE)) / RATE
    return np.asarray(gain * np.sin(2 * np.pi * frequency * time + phase))


@settings(max_examples=30)
@given(st.floats(0.0, 3.0), st.floats(-math.pi, math.pi))
def test_a_sine_has_the_distance_of_its_phasors_in_its_band(gain: float, phase: float) -> None:
    actual = sine(90.0, gain, phase)
    found = band_nrmse(sine(90.0), actual, RATE, bands(RATE))
    assert found["60-125 Hz"] == pytest.approx(abs(gain * cmath.exp(1j * phase) - 1), abs=1e-3)
    assert math.isnan(found["250-500 Hz"])


def test_bands_do_not_hear_each_other() -> None:
    desired = sine(40.0) + sine(90.0) + sine(180.0)
    actual = sine(40.0, 0.5) + sine(90.0) + sine(180.0, -1.0)
    found = band_nrmse(desired, actual, RATE, bands(RATE))
    assert found["30-60 Hz"] == pytest.approx(0.5, abs=1e-3)
    assert found["60-125 Hz"] == pytest.approx(0.0, abs=1e-3)
    assert found["125-250 Hz"] == pytest.approx(2.0, abs=1e-3)


def test_of_white_noise_every_band_has_the_error_of_the_whole() -> None:
    generator = np.random.default_rng(1)
    desired = generator.normal(size=60_000)
    actual = desired + 0.4 * generator.normal(size=60_000)
    found = band_nrmse(desired, actual, RATE, bands(RATE))
    whole = nrmse(desired, actual)
    assert whole == pytest.approx(0.4, rel=0.02)
    assert list(found.values()) == pytest.approx([whole] * len(found), rel=0.08)


@given(st.floats(31.0, 20_000.0))
def test_bands_lie_side_by_side_up_to_half_the_rate(rate: float) -> None:
    found = bands(rate)
    assert found[0].low == BAND_EDGES[0]
    assert found[-1].high == min(rate / 2, BAND_EDGES[-1])
    assert all(one.high == other.low for one, other in itertools.pairwise(found))
    assert all(band.low < band.high for band in found)


def test_the_bands_of_the_papers_rate_have_names() -> None:
    named = ", ".join(band.name for band in bands(1000.0))
    assert named == "15-30 Hz, 30-60 Hz, 60-125 Hz, 125-250 Hz, 250-500 Hz"

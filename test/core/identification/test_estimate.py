# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Estimates of a frequency response against filters that are known, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.identification.estimate import (
    RecordingError,
    check_recording,
    dft_ratio,
    h1,
    h2,
)
from haptic_accel.core.identification.sweep import SweepParameters, excitation, kept_repeats
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError

RATE = 1000.0
BAND = (10.0, 200.0)
RANGE = 49.0
SWEEP = SweepParameters()
NUMERATOR, DENOMINATOR = signal.butter(2, [20.0, 150.0], "bandpass", fs=RATE)


def filtered(force: FloatArray, noise: float = 0.0, seed: int = 0) -> FloatArray:
    """Return eight times a known filter's output, m/s^2, and noise."""
    clean = np.asarray(signal.lfilter(8 * NUMERATOR, DENOMINATOR, force))
    return clean + np.random.default_rng(seed).normal(0.0, noise, len(force))


def recording(noise: float = 0.07, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Return force and acceleration of the repeats that are kept."""
    force = excitation(SWEEP, RATE)
    acceleration = filtered(force, noise, seed)
    return kept_repeats(force, SWEEP, RATE), kept_repeats(acceleration, SWEEP, RATE)


def known(frequency: FloatArray) -> FloatArray:
    return np.asarray(signal.freqz(8 * NUMERATOR, DENOMINATOR, frequency, fs=RATE)[1])


def test_the_ratio_of_settled_repeats_has_no_error_of_its_own() -> None:
    estimate = dft_ratio(*recording(noise=0.0), RATE, BAND)
    assert estimate.frequency[[0, -1]] == pytest.approx(BAND)
    assert estimate.response == pytest.approx(known(estimate.frequency), rel=1e-6)
    assert estimate.coherence == pytest.approx(1.0)


def test_its_standard_deviation_is_that_of_the_noise() -> None:
    scaled = []
    for seed in range(20):
        estimate = dft_ratio(*recording(seed=seed), RATE, BAND)
        error = (estimate.response - known(estimate.frequency)) / estimate.standard_deviation
        scaled += [error.real, error.imag]
    assert np.std(scaled) == pytest.approx(1.0, abs=0.05)
    assert abs(np.mean(scaled)) < 0.05


def test_averaged_estimates_recover_a_filter_from_white_force() -> None:
    force = np.random.default_rng(1).normal(0.0, 1.0, 60_000)
    first = h1(force, filtered(force, 0.05), RATE, (30.0, 140.0))
    for found in (first, h2(first)):
        assert found.response == pytest.approx(known(found.frequency), rel=0.03)
        assert found.coherence.min() > 0.99


def test_h1_allows_noise_in_the_acceleration_and_h2_errs_upwards_by_the_coherence() -> None:
    force = np.random.default_rng(1).normal(0.0, 1.0, 60_000)
    acceleration = filtered(force, 4.0)
    first = h1(force, acceleration, RATE, (30.0, 140.0))
    error = (first.response - known(first.frequency)) / first.standard_deviation
    assert np.std([error.real, error.imag]) == pytest.approx(1.0, abs=0.25)
    _, power = signal.welch(acceleration, RATE, nperseg=500)
    frequency, cross = signal.csd(force, acceleration, RATE, nperseg=500)
    inside = (frequency >= 30.0) & (frequency <= 140.0)
    assert h2(first).response == pytest.approx((power / np.conj(cross))[inside])


# What is refused


def bad(values: FloatArray, value: float) -> FloatArray:
    """Return values of which one is another."""
    return np.where(np.arange(len(values)) == 7, value, values)


NOISE = np.random.default_rng(0).normal(0.0, 5.0, 4000)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda f, a: (0.001 * f, a),
            r"actuator_force: 0.000\d+ N root mean square excites nothing, must be at least",
        ),
        (
            lambda f, a: (f, np.clip(10 * a, -RANGE, RANGE)),
            r"handle_acceleration: [\d.]+ % of its samples are at the sensor's range of 49",
        ),
        (
            lambda f, a: (f, NOISE),
            r"coherence = 0\.[01]\d on average from 10 to 200 Hz: must be at least 0.7",
        ),
        (
            lambda f, a: (f, 0 * a),
            r"coherence = 0.00 on average from 10 to 200 Hz: must be at least 0.7",
        ),
        (
            lambda f, a: (f, a[:-1]),
            "actuator_force and handle_acceleration: have 4000 and 3999 samples",
        ),
        (
            lambda f, a: (f, bad(a, math.nan)),
            "handle_acceleration: holds NaN or infinity, must be finite",
        ),
        (
            lambda f, a: (bad(f, math.inf), a),
            "actuator_force: holds NaN or infinity, must be finite",
        ),
        (
            lambda f, a: (f[:1999], a[:1999]),
            "recording: 1999 samples at 1000 Hz, must be at least 2000",
        ),
        (lambda f, a: (f[:, None], a), "actuator_force: has 2 dimensions, must have one"),
        (lambda f, a: (f[:0], a[:0]), "recording: holds no samples"),
    ],
)
def test_a_bad_recording_is_refused(
    spoil: Callable[..., tuple[FloatArray, FloatArray]], message: str
) -> None:
    with pytest.raises(RecordingError, match="^" + message):
        check_recording(*spoil(*recording()), RATE, BAND, RANGE)


def test_force_outside_the_band_is_no_force() -> None:
    with pytest.raises(RecordingError, match="^actuator_force: zero from 10 to 200 Hz$"):
        dft_ratio(np.zeros(400), np.zeros(400), RATE, BAND)


@pytest.mark.parametrize("band", [(0.0, 100.0), (100.0, 10.0), (10.0, 500.0), (math.nan, 1.0)])
def test_an_impossible_band_is_refused(band: tuple[float, float]) -> None:
    message = "must satisfy 0 < low < high < half the rate, 500 Hz$"
    for estimate in (dft_ratio, h1):
        with pytest.raises(ParameterError, match=message):
            estimate(*recording(), RATE, band)


def test_other_impossible_arguments_are_refused() -> None:
    pair = recording()
    with pytest.raises(ParameterError, match="^repeats = 3: must be at least 2 and divide the 40"):
        dft_ratio(*pair, RATE, BAND, repeats=3)
    with pytest.raises(ParameterError, match="^repeats = 1: must be at least 2"):
        dft_ratio(*pair, RATE, BAND, repeats=1)
    with pytest.raises(ParameterError, match="^band = 10.1 to 10.2 Hz: holds no line"):
        dft_ratio(*pair, RATE, (10.1, 10.2))
    with pytest.raises(ParameterError, match="^rate = 0: must be above 0 Hz$"):
        h1(*pair, 0, BAND)

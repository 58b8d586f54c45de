# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics against signals whose answer is known by hand."""

from __future__ import annotations

import cmath
import dataclasses
import itertools
import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from haptic_accel.core.evaluation import metrics
from haptic_accel.core.evaluation.metrics import LONGEST_DELAY, estimate_delay, shift_back
from haptic_accel.core.model import FloatArray

RATE = 1000.0

untimed = settings(deadline=None)


def sine(gain: float = 1.0, phase: float = 0.0, frequency: float = 50.0) -> metrics.FloatArray:
    """Two seconds of a sine: a whole number of periods."""
    time = np.arange(int(2 * RATE)) / RATE
    return gain * np.sin(2 * np.pi * frequency * time + phase)


def white_noise(sigma: float, seconds: float = 60.0, seed: int = 0) -> metrics.FloatArray:
    return np.random.default_rng(seed).normal(0.0, sigma, int(seconds * RATE))


gains = st.floats(0.05, 20.0)
phases = st.floats(-math.pi, math.pi)
signals = arrays.arrays(np.float64, st.integers(3, 60), elements=st.floats(-1e3, 1e3))


@st.composite
def pairs(draw: st.DrawFn) -> tuple[metrics.FloatArray, metrics.FloatArray]:
    """Two signals of equal length, both clearly varying."""
    desired = draw(signals)
    actual = draw(arrays.arrays(np.float64, len(desired), elements=st.floats(-1e3, 1e3)))
    assume(np.ptp(desired) > 1e-3)
    assume(np.ptp(actual) > 1e-3)
    return desired, actual


# Alignment


def test_align_pairs_each_cause_with_its_delayed_effect() -> None:
    desired = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    actual = np.array([0.0, 0.0, 1.0, 2.0, 3.0])
    for first, second in zip(*metrics.align(desired, actual, 2), strict=True):
        assert first == second
    assert len(metrics.align(desired, actual, 2)[0]) == 3
    assert np.array_equal(metrics.align(desired, actual, 0), (desired, actual))


# Error


@untimed
@given(gains | st.just(0.0), phases)
def test_nrmse_of_a_sine(gain: float, phase: float) -> None:
    expected = math.sqrt(max(1.0 - 2.0 * gain * math.cos(phase) + gain**2, 0.0))
    assert metrics.nrmse(sine(), sine(gain, phase)) == pytest.approx(expected, abs=1e-6)


def test_nrmse_keeps_offsets() -> None:
    assert metrics.nrmse(np.full(10, 2.0), np.full(10, 3.0)) == pytest.approx(0.5)


@untimed
@given(pairs(), st.floats(1e-3, 1e3))
def test_nrmse_does_not_depend_on_the_unit(
    pair: tuple[metrics.FloatArray, metrics.FloatArray], scale: float
) -> None:
    desired, actual = pair
    assert metrics.nrmse(scale * desired, scale * actual) == pytest.approx(
        metrics.nrmse(desired, actual)
    )


# Regression


@untimed
@given(gains, phases)
def test_regression_of_a_sine(gain: float, phase: float) -> None:
    found = metrics.regress(sine(), sine(gain, phase) + 3.0)
    assert found.r2 == pytest.approx(math.cos(phase) ** 2, abs=1e-9)
    assert found.slope_actual_on_desired == pytest.approx(gain * math.cos(phase), abs=1e-8)
    assert found.slope_desired_on_actual == pytest.approx(math.cos(phase) / gain, abs=1e-7)


def test_regression_of_four_points_by_hand() -> None:
    # Sums of squares about the means 1.5 and 2: 5 and 10; of products: 5.
    found = metrics.regress(np.array([0.0, 1.0, 2.0, 3.0]), np.array([1.0, 0.0, 4.0, 3.0]))
    assert found.slope_actual_on_desired == pytest.approx(1.0)
    assert found.slope_desired_on_actual == pytest.approx(0.5)
    assert found.r2 == pytest.approx(0.5)


@pytest.mark.parametrize("constant", [0.0, 0.1, -9.80665])
def test_a_constant_signal_explains_nothing(constant: float) -> None:
    still = np.full_like(sine(), constant)
    for found in (metrics.regress(sine(), still), metrics.regress(still, sine())):
        assert found.r2 == 0.0
        assert found.slope_actual_on_desired == 0.0
        assert found.slope_desired_on_actual == 0.0


@untimed
@given(pairs())
def test_product_of_the_slopes_is_r2_and_directions_mirror_each_other(
    pair: tuple[metrics.FloatArray, metrics.FloatArray],
) -> None:
    found, mirrored = metrics.regress(*pair), metrics.regress(*reversed(pair))
    assert 0.0 <= found.r2 <= 1.0
    product = found.slope_actual_on_desired * found.slope_desired_on_actual
    assert product == pytest.approx(found.r2, abs=1e-12)
    assert found.slope_actual_on_desired == pytest.approx(mirrored.slope_desired_on_actual)
    assert found.r2 == pytest.approx(mirrored.r2)


@untimed
@given(pairs())
def test_error_of_zero_mean_signals_follows_from_slope_and_r2(
    pair: tuple[metrics.FloatArray, metrics.FloatArray],
) -> None:
    desired, actual = (values - values.mean() for values in pair)
    found = metrics.regress(desired, actual)
    assume(found.r2 > 1e-6)
    slope = found.slope_actual_on_desired
    expected = 1.0 - 2.0 * slope + slope**2 / found.r2
    assert metrics.nrmse(desired, actual) ** 2 == pytest.approx(expected, rel=1e-5, abs=1e-7)


# Spectra


def test_density_of_white_noise() -> None:
    found = metrics.spectra(white_noise(2.0), white_noise(0.5, seed=1), RATE)
    inside = (found.frequency > 10.0) & (found.frequency < 490.0)
    for density, sigma in ((found.desired, 2.0), (found.actual, 0.5)):
        expected = sigma / math.sqrt(RATE / 2.0)
        assert np.sqrt(np.mean(density[inside] ** 2)) == pytest.approx(expected, rel=0.02)
        assert density[inside] == pytest.approx(expected, rel=0.35)


def test_density_of_a_sine_holds_its_power_at_its_frequency() -> None:
    found = metrics.spectra(sine(3.0, frequency=80.0), sine(frequency=120.0), RATE)
    assert found.frequency[np.argmax(found.desired)] == pytest.approx(80.0)
    assert found.frequency[np.argmax(found.actual)] == pytest.approx(120.0)
    step = found.frequency[1]
    assert np.sum(found.desired**2) * step == pytest.approx(3.0**2 / 2, rel=1e-3)


def test_frequencies_go_to_half_the_rate_in_steps_of_four_hertz() -> None:
    found = metrics.spectra(white_noise(1.0), white_noise(1.0), 4 * RATE)
    assert found.frequency[0] == 0.0
    assert found.frequency[-1] == pytest.approx(2 * RATE)
    assert np.diff(found.frequency) == pytest.approx(4.0)
    assert found.frequency.shape == found.desired.shape == found.actual.shape
    assert found.frequency.shape == found.coherence.shape


def test_coherence_of_a_copy_and_with_added_noise() -> None:
    noise = white_noise(1.0)
    assert metrics.spectra(noise, -0.3 * noise, RATE).coherence == pytest.approx(1.0)
    # gamma^2 = S / (S + N) for noise N on one side only; here S = N.
    found = metrics.spectra(noise, noise + white_noise(1.0, seed=1), RATE)
    assert np.mean(found.coherence[3:-3]) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(("seconds", "most"), [(60.0, 0.01), (0.2, 0.5)])
def test_coherence_of_unrelated_signals_is_small(seconds: float, most: float) -> None:
    found = metrics.spectra(white_noise(1.0, seconds), white_noise(1.0, seconds, seed=1), RATE)
    assert np.mean(found.coherence) < most


@pytest.mark.parametrize("constant", [0.0, 0.1])
def test_coherence_with_a_constant_is_zero(constant: float) -> None:
    found = metrics.spectra(sine(), np.full_like(sine(), constant), RATE)
    assert np.all(found.actual == 0.0)
    assert np.all(found.coherence == 0.0)


@untimed
@given(signals, st.floats(10.0, 1e5))
def test_spectra_are_finite(values: metrics.FloatArray, rate: float) -> None:
    values = np.resize(values, 64)
    found = metrics.spectra(values, values[::-1], rate)
    for array in (found.desired, found.actual, found.coherence):
        assert np.all(np.isfinite(array))
        assert np.all(array >= 0.0)
    assert np.all(found.coherence <= 1.0)


# Evaluation


@pytest.mark.parametrize(
    ("rate", "delay", "samples"),
    [(1000.0, 0.0, 0), (1000.0, None, 1), (4000.0, 1e-3, 4), (2500.0, 1e-3, 3), (400.0, 1e-3, 0)],
)
def test_delay_is_taken_to_the_nearest_sample_and_is_the_papers_by_default(
    rate: float, delay: float | None, samples: int
) -> None:
    desired = white_noise(1.0, 1.0)
    actual = np.concatenate([np.full(samples, 7.0), desired[: len(desired) - samples]])
    found = metrics.evaluate(desired, actual, rate, *([] if delay is None else [delay]))
    assert metrics.PAPER_DELAY == 1.0e-3
    assert found.nrmse_percent == pytest.approx(0.0, abs=1e-9)
    assert found.slope_desired_on_actual == pytest.approx(1.0)
    assert found.slope_actual_on_desired == pytest.approx(1.0)
    assert found.r2 == pytest.approx(1.0)


def test_evaluation_is_in_percent() -> None:
    found = metrics.evaluate(sine(), sine(0.5), RATE, delay=0.0)
    assert found.nrmse_percent == pytest.approx(50.0)
    assert found.slope_actual_on_desired == pytest.approx(0.5)
    assert found.slope_desired_on_actual == pytest.approx(2.0)


@untimed
@given(signals, signals)
def test_evaluation_is_valid_json(desired: metrics.FloatArray, actual: metrics.FloatArray) -> None:
    assume(np.linalg.norm(desired[:-1]) > 1e-90)
    actual = np.resize(actual, len(desired))
    json.dumps(dataclasses.asdict(metrics.evaluate(desired, actual, RATE)), allow_nan=False)


@pytest.mark.parametrize(
    ("desired", "actual", "message"),
    [
        (np.ones(5), np.ones(4), "5 and 4"),
        (np.ones(2), np.ones(2), "2 samples, must be at least 3"),
        (np.ones(0), np.ones(0), "0 samples, must be at least 3"),
        (np.zeros(9), np.ones(9), "desired: is zero"),
        (np.ones((5, 2, 1)), np.ones((5, 2, 1)), "desired: has 3 dimensions"),
        (np.ones((5, 2)), np.ones((5, 3)), "have 10 and 15 numbers"),
        (np.ones(5), np.array([1.0, 1.0, math.nan, 1.0, 1.0]), "actual: holds NaN"),
        (np.array([1.0, 1.0, math.inf, 1.0, 1.0]), np.ones(5), "desired: holds NaN"),
        (np.ones(5), np.full(5, 1e200), "actual: holds NaN, infinity or a value beyond 1e"),
    ],
)
def test_unfit_signals_are_refused(
    desired: metrics.FloatArray, actual: metrics.FloatArray, message: str
) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        metrics.evaluate(desired, actual, RATE)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("function", "samples", "numbers", "message"),
    [
        *((metrics.align, 5, (shift,), rf"^samples = {shift}: .*5$") for shift in (-1, 5, 6)),
        *(
            (function, 60, (rate,), f"^rate = {rate}")
            for function in (metrics.evaluate, metrics.spectra)
            for rate in (0.0, -1.0, math.nan, math.inf)
        ),
        *(
            (metrics.evaluate, 60, (RATE, delay), f"^delay = {delay}")
            for delay in (-1e-3, math.nan, math.inf)
        ),
        (metrics.spectra, 15, (RATE,), "15 samples, must be at least 16"),
        (shift_back, 10, (RATE, 0.02), "samples"),
        (shift_back, 40, (RATE, 0.5e-3), "fraction"),
    ],
)
def test_unfit_numbers_are_refused(
    function: Callable[..., object], samples: int, numbers: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        function(np.ones(samples), np.ones(samples), *numbers)


# Bands


@settings(max_examples=30)
@given(st.floats(0.0, 3.0), st.floats(-math.pi, math.pi))
def test_a_sine_has_the_distance_of_its_phasors_in_its_band(gain: float, phase: float) -> None:
    actual = sine(gain, phase, 90.0)
    found = metrics.band_nrmse(sine(frequency=90.0), actual, RATE, metrics.bands(RATE))
    assert found["60-125 Hz"] == pytest.approx(abs(gain * cmath.exp(1j * phase) - 1), abs=1e-3)
    assert math.isnan(found["250-500 Hz"])


def test_bands_do_not_hear_each_other() -> None:
    tones = [sine(frequency=frequency) for frequency in (40.0, 90.0, 180.0)]
    desired, actual = sum(tones), 0.5 * tones[0] + tones[1] - tones[2]
    found = metrics.band_nrmse(desired, actual, RATE, metrics.bands(RATE))
    assert found["30-60 Hz"] == pytest.approx(0.5, abs=1e-3)
    assert found["60-125 Hz"] == pytest.approx(0.0, abs=1e-3)
    assert found["125-250 Hz"] == pytest.approx(2.0, abs=1e-3)


def test_of_white_noise_every_band_has_the_error_of_the_whole() -> None:
    generator = np.random.default_rng(1)
    desired = generator.normal(size=60_000)
    actual = desired + 0.4 * generator.normal(size=60_000)
    found = metrics.band_nrmse(desired, actual, RATE, metrics.bands(RATE))
    whole = metrics.nrmse(desired, actual)
    assert whole == pytest.approx(0.4, rel=0.02)
    assert list(found.values()) == pytest.approx([whole] * len(found), rel=0.08)


@given(st.floats(31.0, 20_000.0))
def test_bands_lie_side_by_side_up_to_half_the_rate(rate: float) -> None:
    found = metrics.bands(rate)
    assert found[0].low == metrics.BAND_EDGES[0]
    assert found[-1].high == min(rate / 2, metrics.BAND_EDGES[-1])
    assert all(one.high == other.low for one, other in itertools.pairwise(found))
    assert all(band.low < band.high for band in found)


def test_the_bands_of_the_papers_rate_have_names() -> None:
    named = ", ".join(band.name for band in metrics.bands(1000.0))
    assert named == "15-30 Hz, 30-60 Hz, 60-125 Hz, 125-250 Hz, 250-500 Hz"


# The paper


def test_table_two_as_printed() -> None:
    rows = {
        "none": (99.6, 99.5, 99.3, 99.5),
        "constant": (69.8, 80.6, 92.3, 79.1),
        "dynamic": (65.1, 73.2, 82.8, 72.0),
    }
    surfaces = ("plywood", "text", "vinyl", "average")
    expected = {
        (surface, controller): percent
        for controller, row in rows.items()
        for surface, percent in zip(surfaces, row, strict=True)
    }
    assert dict(metrics.TABLE_II) == expected


def test_printed_averages_agree_with_the_printed_regression() -> None:
    # Slopes of desired on actual and R^2 as printed; b = R^2 / slope is actual on desired.
    for controller, slope, r2 in (("constant", 0.60, 0.65), ("dynamic", 0.64, 0.71)):
        b = r2 / slope
        percent = 100.0 * math.sqrt(1.0 - 2.0 * b + b**2 / r2)
        assert percent == pytest.approx(metrics.TABLE_II["average", controller], abs=1.0)


def noise(seed: int, length: int = 2000) -> FloatArray:
    return np.random.default_rng(seed).normal(size=length)


def tones(seconds: float, rate: float = RATE, length: int = 3000) -> FloatArray:
    """Return a band-limited signal as it is some time later, from its formula."""
    time = np.arange(length) / rate - seconds
    frequencies = np.array([31.0, 47.0, 83.0, 101.0, 139.0, 167.0, 211.0])
    phases = np.arange(len(frequencies)) ** 2
    return np.asarray(np.sin(2 * np.pi * np.outer(time, frequencies) + phases).sum(axis=1))


@settings(max_examples=30)
@given(st.integers(-15, 15), st.integers(0, 5))
def test_whole_samples_are_found(samples: int, seed: int) -> None:
    long = noise(seed)
    desired, actual = long[20:-20], 0.3 * long[20 - samples : len(long) - 20 - samples]
    found = estimate_delay(desired, actual, RATE)
    assert found.seconds == pytest.approx(samples / RATE, abs=0.01 / RATE)
    assert found.correlation > 0.98


@settings(max_examples=30)
@given(st.floats(-5e-3, 5e-3))
def test_fractions_of_a_sample_are_found(seconds: float) -> None:
    found = estimate_delay(tones(0.0), tones(seconds), RATE)
    assert found.seconds == pytest.approx(seconds, abs=0.02 / RATE)


@settings(max_examples=30)
@given(st.floats(-5e-3, 5e-3))
def test_a_delay_is_taken_back(seconds: float) -> None:
    desired, actual = shift_back(tones(0.0), tones(seconds), RATE, seconds)
    inner = slice(300, -300)  # what the ends lack decays slowly
    error = np.linalg.norm((actual - desired)[inner]) / np.linalg.norm(desired[inner])
    assert error < 0.01


@pytest.mark.parametrize("samples", [0, 1, 7, -3])
def test_whole_samples_are_taken_back_exactly(samples: int) -> None:
    long = noise(1)
    desired, actual = long[20:-20], long[20 - samples : len(long) - 20 - samples]
    first, second = shift_back(desired, actual, RATE, samples / RATE)
    np.testing.assert_array_equal(first, second)
    assert len(first) == len(desired) - abs(samples)


TOO_LATE = round(2 * LONGEST_DELAY * RATE)


@pytest.mark.parametrize(
    ("desired", "actual"),
    [
        (noise(1), noise(2)),
        (noise(1), np.zeros(2000)),
        (np.ones(2000), noise(2)),
        (np.zeros(0), np.zeros(0)),
        (noise(3)[TOO_LATE:], noise(3)[:-TOO_LATE]),
        (noise(4), -noise(4)),
    ],
    ids=["others", "silent", "constant", "none", "beyond the longest delay", "opposed"],
)
def test_what_is_not_alike_has_no_delay(desired: FloatArray, actual: FloatArray) -> None:
    assert math.isnan(estimate_delay(desired, actual, RATE).seconds)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The share that a hand could not tell, for signals whose answer is known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from haptic_accel.core.evaluation.metrics import detection_threshold, indistinguishable
from haptic_accel.core.model import FloatArray

SECONDS = 4.0

untimed = settings(deadline=None)
rates = st.sampled_from([200.0, 1000.0, 1001.3, 4000.0])
seeds = st.integers(0, 2**32 - 1)


def tone(frequency: float, displacement: float, rate: float = 1000.0) -> FloatArray:
    """Return the acceleration of a vibrating stylus, m/s^2, from its displacement (peak), m."""
    time = np.arange(round(SECONDS * rate)) / rate
    omega = 2 * np.pi * frequency
    return displacement * omega**2 * np.sin(omega * time)


def noise(seed: int, rate: float = 1000.0) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, 3.0, round(SECONDS * rate))


def louder(values: FloatArray, decibels: float) -> FloatArray:
    return 10 ** (decibels / 20) * values


# Level


@untimed
@given(seeds, rates, st.floats(-2.19, 2.19), st.floats(2.5, 60.0), st.sampled_from([-1, 1]))
def test_a_difference_is_noticed_from_two_and_a_half_decibels_on_and_not_up_to_two(
    seed: int, rate: float, little: float, much: float, sign: int
) -> None:
    wanted = noise(seed, rate)
    assert indistinguishable(wanted, wanted, rate) == 1.0
    assert indistinguishable(wanted, louder(wanted, little), rate) == 1.0
    assert indistinguishable(wanted, louder(wanted, sign * much), rate) == 0.0


@untimed
@given(seeds, seeds)
def test_either_signal_may_be_the_desired_one(one: int, other: int) -> None:
    first, second = noise(one), noise(other)
    assert indistinguishable(first, second, 1000.0) == indistinguishable(second, first, 1000.0)


# Detection


@pytest.mark.parametrize(
    ("frequency", "displacement"), [(20.0, 8.5e-6), (160.0, 0.065e-6), (320.0, 0.06e-6)]
)
def test_a_tone_counts_from_the_published_threshold_on(
    frequency: float, displacement: float
) -> None:
    weak, strong = tone(frequency, displacement / 1.3), tone(frequency, 1.3 * displacement)
    assert math.isnan(indistinguishable(weak, weak, 1000.0))
    assert indistinguishable(strong, strong, 1000.0) == 1.0


def test_a_hand_is_most_sensitive_to_acceleration_near_125_hz() -> None:
    # Griffin, Industrial Health 50, 2012, for a hand grip.
    frequency = np.geomspace(20.0, 500.0, 200)
    assert 100.0 < frequency[np.argmin(detection_threshold(frequency))] < 165.0


@pytest.mark.parametrize("silent", ["desired", "actual"])
def test_false_and_missing_vibration_are_told(silent: str) -> None:
    signals = {"desired": noise(1), "actual": noise(1)} | {silent: np.zeros(4000)}
    assert indistinguishable(rate=1000.0, **signals) == 0.0


# Time and frequency


@pytest.mark.parametrize(
    ("wanted", "actual", "share"),
    [
        ({100.0: 10e-6}, {100.0: 10e-6, 25.0: 1e-6}, 1.0),  # by what nobody feels
        ({80.0: 10e-6}, {125.0: 10e-6}, 0.0),
        ({50.0: 10e-6, 200.0: 10e-6}, {50.0: 10e-6, 200.0: 20e-6}, 0.5),
    ],
)
def test_tones_are_told_apart_band_by_band(
    wanted: dict[float, float], actual: dict[float, float], share: float
) -> None:
    one, other = (
        np.sum([tone(*each) for each in tones.items()], axis=0) for tones in (wanted, actual)
    )
    assert indistinguishable(one, other, 1000.0) == share


def test_a_wrong_half_of_the_time_is_half() -> None:
    wanted = noise(1)
    actual = np.where(np.arange(wanted.size) < wanted.size / 2, wanted, 0.0)
    assert indistinguishable(wanted, actual, 1000.0) == pytest.approx(0.5, abs=0.07)


def test_an_event_between_two_cells_is_felt() -> None:
    time = np.arange(4000) / 1000.0
    tap = np.where(time >= 0.5, 5 * np.exp(-(time - 0.5) / 0.01), 0) * np.sin(800 * (time - 0.5))
    assert indistinguishable(np.zeros(4000), tap, 1000.0) == 0.0


@untimed
@given(st.floats(25.0, 80.0), st.sampled_from([0.0, 2.0, 3.0]))
def test_the_share_does_not_depend_on_the_rate(frequency: float, decibels: float) -> None:
    shares = {
        indistinguishable(own := tone(frequency, 20e-6, rate), louder(own, decibels), rate)
        for rate in (250.0, 1000.0, 4000.0)
    }
    assert len(shares) == 1


def test_phase_and_waveform_are_not_compared() -> None:
    wanted = noise(1)
    assert indistinguishable(wanted, -wanted, 1000.0) == 1.0
    assert 0.3 < indistinguishable(wanted, noise(2), 1000.0) < 0.8


@settings(deadline=None, max_examples=20)
@given(seeds, st.floats(40.0, 300.0), st.floats(-0.8, 3.0))
def test_third_octave_filters_find_the_same_share(
    seed: int, frequency: float, resonance: float
) -> None:
    fading = np.interp(np.arange(20_000), [0, 10_000, 20_000], [0.01, 1.0, 0.1])
    wanted = fading * np.random.default_rng(seed).normal(0.0, 1.0, 20_000)
    edges = (0.7 * frequency, 1.4 * frequency)
    band = signal.butter(1, edges, "bandpass", fs=1000.0, output="sos")
    actual = wanted + resonance * signal.sosfilt(band, wanted)
    share = indistinguishable(wanted, actual, 1000.0)
    assert share == pytest.approx(filtered_share(wanted, actual), abs=0.06)


def filtered_share(desired: FloatArray, actual: FloatArray, rate: float = 1000.0) -> float:
    """Return the share by Butterworth filters (IEC 61260) and cells side by side."""
    told, felt = 0, 0
    for centre in 1000.0 * 10.0 ** (np.arange(-17, -3) / 10):
        edges = (centre * 10**-0.05, centre * 10**0.05)
        band = signal.butter(3, edges, "bandpass", fs=rate, output="sos")
        levels = [
            20 * np.log10(np.std(signal.sosfilt(band, each).reshape(-1, round(rate / 2)), axis=1))
            for each in (desired, actual)
        ]
        (least,) = 20 * np.log10(detection_threshold(np.array([centre])))
        counted = np.max(levels, axis=0) >= least
        felt += np.count_nonzero(counted)
        told += np.count_nonzero(counted & (np.abs(levels[0] - levels[1]) > 2.2))
    return 1.0 - told / felt


# Limits


@pytest.mark.parametrize(
    ("signal", "rate"),
    [(np.zeros(4000), 1000.0), (noise(1)[:400], 1000.0), (noise(1), 40.0)],
    ids=["nothing to feel", "shorter than a cell", "rate below all bands"],
)
def test_there_is_no_share_of(signal: FloatArray, rate: float) -> None:
    assert math.isnan(indistinguishable(signal, signal, rate))


@pytest.mark.parametrize(
    ("desired", "actual", "rate", "message"),
    [
        (np.ones(5), np.ones(4), 1000.0, "5 and 4 samples"),
        (np.zeros(0), np.zeros(0), 1000.0, "0 samples"),
        (np.ones(5), np.full(5, np.nan), 1000.0, "actual: holds NaN"),
        (np.ones(5), np.ones(5), 0.0, "rate"),
    ],
)
def test_signals_that_cannot_be_compared_are_refused(
    desired: FloatArray, actual: FloatArray, rate: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        indistinguishable(desired, actual, rate)

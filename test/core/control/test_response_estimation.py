# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The running estimate of a response: known filters, noise, gaps, forgetting."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.control.estimation import (
    AutocorrelationEstimator,
    ChangeEstimator,
    Evaluation,
    ResponseEstimator,
    latest,
)
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import FORCE, MEASURED, Trace

RATE = 1000.0


def noise(samples: int, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(samples)


def feed(estimator: ResponseEstimator, cause: FloatArray, effect: FloatArray) -> list[float]:
    """Give all samples; return the surprise after each of an estimator that has one."""
    surprises = []
    for given, shown in zip(cause.tolist(), effect.tolist(), strict=True):
        estimator.trace.push(0.0, shown, given, 0.0)
        estimator.update()
        surprises.append(getattr(estimator, "surprise", math.nan))
    return surprises


def within(estimator: ResponseEstimator, low: float, high: float) -> FloatArray:
    return np.asarray((estimator.frequency >= low) & (estimator.frequency <= high))


def band_pass(rate: float = RATE) -> FloatArray:
    return np.asarray(signal.butter(2, [60, 200], "bandpass", fs=rate, output="sos"))


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_it_finds_a_filter(rate: float) -> None:
    cause = noise(round(8 * rate))
    estimator = ResponseEstimator(Trace(), rate, memory=4.0)
    feed(estimator, cause, signal.sosfilt(band_pass(rate), cause))
    band = within(estimator, 60.0, 200.0)
    true = signal.sosfreqz(band_pass(rate), estimator.frequency[band], fs=rate)[1]
    assert estimator.response[band] == pytest.approx(true, abs=0.06)
    assert estimator.coherence[band].min() > 0.98


def test_its_excitation_is_a_density() -> None:
    estimator = ResponseEstimator(Trace(), 1000.0, memory=4.0)
    cause = 3.0 * noise(8000)
    feed(estimator, cause, cause)
    # White noise of variance 9 at 1 kHz: 9 / 500 per Hz.
    band = within(estimator, 20.0, 480.0)
    assert estimator.excitation[band].mean() == pytest.approx(9.0 / 500.0, rel=0.05)


def test_independent_noise_is_not_coherent() -> None:
    estimator = ResponseEstimator(Trace(), 1000.0, memory=2.0)
    feed(estimator, noise(6000, 1), noise(6000, 2))
    band = within(estimator, 20.0, 480.0)
    assert estimator.coherence[band].mean() < 0.15


def test_gravity_is_not_part_of_it() -> None:
    plain, under = ResponseEstimator(Trace(), 1000.0, 1.0), ResponseEstimator(Trace(), 1000.0, 1.0)
    cause = noise(2000)
    feed(plain, cause, cause)
    feed(under, cause, cause + 9.81)
    assert under.cross == pytest.approx(plain.cross, abs=1e-12)


def test_it_follows_a_change_and_forgets() -> None:
    estimator = ResponseEstimator(Trace(), 1000.0, memory=0.3)
    cause = noise(4000)
    feed(estimator, cause[:2000], cause[:2000])
    feed(estimator, cause[2000:], -2.0 * cause[2000:])
    band = within(estimator, 20.0, 480.0)
    assert estimator.response[band].mean() == pytest.approx(-2.0, abs=0.05)


def test_what_has_faded_yields_to_a_smaller_input() -> None:
    cause = noise(4000)
    found = []
    for factor in (1.0, 1e-4):
        estimator = ResponseEstimator(Trace(), RATE, memory=4.0)
        feed(estimator, 100.0 * cause, 100.0 * cause)
        feed(estimator, cause[:300], cause[:300])  # longer than a window
        estimator.fade(factor)
        assert estimator.response[20:-20] == pytest.approx(1.0, abs=0.01)
        feed(estimator, cause, -cause)
        found.append(float(estimator.response[20:-20].real.mean()))
    assert found[0] > 0.99
    assert found[1] < 0.0


def test_silence_keeps_the_response_and_not_the_excitation() -> None:
    estimator = ResponseEstimator(Trace(), 1000.0, memory=0.3)
    cause = noise(2000)
    feed(estimator, cause, 2.0 * cause)
    response, excitation = estimator.response, estimator.excitation
    feed(estimator, np.zeros(3000), np.zeros(3000))
    band = within(estimator, 20.0, 480.0)
    assert estimator.response[band] == pytest.approx(response[band], abs=0.02)
    assert estimator.excitation[band].mean() < 1e-3 * excitation[band].mean()


def test_reset_forgets_all() -> None:
    used, fresh = ResponseEstimator(Trace(), 1000.0, 1.0), ResponseEstimator(Trace(), 1000.0, 1.0)
    feed(used, noise(1100, 3), noise(1100, 4))
    used.reset()
    cause = noise(1000)
    for estimator in (used, fresh):
        feed(estimator, cause, cause)
    assert np.array_equal(used.cross, fresh.cross)
    assert used.estimates == fresh.estimates


def test_a_model_makes_it_a_ratio() -> None:
    estimator = ResponseEstimator(Trace(), 1000.0, memory=4.0, window=0.5)
    estimator.model[1:] = signal.sosfreqz(band_pass(), estimator.frequency[1:], fs=1000.0)[1]
    cause = noise(8000)
    feed(estimator, cause, 1.5 * signal.sosfilt(band_pass(), cause))
    band = within(estimator, 60.0, 200.0)
    assert estimator.response[band] == pytest.approx(np.full(band.sum(), 1.5), abs=0.1)


def test_too_small_an_input_teaches_nothing() -> None:
    estimator = ResponseEstimator(Trace(), 1000.0, memory=4.0, least=0.1)
    small = 0.05 * noise(2000)
    feed(estimator, small, small)
    assert estimator.estimates == 0
    assert estimator.weight == 0.0
    feed(estimator, 10 * small, 10 * small)
    assert estimator.estimates > 0


class Recorded(Evaluation):
    """Evaluation that takes note of its windows."""

    def __init__(self, length: int, hop: int) -> None:
        super().__init__(Trace(), length, hop)
        self.windows: dict[int, tuple[list[float], list[float]]] = {}

    def _look(self, late: int) -> Iterator[bool | None]:
        signals = FORCE, MEASURED
        force, measured = (latest(self.trace, each, self._length).tolist() for each in signals)
        self.windows[self.trace.count] = force, measured
        yield True

    def run(self, measured: Iterable[float]) -> list[int]:
        """Return the counts at which a window was evaluated; forces are those counts."""
        for value in measured:
            self.trace.push(0.0, value, self.trace.count + 1.0, 0.0)
            self.update()
        return list(self.windows)


def test_it_is_due_each_hop_once_it_is_full() -> None:
    found = Recorded(12, 4)
    assert found.run(-place for place in range(1, 25)) == [12, 16, 20, 24]
    assert found.windows[24] == ([*range(13, 25)], [*range(-13, -25, -1)])


@pytest.mark.parametrize("unknown", [math.nan, math.inf, -math.inf])
def test_a_missing_sample_repeats_the_one_before(unknown: float) -> None:
    found = Recorded(2, 1)
    found.run([5.0, unknown])
    assert latest(found.trace, MEASURED, 3).tolist() == [0.0, 5.0, 5.0]


def test_windows_with_too_many_gaps_are_left_out() -> None:
    gaps = [*[0.0] * 97, *[math.nan] * 3, *[0.0] * 100]  # 3 %
    assert Recorded(100, 50).run(gaps) == [200]
    saturated = [math.inf if number == 70 else 1.0 for number in range(256)]
    assert Recorded(64, 16).run(saturated) == [64, *range(144, 257, 16)]


def test_an_evaluation_that_restarts_forgets_all() -> None:
    found = Recorded(2, 1)
    found.run([1.0, math.nan])
    found.restart()
    assert found.run([1.0, 1.0]) == [4]
    assert latest(found.trace, MEASURED, 3, start=3).tolist() == [0.0, 0.0, 1.0]


def autocorrelation(signal: FloatArray, memory: float = 2.0) -> FloatArray:
    estimator = AutocorrelationEstimator(Trace(), RATE, memory, 0.064, 0.512, 0.01)
    for value in signal.tolist():
        estimator.trace.push(value, 0.0, 0.0, value)
        while estimator.update():
            pass
    return estimator.sequence


def test_the_autocorrelation_of_a_line_is_a_cosine_under_a_triangle() -> None:
    time = np.arange(round(8 * RATE)) / RATE
    found = autocorrelation(np.sin(2 * np.pi * 20.0 * time), memory=1e6)
    lag = np.arange(len(found))
    expected = np.cos(2 * np.pi * 20.0 * lag / RATE) * (1.0 - lag / len(found))
    assert found / found[0] == pytest.approx(expected, abs=0.03)


def test_its_spectrum_is_nowhere_negative() -> None:
    loud = np.random.default_rng(5).standard_normal(4000) * np.repeat([1.0, 0.05], 2000)
    found = autocorrelation(loud)
    spectrum = np.fft.rfft(np.concatenate([found, [0.0], found[:0:-1]])).real
    assert spectrum.min() > -1e-3 * spectrum.max()


def test_a_quiet_signal_changes_nothing() -> None:
    assert not autocorrelation(np.full(2000, 1e-3)).any()


def test_a_change_of_the_response_is_a_surprise_and_a_smaller_force_is_none() -> None:
    random = np.random.default_rng(2)
    force, noise = random.standard_normal(6000), random.standard_normal(6000)
    force[2000:] *= 0.1
    response = np.where(np.arange(6000) < 4000, 1.0, 30.0)
    estimator = ChangeEstimator(Trace(), 1000.0, memory=2.0)
    surprises = feed(estimator, force, response * force + 0.1 * noise)
    assert max(surprises[1000:4000]) < 1.5
    assert max(surprises[4000:]) > 3.0

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Learning of the tool's spectrum and of the plant: known ratios, spectra and optima."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.control import inversion
from haptic_accel.core.control.controllers.adaptive import InverseFamily, Learner, design_family
from haptic_accel.core.control.filters import high_pass
from haptic_accel.core.control.inversion import TexturePrior, ToolSpectrum, predict
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray, MountParameters
from haptic_accel.core.tick import Trace

RATE = 1000.0
GOAL = inversion.Goal(2)
PLANT = Plant().delayed(1)
GRIP = np.array([PLANT.handle.m_h, PLANT.handle.b_u, PLANT.handle.k_u])


@lru_cache(maxsize=1)
def family() -> InverseFamily:
    return design_family(PLANT, RATE, GOAL)


def texture(seconds: float, spectrum: ToolSpectrum, seed: int = 1) -> FloatArray:
    """Return noise with a spectrum, m/s^2, periodic."""
    count = round(seconds * RATE)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    white = np.fft.rfft(np.random.default_rng(seed).standard_normal(count))
    return np.asarray(np.fft.irfft(white * np.sqrt(spectrum(frequency) * RATE / 2), count))


def answer(plant: Plant, force: FloatArray) -> FloatArray:
    """Return the plant's acceleration after a force that goes on for ever, m/s^2.

    Time counts from where the force takes effect: it is due a latency after its cause.
    """
    frequency = np.fft.rfftfreq(len(force), 1.0 / RATE)
    response = np.zeros(len(frequency), dtype=np.complex128)
    response[1:] = plant.response(frequency[1:], RATE)
    return np.asarray(np.fft.irfft(response * np.fft.rfft(force), len(force)))


def give(learner: Learner, *signals: FloatArray) -> None:
    """Let a learner observe the signals of its trace."""
    for values in np.stack(signals, axis=1).tolist():
        learner.trace.push(*values)
        learner.update(GRIP)


def watch(learner: Learner, tool: FloatArray, force: FloatArray, measured: FloatArray) -> None:
    """Let a learner observe a tool, and a force that is not that of any controller."""
    desired = signal.sosfilt(high_pass(15.0, RATE), tool)
    extended = signal.sosfilt(inversion.extension(15.0, RATE), desired)
    give(learner, desired, measured, force, extended)


def learn(plant: Plant, spectrum: ToolSpectrum, seconds: float = 6.0) -> Learner:
    """Return a learner that has watched a plant."""
    force = texture(seconds, TexturePrior(), seed=2)
    learner = Learner(Trace(), family(), PLANT, RATE, GOAL)
    watch(learner, texture(seconds, spectrum), force, answer(plant, force))
    return learner


def error(taps: FloatArray, plant: Plant, spectrum: TexturePrior) -> float:
    inverse = inversion.InverseFilter(inversion.extension(15.0, RATE), taps, RATE, GOAL)
    return predict(inverse, plant, spectrum).nrmse_percent


def best(plant: Plant, spectrum: TexturePrior) -> float:
    goal = replace(GOAL, spectrum=spectrum, travel_corner=inversion.TRAVEL_CORNERS[0])
    return predict(inversion.design_inverse(plant, RATE, goal), plant, spectrum).nrmse_percent


def test_what_was_expected_changes_nothing() -> None:
    learner = learn(PLANT, TexturePrior())
    assert learner.estimates
    spectrum = TexturePrior()
    taps = family().taps(GRIP)[0]
    learnt = error(taps + learner.correction[0], PLANT, spectrum)
    assert learnt == pytest.approx(error(taps, PLANT, spectrum), abs=0.3)


@pytest.mark.parametrize(("rise", "fall"), [(60.0, 80.0), (15.0, 60.0), (120.0, 300.0)])
def test_it_comes_near_the_design_for_the_spectrum(rise: float, fall: float) -> None:
    plant = replace(PLANT, mount=MountParameters(290.0, 0.11), bandwidth=500.0)
    spectrum = TexturePrior(rise, fall)
    learner = learn(plant, spectrum)
    taps = family().taps(GRIP)[0]
    expected, learnt = (error(x, plant, spectrum) for x in (taps, taps + learner.correction[0]))
    assert learnt < expected
    assert learnt < 1.15 * best(plant, spectrum) + 1.0


@pytest.mark.parametrize("frequency", [120.0, 180.0, 320.0])
@pytest.mark.parametrize("damping", [0.05, 0.3])
def test_it_learns_a_mode_that_nobody_told_of(frequency: float, damping: float) -> None:
    plant = replace(PLANT, mount=MountParameters(frequency, damping))
    spectrum = TexturePrior()
    learner = learn(plant, spectrum)
    taps = family().taps(GRIP)[0]
    assert error(taps, plant, spectrum) > 25.0
    assert error(taps + learner.correction[0], plant, spectrum) < 20.0


def swaying(frequency: FloatArray) -> FloatArray:
    """Return the spectrum of a texture under a hand that moves to and fro at up to 2 Hz."""
    slow = 0.5 / (1.0 + (frequency / 2.0) ** 8)
    return np.asarray(TexturePrior()(frequency) + slow)


def test_slow_motion_needs_less_travel_where_travel_is_short() -> None:
    learner = learn(PLANT, swaying)
    given = family().taps(GRIP)
    filters = [
        [
            inversion.InverseFilter(inversion.extension(15.0, RATE), taps, RATE, GOAL)
            for taps in bank
        ]
        for bank in (given, given + learner.correction)
    ]
    before, after = ([predict(each, PLANT, swaying) for each in bank] for bank in filters)
    assert after[0].nrmse_percent < 3.0
    assert after[0].travel_rms < before[0].travel_rms / 5
    for corner, old, new in zip(
        inversion.TRAVEL_CORNERS[1:4], before[1:4], after[1:4], strict=True
    ):
        goal = replace(GOAL, spectrum=swaying, travel_corner=corner)
        best_known = predict(inversion.design_inverse(PLANT, RATE, goal), PLANT, swaying)
        assert new.travel_rms < old.travel_rms / 5
        assert new.travel_rms == pytest.approx(best_known.travel_rms, rel=0.15)
        assert new.nrmse_percent < best_known.nrmse_percent + 5.0


def test_noise_that_no_force_explains_is_no_plant() -> None:
    force = texture(4.0, TexturePrior(), seed=2)
    learner = Learner(Trace(), family(), PLANT, RATE, GOAL)
    measured = answer(PLANT, force) + texture(4.0, TexturePrior(), seed=3)
    watch(learner, texture(4.0, TexturePrior()), force, measured)
    taps = family().taps(GRIP)[0]
    assert error(taps + learner.correction[0], PLANT, TexturePrior()) < 5.0


@pytest.mark.parametrize("scale", [0.0, 1e-3])
def test_silence_teaches_nothing(scale: float) -> None:
    learner = Learner(Trace(), family(), PLANT, RATE, GOAL)
    tool = scale * texture(2.0, TexturePrior())
    give(learner, tool, -tool, tool, tool)
    assert not learner.estimates
    assert not learner.correction.any()


def test_missing_and_huge_samples_leave_it_finite() -> None:
    learner = Learner(Trace(), family(), PLANT, RATE, GOAL)
    tool = texture(2.0, TexturePrior())
    measured = np.where(np.arange(len(tool)) % 100 == 0, np.nan, 1e4 * tool)
    give(learner, tool, measured, tool, tool)
    assert learner.estimates
    assert np.isfinite(learner.correction).all()


def test_reset_forgets_all() -> None:
    learner = learn(replace(PLANT, mount=MountParameters(180.0, 0.1)), TexturePrior(), 2.0)
    assert learner.correction.any()
    learner.trace.reset()
    learner.reset()
    assert not learner.correction.any()
    assert learner.estimates == 0


@pytest.mark.parametrize("rate", [300.0, 700.0, 4000.0])
@pytest.mark.parametrize("memory", [0.05, 0.4])
def test_it_fits_every_rate_and_memory(rate: float, memory: float) -> None:
    plant, goal = Plant().delayed(1), inversion.Goal(2, memory)
    learner = Learner(Trace(), design_family(plant, rate, goal), plant, rate, goal)
    white = np.random.default_rng(1).standard_normal(round(2.5 * rate))
    give(learner, white, white, 0.1 * white, white)
    assert learner.estimates
    assert np.isfinite(learner.correction).all()


def test_each_design_uses_the_response_of_the_same_time() -> None:
    force = texture(1.0, TexturePrior(), seed=2)
    answered = -answer(PLANT, force)
    learner = Learner(Trace(), family(), PLANT, RATE, GOAL)
    first = slice(512 + 64)  # one window of the response, and the parts of a design
    watch(learner, texture(1.0, TexturePrior())[first], force[first], answered[first])
    assert learner.deviation == pytest.approx(2.0, rel=0.2)

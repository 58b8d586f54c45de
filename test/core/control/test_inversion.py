# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The inverse's design against what theory says of it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal

from haptic_accel.core.control.error_bound import causal_bound
from haptic_accel.core.control.filters import high_pass
from haptic_accel.core.control.inversion import (
    EXTENDED_CORNER,
    PRIOR,
    Goal,
    TexturePrior,
    design_basis,
    design_inverse,
    extension,
    measured_spectrum,
    predict,
)
from haptic_accel.core.handle.mechanics import Grid
from haptic_accel.core.handle.plant import DiscreteModel, IdentifiedPlant, Plant
from haptic_accel.core.model import FloatArray, HandleParameters, MountParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tick.control import SampleConvolution, SampleWindow

RATES = [1000.0, 4000.0]
PAPER = Plant(mount=MountParameters(280.0, 0.127), delay=225e-6)
FAST_SENSOR = Plant(bandwidth=100e3)

grips = st.builds(
    HandleParameters, m_h=st.floats(0.02, 1.0), k_u=st.floats(0.0, 1e4), b_u=st.floats(0.0, 100.0)
)


def grip_factors(handle: HandleParameters) -> FloatArray:
    return np.array([handle.m_h, handle.b_u, handle.k_u, 1.0])


def flat(frequency: FloatArray) -> FloatArray:
    return np.full(len(frequency), 0.01)


# The extension


@pytest.mark.parametrize("rate", [50.0, *RATES, 20000.0])
def test_the_extension_moves_the_high_pass_down(rate: float) -> None:
    frequency = np.geomspace(0.3, rate / 2.1, 50)
    both = np.vstack([high_pass(15.0, rate), extension(15.0, rate)])
    found = signal.freqz_sos(both, frequency, fs=rate)[1]
    wanted = signal.freqz_sos(high_pass(EXTENDED_CORNER, rate), frequency, fs=rate)[1]
    assert found == pytest.approx(wanted, rel=1e-4)


def test_a_high_pass_that_is_low_already_is_left_alone() -> None:
    found = signal.freqz_sos(extension(0.5, 1000.0), [1.0, 10.0], fs=1000.0)[1]
    assert found == pytest.approx(1.0)


# The design


@pytest.mark.parametrize("rate", RATES)
def test_of_a_free_mass_the_inverse_is_that_mass(rate: float) -> None:
    # The actuator is so heavy that it stays where it is, the spring so soft that it is none.
    free = HandleParameters(m_a=1e3, k_s=1e-3, b_s=0.0, m_h=0.2, k_u=0.0, b_u=0.0)
    plant = Plant(handle=free, bandwidth=100e3)
    inverse = design_inverse(plant, rate, Goal(spectrum=flat))
    frequency = np.array([60.0, 100.0, 200.0, 300.0])
    # One sample after a force it is accelerated in full, as is granted.
    assert inverse.response(frequency) == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("plant", [Plant(), PAPER])
def test_the_handle_follows_within_what_travel_leaves(plant: Plant, rate: float) -> None:
    few, many = (
        predict(design_inverse(plant, rate, Goal(travel_corner=corner)), plant)
        for corner in (12.0, 1.0)
    )
    assert few.landing_travel < 0.5 * many.landing_travel
    assert many.nrmse_percent < few.nrmse_percent
    assert many.travel_rms > few.travel_rms
    within = (many.frequency > 80.0) & (many.frequency < 200.0)
    assert np.abs(many.gain[within] - 1.0).max() < 0.2
    assert np.abs(many.phase[within]).max() < 0.3


def test_the_prediction_is_what_a_simulated_signal_does() -> None:
    rate = 1000.0
    inverse = design_inverse(Plant(), rate)
    # A model whose response is the plant's up to what a long impulse response has.
    grid = Grid(rate, 1 << 14)
    impulse = grid.sequence(Plant().response(grid.frequency, rate))[: grid.points]
    tool = signal.lfilter([1.0], [1.0, -0.5], np.random.default_rng(3).normal(size=60000))
    desired = signal.sosfilt(high_pass(15.0, rate), tool)
    force = signal.lfilter(inverse.taps, 1.0, signal.sosfilt(inverse.sections, desired))
    handle = signal.fftconvolve(force, impulse)[: len(tool)]
    found = np.linalg.norm(handle[1:] - desired[:-1]) / np.linalg.norm(desired)
    expected = predict(inverse, Plant(), measured_spectrum(tool, rate))
    assert 100 * found == pytest.approx(expected.nrmse_percent, rel=0.03)
    assert np.std(force) == pytest.approx(expected.force_rms, rel=0.05)


def test_a_longer_memory_is_hardly_better() -> None:
    short, long = (
        predict(design_inverse(PAPER, 1000.0, Goal(memory=memory)), PAPER).nrmse_percent
        for memory in (0.2, 0.8)
    )
    assert 0.95 * short < long < 1.01 * short


def test_more_delay_granted_leaves_less_error() -> None:
    errors = [
        predict(design_inverse(PAPER, 4000.0, Goal(granted_delay=delay)), PAPER).nrmse_percent
        for delay in (1, 2, 4)
    ]
    assert errors == sorted(errors, reverse=True)


def test_a_prior_that_fits_is_better_than_a_broad_one() -> None:
    actual = TexturePrior(rise=100.0, fall=120.0)
    broad, fitting = (
        predict(design_inverse(PAPER, 1000.0, Goal(spectrum=prior)), PAPER, actual).nrmse_percent
        for prior in (PRIOR, actual)
    )
    assert fitting < broad


@pytest.mark.parametrize("rate", RATES)
def test_the_paper_without_its_mount_is_followed_within_a_percent(rate: float) -> None:
    found = predict(design_inverse(Plant(), rate), Plant())
    assert found.nrmse_percent < 1.0
    # Nor is it only where texture is: what the hand does above the high-pass' corner as well.
    within = (found.frequency > 15.0) & (found.frequency < 200.0)
    assert np.abs(found.tracking[within] - 1.0).max() < 0.1


def test_the_prior_is_as_strong_as_it_says() -> None:
    frequency = np.arange(0.25, 5000.0, 0.5)
    assert math.sqrt(PRIOR(frequency).sum() * 0.5) == pytest.approx(1.4, abs=0.05)


# Grips


@pytest.mark.parametrize("rate", RATES)
def test_the_basis_gives_the_design_of_its_own_plant(rate: float) -> None:
    inverse, terms = design_inverse(PAPER, rate), design_basis(PAPER, rate)
    taps = grip_factors(PAPER.handle) @ terms
    # The four parts are each far larger than their sum at low frequencies.
    assert taps[0] == pytest.approx(inverse.taps, abs=1e-6 * np.abs(inverse.taps).max())


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(("mass", "stiffness", "damping"), [(0.7, 0.4, 0.5), (1.3, 2.0, 1.5)])
def test_another_grip_is_inverted_better_by_its_own_combination(
    rate: float, mass: float, stiffness: float, damping: float
) -> None:
    handle = HandleParameters()
    other = replace(
        handle, m_h=mass * handle.m_h, k_u=stiffness * handle.k_u, b_u=damping * handle.b_u
    )
    plant = replace(PAPER, handle=other)
    terms = design_basis(PAPER, rate)
    inverse = design_inverse(plant, rate)
    own = predict(inverse, plant).nrmse_percent
    combined, nominal = (
        predict(replace(inverse, taps=(grip_factors(grip) @ terms)[0]), plant).nrmse_percent
        for grip in (other, handle)
    )
    assert combined == pytest.approx(own, rel=0.1)
    assert combined < nominal


# Models without physics


def test_an_identified_model_is_inverted_too() -> None:
    rate = 1000.0
    sections = np.array([[8.0, -8.0, 0.0, 1.0, -0.8, 0.0]])
    plant = IdentifiedPlant(DiscreteModel(sections, rate, 1))
    found = predict(design_inverse(plant, rate), plant)
    within = (found.frequency > 80.0) & (found.frequency < 200.0)
    assert np.abs(found.tracking[within] - 1.0).max() < 0.1


def identified(*numerator: float, delay: int = 1) -> IdentifiedPlant:
    """Return a plant at 1 kHz without poles; missing coefficients are zero."""
    section = [*numerator, *[0.0] * (3 - len(numerator)), 1.0, 0.0, 0.0]
    return IdentifiedPlant(DiscreteModel(np.array([section]), 1000.0, delay))


def test_an_identified_model_of_another_rate_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^rate = 4000: must be that of the identified"):
        design_inverse(identified(8.0), 4000.0)


# The bound


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("plant", [Plant(), PAPER])
def test_no_design_is_below_the_bound(plant: Plant, rate: float) -> None:
    inverse = design_inverse(plant, rate, Goal(memory=0.4))
    assert causal_bound(plant, rate) <= predict(inverse, plant).nrmse_percent


def test_a_plant_that_answers_at_once_can_be_inverted_exactly() -> None:
    assert causal_bound(FAST_SENSOR, 1000.0, TexturePrior(rise=60.0)) < 1.0


def test_an_extra_delay_costs_what_cannot_be_foreseen() -> None:
    # Of x[n] = a x[n-1] + e[n], the best forecast by one sample leaves e: sqrt(1 - a^2) of it.
    # A corner of 0.01 Hz lets all of it through.
    rate, pole = 1000.0, 0.9

    def coloured(frequency: FloatArray) -> FloatArray:
        return np.abs(1.0 - pole * np.exp(-2j * np.pi * frequency / rate)) ** -2.0

    plant = identified(2.0, delay=2)
    found = causal_bound(plant, rate, coloured, high_pass_frequency=0.01)
    assert found == pytest.approx(100 * math.sqrt(1 - pole**2), rel=1e-2)
    free = causal_bound(plant, rate, coloured, granted_delay=2, high_pass_frequency=0.01)
    assert free < 1e-3


@pytest.mark.parametrize("zero", [1.5, 3.0])
@pytest.mark.parametrize("delay", [1, 2, 4])
def test_a_zero_that_cannot_be_inverted_costs_what_theory_says(zero: float, delay: int) -> None:
    # Of white noise through (1 - b z^-1) z^-1, all but the b^-d that d samples of delay leave
    # can be had: the terms before time zero of (1 - b z) / (b - z) add up to (b^2 - 1) b^-2d.
    plant = identified(1.0, -zero)
    found = causal_bound(plant, 1000.0, flat, granted_delay=delay, high_pass_frequency=0.01)
    expected = 100.0 * math.sqrt(zero**2 - 1.0) * zero**-delay
    assert found == pytest.approx(expected, rel=1e-4)


def test_the_bound_is_what_the_best_long_filter_comes_near_to() -> None:
    # A plant that has lost a sample more than is granted, without its travel and its force to
    # think of: by least squares over all that is known of a coloured signal.
    rate, count = 1000.0, 300
    sections = np.array([[4.0, -6.0, 0.0, 1.0, -0.5, 0.0]])
    plant = IdentifiedPlant(DiscreteModel(sections, rate, 2))
    grid = Grid(rate, 1 << 13)
    texture = TexturePrior(rise=60.0)
    power = texture(grid.frequency)
    passed = signal.freqz_sos(high_pass(15.0, rate), grid.frequency, fs=rate)[1]
    desired = power * np.abs(passed) ** 2
    response = plant.response(grid.frequency, rate)
    column = grid.sequence(desired * np.abs(response) ** 2)[:count]
    wanted = grid.sequence(desired * response.conj() * grid.delay(1))[:count]
    taps = linalg.solve_toeplitz(column, wanted)
    error = desired * np.abs(response * grid.spectrum(taps) - grid.delay(1)) ** 2
    best = 100 * math.sqrt(error.sum() / desired.sum())
    assert causal_bound(plant, rate, texture) == pytest.approx(best, rel=0.02)
    assert causal_bound(plant, rate, texture) <= best


def test_noise_of_the_handles_sensor_adds_its_power() -> None:
    # White noise on both, of equal power; the desired one has lost some in the high-pass.
    rate, deviation = 1000.0, 0.3

    def white(frequency: FloatArray) -> FloatArray:
        return np.full(len(frequency), 2 * deviation**2 / rate)

    with_noise = causal_bound(FAST_SENSOR, rate, white, noise=deviation)
    response = signal.freqz_sos(high_pass(15.0, rate), 1 << 14, fs=rate)[1]
    expected = 100.0 / math.sqrt(np.mean(np.abs(response) ** 2))
    assert with_noise == pytest.approx(expected, rel=1e-3)
    # What a design is predicted to do has as much of it.
    inverse = design_inverse(FAST_SENSOR, rate)
    noisy, clean = (
        predict(inverse, FAST_SENSOR, white, noise=noise).nrmse_percent
        for noise in (deviation, 0.0)
    )
    assert math.hypot(clean, expected) == pytest.approx(noisy, rel=1e-3)


# Latency


@pytest.mark.parametrize(("rate", "latency"), [(1000.0, 1), (4000.0, 3)])
def test_a_latency_is_a_pure_delay(rate: float, latency: int) -> None:
    frequency = np.linspace(1.0, 0.49 * rate, 200)
    late = PAPER.delayed(latency)
    expected = replace(PAPER, delay=PAPER.delay + latency / rate).response(frequency, rate)
    assert late.response(frequency, rate) == pytest.approx(expected, rel=1e-6)
    assert late.coupled().latency == latency
    goal = Goal(granted_delay=latency + 1)
    taps = design_inverse(PAPER, rate).taps
    assert design_inverse(late, rate, goal).taps == pytest.approx(
        taps, abs=1e-9 * np.abs(taps).max()
    )
    bounds = causal_bound(PAPER, rate), causal_bound(late, rate, granted_delay=latency + 1)
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-9)


def test_a_latency_delays_an_identified_model_too(tmp_path: Path) -> None:
    file = tmp_path / "found.json"
    model = {"sections": [[8.0, 0.0, 0.0, 1.0, 0.0, 0.0]], "delay_samples": 1, "rate_hz": 1000.0}
    file.write_text(json.dumps({"discrete_model": model}))
    frequency = np.array([20.0, 80.0, 300.0])
    plant = Plant(model=str(file))
    expected = plant.response(frequency, 1000.0) * np.exp(-2j * np.pi * frequency * 2e-3)
    assert plant.delayed(2).response(frequency, 1000.0) == pytest.approx(expected)


@pytest.mark.parametrize("latency", [-1, 21])
def test_an_impossible_latency_is_refused(latency: int) -> None:
    with pytest.raises(ParameterError, match=f"^latency = {latency}: must be from 0 to 20 sam"):
        Plant().delayed(latency)


# Numbers that are not allowed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rate": 20.0}, "rate = 20: must be above twice high_pass_frequency = 15 Hz"),
        ({"rate": math.nan}, "rate = nan: must be above twice high_pass_frequency = 15 Hz"),
        ({"granted_delay": -1}, "granted_delay = -1: must be from 0 to 120"),
        ({"memory": 100.0}, "memory = 100: must be from 0.001 to 8.192 s at 1000 Hz"),
        ({"travel_corner": 0.0}, "travel_corner = 0: must be above 0 Hz"),
    ],
)
def test_impossible_designs_are_refused(arguments: dict[str, float], message: str) -> None:
    goal: dict[str, Any] = dict(arguments)
    rate = goal.pop("rate", 1000.0)
    for make in (design_inverse, design_basis):
        with pytest.raises(ParameterError, match=f"^{message}$"):
            make(Plant(), rate, Goal(**goal))  # type: ignore[operator]


@settings(max_examples=15, deadline=None)
@given(
    handle=grips,
    frequency=st.one_of(st.just(0.0), st.floats(50.0, 2000.0)),
    damping=st.floats(0.01, 2.0),
    delay=st.floats(0.0, 0.02),
    rate=st.floats(50.0, 5000.0),
)
def test_any_plant_has_a_finite_inverse(
    handle: HandleParameters, frequency: float, damping: float, delay: float, rate: float
) -> None:
    plant = Plant(handle, MountParameters(frequency, damping), delay)
    inverse = design_inverse(plant, rate, Goal(memory=0.1))
    assert np.isfinite(inverse.taps).all()
    found = predict(inverse, plant)
    # What cannot be followed is left alone: never much worse than no force at all.
    assert found.nrmse_percent < 120.0


# Samples


@given(
    st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=8),
    st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=40),
)
def test_samples_are_convolved(taps: list[float], values: list[float]) -> None:
    stream, window = SampleConvolution(np.array(taps)), SampleWindow(len(taps))
    for value in values:
        pushed = window.push(value)
    found = [stream.process(value) for value in values]
    assert found == pytest.approx(np.convolve(values, taps)[: len(values)], abs=1e-9)
    latest = np.concatenate([np.zeros(len(taps)), values])[: -len(taps) - 1 : -1]
    assert window.past[pushed : pushed + len(taps)] == pytest.approx(latest)
    stream.reset()
    assert [stream.process(0.0) for _ in taps] == [0.0] * len(taps)


def test_taps_may_change_between_samples() -> None:
    stream = SampleConvolution(np.array([1.0, 2.0]))
    stream.process(3.0)
    stream.taps = np.array([10.0, 20.0])
    assert stream.process(1.0) == 10.0 + 60.0


# Spectra


def test_the_spectrum_of_white_noise_is_flat() -> None:
    noise = np.random.default_rng(0).normal(0.0, 2.0, 100_000)
    found = measured_spectrum(noise, 1000.0)(np.array([10.0, 100.0, 400.0]))
    assert found == pytest.approx(2 * 4.0 / 1000.0, rel=0.25)


def test_silence_is_taken_for_the_sensors_noise() -> None:
    found = measured_spectrum(np.zeros(4), 1000.0)(np.array([10.0]))
    assert found == pytest.approx(0.0025**2)


def test_the_coupling_holds_the_handle_as_the_grip_does() -> None:
    plant = Plant(coupling=250.0)
    stiffer = Plant(replace(plant.handle, k_u=plant.handle.k_u + 250.0), coupling=0.0)
    assert plant.coupled() == stiffer
    assert plant.coupled().coupled() == stiffer

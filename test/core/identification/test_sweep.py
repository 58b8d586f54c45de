# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Amplitude, ends and band of the sweep."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ALL_AXES, Axes
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.sweep import (
    LIMITED,
    STOPS_HIT,
    IdentificationTrial,
    SweepParameters,
    check_stops,
    check_travel,
    excitation,
    find_trials,
    kept_periods,
    kept_repeats,
    multisine,
    orthogonal_excitation,
    sweep,
    trial_forces,
)
from haptic_accel.core.model import FloatArray, Suspension
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.tick import TravelEstimator
from haptic_accel.core.trial import run_identification
from three_coils import RATE, SWEEP

SHORT = SweepParameters(duration=0.2)

untimed = settings(deadline=None, max_examples=50)


@st.composite
def sweeps(draw: st.DrawFn) -> tuple[SweepParameters, float]:
    """Any sweep of at least ten cycles, and a rate that can carry it."""
    start = draw(st.floats(5.0, 50.0))
    end = start * draw(st.floats(1.5, 20.0))
    parameters = SweepParameters(
        start_frequency=start,
        end_frequency=end,
        duration=draw(st.floats(10.0 / start, 20.0 / start)),
        start_amplitude=draw(st.floats(0.1, 1.0)),
        end_amplitude=draw(st.floats(0.1, 2.0)),
    )
    return parameters, end * draw(st.floats(2.1, 10.0))


# The force


@untimed
@given(sweeps())
def test_the_force_stays_within_its_amplitude_and_is_zero_at_both_ends(
    case: tuple[SweepParameters, float],
) -> None:
    parameters, rate = case
    force = sweep(parameters, rate)
    time = np.arange(len(force)) / rate
    first, last = parameters.start_amplitude, parameters.end_amplitude
    amplitude = first + (last - first) * time / parameters.duration
    assert (np.abs(force) <= amplitude * (1 + 1e-12)).all()
    assert force[0] == 0.0
    assert force[-1] == 0.0


@untimed
@given(sweeps())
def test_its_energy_lies_within_the_band(case: tuple[SweepParameters, float]) -> None:
    parameters, rate = case
    assume(rate > 3 * parameters.end_frequency)  # room above the band
    power = np.abs(np.fft.rfft(sweep(parameters, rate))) ** 2
    frequency = np.fft.rfftfreq(2 * (len(power) - 1), 1 / rate)
    # An octave part beside the band for what any sudden start and end costs.
    inside = (frequency > 0.7 * parameters.start_frequency) & (
        frequency < 1.4 * parameters.end_frequency
    )
    assert power[inside].sum() > 0.95 * power.sum()


def test_the_frequency_grows_by_equal_ratios_in_equal_times() -> None:
    parameters = SweepParameters()
    rate = 100e3
    force = sweep(parameters, rate)
    rising = np.flatnonzero((force[:-1] <= 0) & (force[1:] > 0)) / rate
    middle = (rising[1:] + rising[:-1]) / 2
    expected = 10.0 * 20.0 ** (middle / 2.0)
    assert 1 / np.diff(rising) == pytest.approx(expected, rel=5e-3)


def test_the_papers_sweep_grows_from_0_24_to_1_68_n() -> None:
    force = sweep(SweepParameters(), RATE)
    assert len(force) == 2000
    assert 0.24 < np.abs(force[:100]).max() < 0.24 + 0.72 * 0.1
    assert np.abs(force[-100:]).max() == pytest.approx(1.68, abs=0.06)


def test_repeats_follow_one_another() -> None:
    one, all_of_them = sweep(SHORT, RATE), excitation(SHORT, RATE)
    assert (all_of_them == np.concatenate([one, one, one])).all()
    kept = kept_repeats(all_of_them, SHORT, RATE)
    assert (kept == np.concatenate([one, one])).all()


ABOVE = "must be above start_frequency = 200 Hz"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"start_frequency": 200.0, "end_frequency": 100.0}, f"^end_frequency = 100: {ABOVE}$"),
        ({"start_frequency": 200.0}, f"^end_frequency = 200: {ABOVE}$"),
        (
            {"start_frequency": 0.5, "end_frequency": 1.0, "duration": 1.0},
            "^duration = 1: must hold at least one cycle of the sweep, of 0.5 to 1 Hz$",
        ),
        ({"repeats": 2}, "^repeats = 2: must be a whole number, from 3 to 100$"),
        ({"end_amplitude": 0.0}, "^end_amplitude = 0.0: must be above 0 to 100 N$"),
        ({"duration": math.nan}, "^duration = nan: must be from 0.1 to 60 s$"),
    ],
)
def test_an_impossible_sweep_is_refused(fields: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        SweepParameters(**fields)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (
            lambda: sweep(SweepParameters(), 400.0),
            "^end_frequency = 200: must be below half the rate, 200 Hz$",
        ),
        (lambda: sweep(SWEEP, math.nan), "^rate = nan: must be above 0 Hz$"),
        (lambda: multisine(SweepParameters(end_frequency=600.0), RATE), "end_frequency = 600"),
        (
            lambda: kept_repeats(np.zeros(599), SHORT, RATE),
            "^signal: 599 samples, must be at least 600$",
        ),
        (
            lambda: trial_forces(Axes(("x", "z")), SWEEP, RATE),
            "axes = x, z: must be one, or x, y, z",
        ),
    ],
)
def test_what_cannot_be_carried_or_compared_is_refused(
    act: Callable[[], object], message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        act()


def test_a_coils_lines_have_the_power_of_the_sweep() -> None:
    forces = multisine(SWEEP, RATE)
    assert forces.shape == (1000, 3)
    one = sweep(SWEEP, RATE)
    assert forces.std(axis=0) == pytest.approx(one.std(), rel=0.02)
    assert np.abs(forces).max() < 1.3 * np.abs(one).max()
    frequency = np.fft.rfftfreq(1000, 1 / RATE)
    inside = (frequency >= 8.0) & (frequency <= 450.0)
    lines = np.abs(np.fft.rfft(forces, axis=0))
    assert lines[~inside] == pytest.approx(0.0, abs=1e-9)
    assert lines[inside].min() > 0.05 * lines.max()
    wide = np.abs(np.fft.rfft(one))
    for low, high in ((20, 40), (60, 120), (200, 400)):
        part = (frequency >= low) & (frequency < high)
        power = np.sum(lines[part, 0] ** 2)
        assert power == pytest.approx(np.sum(wide[part] ** 2), rel=0.1)


def test_the_coils_are_orthogonal_at_every_line() -> None:
    spectra = np.fft.rfft(kept_periods(orthogonal_excitation(SWEEP, RATE), SWEEP, RATE), axis=2)
    matrix = spectra[:, 0, 8:451].transpose(1, 2, 0)  # line, coil, realisation
    product = matrix @ matrix.conj().swapaxes(1, 2)
    power = np.abs(product[:, 0, 0])
    assert np.abs(product - power[:, None, None] * np.eye(3)).max() < 1e-9 * power.max()


def test_each_realisation_begins_without_a_jump_and_repeats() -> None:
    force = orthogonal_excitation(SWEEP, RATE)
    assert len(force) == 12_000
    for begin in range(0, 12_000, 3000):
        assert np.abs(force[begin : begin + 5]).max() < 0.05
        assert np.array_equal(force[begin + 1000 : begin + 2000], force[begin + 2000 :][:1000])


def test_the_travel_of_each_coil_is_that_of_the_sweep() -> None:
    actuator = ActuatorParameters()

    def travel(force: FloatArray) -> float:
        estimator = TravelEstimator(actuator, RATE)
        return max(abs(estimator.observe(each, 0.0)) for each in force.tolist())

    most = travel(sweep(SWEEP, RATE))
    for force in orthogonal_excitation(SWEEP, RATE).T:
        assert travel(force) == pytest.approx(most, rel=0.05)
    assert most < 0.7 * actuator.travel


def test_a_handle_with_one_coil_has_the_sweep() -> None:
    (along,) = trial_forces(Axes(("z",)), SWEEP, RATE).T
    assert np.array_equal(along, excitation(SWEEP, RATE))
    assert trial_forces(ALL_AXES, SWEEP, RATE).shape == (12_000, 3)


def recording(trials: int = 2) -> tuple[FloatArray, FloatArray]:
    """Return forces and accelerations of trials with rests between them."""
    wanted = orthogonal_excitation(SWEEP, RATE)
    rest = np.zeros((700, 3))
    force = np.concatenate([rest, *([wanted, rest] * trials)])
    return force, np.random.default_rng(0).normal(0.0, 1.0, force.shape)


def found(force: FloatArray, acceleration: FloatArray) -> list[int]:
    wanted = orthogonal_excitation(SWEEP, RATE)
    trials = find_trials(force, acceleration, SWEEP, RATE, None, 3, wanted)
    assert all(trial.actuator_force.shape == (12_003, 3) for trial in trials)
    assert all(len(trial.aligned.handle_acceleration) == 12_000 for trial in trials)
    return [
        int(np.flatnonzero((acceleration == trial.handle_acceleration[0]).all(axis=1))[0])
        for trial in trials
    ]


def test_trials_are_found_in_a_recording() -> None:
    assert found(*recording()) == [700, 13_400]


def test_another_excitation_and_nan_in_an_axis_are_refused() -> None:
    force, acceleration = recording()
    with pytest.raises(RecordingError, match="actuator_force: correlates"):
        found(force[:, ::-1].copy(), acceleration)
    acceleration[40, 1] = math.nan
    with pytest.raises(RecordingError, match="^axis y: handle_acceleration: holds NaN"):
        found(force, acceleration)


RIG = MasterRigParameters()
TRAVEL = RIG.actuator.travel


def recorded(amplitude: float) -> IdentificationTrial:
    sweep = SweepParameters(duration=1.0, start_amplitude=amplitude)
    return run_identification(RIG, sweep, RATE, latency=0)[0]


def test_stops_that_were_hit_are_refused_and_estimated() -> None:
    gentle, hard = recorded(0.3), recorded(1.5)
    check_stops({"pinch": [gentle]})
    assert check_travel("pinch", gentle, RIG.handle, TRAVEL) == ""
    with pytest.raises(RecordingError, match=r"travel_stops_hit = \d+ \(hook\): must be 0"):
        check_stops({"pinch": [gentle], "hook": [gentle, hard]})
    # A real device does not count them.
    unknown = replace(hard, counters={})
    assert STOPS_HIT in hard.counters
    check_stops({"hook": [unknown]})
    with pytest.raises(RecordingError, match=r"travel = .* mm \(hook\), as estimated: must be"):
        check_travel("hook", unknown, RIG.handle, TRAVEL)


@pytest.mark.parametrize("count", LIMITED)
def test_forces_that_the_device_reduced_are_refused(count: str) -> None:
    trial = IdentificationTrial(RATE, np.zeros(10), np.zeros(10), {count: 3})
    with pytest.raises(RecordingError, match=rf"{count} = 3 \(hook\): must be 0"):
        check_stops({"hook": [trial]})


@given(st.floats(0.1, 2.0))
def test_a_constant_force_travels_by_what_the_spring_gives(share: float) -> None:
    suspension = Suspension()
    force = np.full(2000, share * TRAVEL * suspension.k_s)
    # From rest it swings beyond: damping ratio 0.46.
    ratio = suspension.b_s / (2 * np.sqrt(suspension.k_s * suspension.m_a))
    overshoot = 1 + np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))
    trial = IdentificationTrial(RATE, force, np.zeros(2000), {})
    reached = share * overshoot
    if reached > 1.11:
        with pytest.raises(RecordingError, match="smaller amplitude"):
            check_travel("average", trial, suspension, TRAVEL)
    elif not reached > 1.09 and not 0.945 < reached < 0.955:
        doubt = check_travel("average", trial, suspension, TRAVEL)
        assert bool(doubt) == (reached > 0.95)

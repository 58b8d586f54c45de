# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from haptic_accel.core import model
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.evaluation import Identification, identify_handle

# What responses alone determine, without simulating a friction, which takes most of the time.
from haptic_accel.core.identification.fit import DEFAULT_FREE as OF_RESPONSES
from haptic_accel.core.identification.fit import INTERVAL
from haptic_accel.core.identification.sweep import (
    IdentificationTrial,
    SweepParameters,
    excitation,
    find_trials,
)
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.trial import run_identification
from nightly import rest_slow

RATE = 1000.0
SWEEP = SweepParameters(duration=1.0)
RIG = MasterRigParameters()
SENSOR = RIG.accelerometer


def recorded(rig: MasterRigParameters, trials: int = 1) -> list[IdentificationTrial]:
    return run_identification(rig, SWEEP, RATE, seed=3, trials=trials)


def identify(
    trials: dict[str, list[IdentificationTrial]],
    bandwidth: float = SENSOR.bandwidth,
    **options: Any,
) -> Identification:
    return identify_handle(trials, SWEEP, SENSOR.range, bandwidth, **options)


@pytest.mark.slow
def test_grips_are_fitted_one_by_one_and_together() -> None:
    of_grips = {
        posture: recorded(replace(RIG, grip=model.GripParameters(posture=posture)), trials=2)
        for posture in ("pinch", "hook")
    }
    found = identify(of_grips)
    for posture, grip in found.grips.items():
        true = model.held(RIG.handle, model.GripParameters(posture=posture), seed=0)
        assert grip.fit.handle.m_h == pytest.approx(true.m_h, rel=0.02)
        assert grip.fit.handle.k_u == pytest.approx(true.k_u, rel=0.05)
        assert len(grip.trials) == len(grip.responses) == 2
        inside = (grip.averaged_h1.frequency > 30) & (grip.averaged_h1.frequency < 150)
        assert np.all(grip.averaged_h1.coherence[inside] > 0.8)
        # By definition H1 is H2 times the coherence.
        ratio = np.abs(grip.averaged_h1.response / grip.averaged_h2.response)
        assert ratio == pytest.approx(grip.averaged_h1.coherence)
    # Dry friction, here none, is the bearing's and not the grip's.
    assert found.fit.bearing.friction < 3 * found.fit.standard_errors["friction"]
    pinch, hook = (found.grips[name].fit.handle for name in ("pinch", "hook"))
    assert pinch.m_h < found.fit.handle.m_h < hook.m_h
    assert pinch.k_u < found.fit.handle.k_u < hook.k_u


@pytest.mark.parametrize("latency", rest_slow([1, 0, 20]))
def test_the_delay_found_is_that_of_the_hardware_alone(latency: int) -> None:
    rig = replace(RIG, drive=replace(RIG.drive, delay=150e-6))
    trials = run_identification(rig, SWEEP, RATE, seed=3, latency=latency)
    found = identify({"average": trials}, free=OF_RESPONSES)
    assert found.fit.delay == pytest.approx(150e-6, abs=5e-6)


def test_table_i_lies_in_the_middle_of_the_postures() -> None:
    assert model.POSTURES["average"] == (1.0, 1.0, 1.0)
    assert np.multiply(model.POSTURES["pinch"], model.POSTURES["hook"]) == pytest.approx(1.0)


@pytest.mark.slow
def test_an_actuator_measured_on_the_bench_is_taken_as_measured() -> None:
    handle = model.HandleParameters(m_a=0.03, k_s=500.0)
    trials = {"average": recorded(replace(RIG, handle=handle))}
    found = identify(trials, known=model.HandleParameters(m_a=0.03, k_s=500.0))
    assert found.fit.handle.m_h == pytest.approx(handle.m_h, rel=0.02)
    assert found.fit.handle.m_a == 0.03
    freed = identify(
        trials, known=model.HandleParameters(k_s=500.0), free=("m_a", "b_s", "m_h", "b_u", "delay")
    )
    assert freed.fit.handle.m_a == pytest.approx(0.03, rel=0.05)


def test_no_trial_at_all_is_refused() -> None:
    for nothing in ({}, {"pinch": []}):
        with pytest.raises(ParameterError, match="at least one trial"):
            identify(nothing)


# Loud noise


FULL = SweepParameters()
HANDLE = ("b_s", "m_h", "k_u", "b_u")


def loud(noise: float, corner: float, handle: model.HandleParameters) -> MasterRigParameters:
    """Return a rig with noise of a standard deviation in m/s^2, and a sensor's corner in Hz."""
    density = noise / math.sqrt(math.pi / 2 * corner)
    sensor = replace(SENSOR, bandwidth=corner, noise_density=density)
    return replace(RIG, handle=handle, accelerometer=sensor)


def identified(rig: MasterRigParameters, seed: int) -> Identification:
    """Identify a rig by four trials, with its true actuator and sensor."""
    trials = run_identification(rig, FULL, RATE, seed, trials=4, latency=0)
    known = model.HandleParameters(m_a=rig.handle.m_a, k_s=rig.handle.k_s)
    sensor = rig.accelerometer
    return identify_handle({"average": trials}, FULL, sensor.range, sensor.bandwidth, known=known)


def within_intervals(found: Identification, rig: MasterRigParameters) -> bool:
    """Return whether the 95 % intervals contain the handle and the delay."""
    true = {name: getattr(rig.handle, name) for name in HANDLE} | {"delay": rig.drive.delay}
    fit = found.fit
    return all(
        abs(fit.value(name) - value) <= INTERVAL * fit.standard_errors[name]
        for name, value in true.items()
    )


UNFILTERED = 100e3
"""Corner of a sensor without low-pass at the sampling rate, Hz."""


@pytest.mark.slow
def test_noise_is_not_taken_for_a_mount_nor_for_a_delay() -> None:
    # The response of a sensor without low-pass jumps at whole samples of delay, and the truth lies
    # at a jump.
    handle = model.HandleParameters(
        m_a=0.02041, k_s=224.71, b_s=1.6951, m_h=0.15138, k_u=1638.4, b_u=7.953
    )
    rig = loud(0.95, UNFILTERED, handle)
    found = identified(rig, seed=34)
    assert found.fit.mount.frequency == 0.0
    assert found.fit.delay < 100e-6
    assert within_intervals(found, rig)
    assert found.doubts == []


@pytest.mark.slow
def test_a_mount_is_found_beneath_loud_noise() -> None:
    handle = model.HandleParameters(
        m_a=0.01888, k_s=217.36, b_s=2.9209, m_h=0.11414, k_u=1184.9, b_u=13.169
    )
    mount = model.MountParameters(frequency=298.3, damping=0.1375)
    rig = replace(loud(1.9, 500.0, handle), mount=mount)
    found = identified(rig, seed=28)
    assert found.fit.mount.frequency == pytest.approx(298.3, rel=0.03)
    assert within_intervals(found, rig)


@pytest.mark.slow
def test_two_dampings_that_noise_may_exchange_lie_within_their_intervals() -> None:
    handle = model.HandleParameters(
        m_a=0.02295, k_s=213.74, b_s=1.664, m_h=0.15914, k_u=1681.7, b_u=7.4043
    )
    rig = replace(loud(0.69, UNFILTERED, handle), drive=replace(RIG.drive, delay=40e-6))
    found = identified(rig, seed=59)
    other = found.fit.exchanged()
    for name in ("b_s", "b_u"):
        distance = abs(other.value(name) - found.fit.value(name))
        assert distance <= 1.1 * INTERVAL * found.fit.standard_errors[name]
    assert within_intervals(found, rig)


def test_what_the_sweep_hardly_shows_is_doubtful() -> None:
    # Above its resonance the handle moves as a mass, so the grip's stiffness does not matter.
    sweep = SweepParameters(start_frequency=80.0, duration=1.0)
    rig = loud(1.0, 500.0, RIG.handle)
    trials = {"average": run_identification(rig, sweep, RATE, seed=1, trials=2, latency=0)}
    try:
        found = identify_handle(trials, sweep, SENSOR.range, 500.0, free=OF_RESPONSES)
    except RecordingError as refusal:
        assert "at a limit of the search" in str(refusal)
    else:
        assert any("k_u = " in doubt for doubt in found.doubts)


def test_a_model_that_lacks_something_is_doubtful() -> None:
    trials = {"average": recorded(RIG)}
    found = identify(trials, bandwidth=50.0, free=HANDLE)
    assert any("the model lacks something" in doubt for doubt in found.doubts)


# Glitches


def with_glitches(
    trials: list[IdentificationTrial], count: int, seed: int = 0
) -> list[IdentificationTrial]:
    """Return trials with false samples, larger than any acceleration, at random places."""
    random = np.random.default_rng(seed)
    glitched = []
    for trial in trials:
        acceleration = trial.handle_acceleration.copy()
        places = 20 + random.choice(len(acceleration) // 40 - 2, count, replace=False) * 40
        acceleration[places] += random.choice((-1.0, 1.0), count) * random.uniform(500, 5e3, count)
        glitched.append(replace(trial, handle_acceleration=acceleration))
    return glitched


def test_glitches_are_replaced_and_counted() -> None:
    clean = recorded(RIG, trials=2)
    sound, mended = (
        identify({"pinch": trials}, free=OF_RESPONSES)
        for trials in (clean, with_glitches(clean, 7))
    )
    assert sound.outliers == []
    samples = 2 * len(clean[0].aligned.handle_acceleration)
    assert mended.outliers == [
        f"pinch: 14 of {samples} samples of handle_acceleration are outliers: replaced by"
        " interpolation"
    ]
    for name, error in sound.fit.standard_errors.items():
        assert abs(mended.fit.value(name) - sound.fit.value(name)) < 3 * error


def test_many_glitches_are_refused() -> None:
    trials = {"pinch": with_glitches(recorded(RIG), 60)}
    with pytest.raises(RecordingError, match="60 of 3000 samples are outliers: must be at most 1"):
        identify(trials)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_trials_are_found_where_the_force_looks_like_the_sweep(noise: float) -> None:
    force = excitation(SWEEP, RATE)
    random = np.random.default_rng(0)
    starts = [700, 700 + len(force) + 1234]
    whole = noise * random.standard_normal(starts[-1] + len(force) + 99)
    for start in starts:
        whole[start : start + len(force)] += force
    acceleration = np.arange(len(whole), dtype=float)
    found = find_trials(whole, acceleration, SWEEP, RATE)
    assert [trial.handle_acceleration[0] for trial in found] == starts
    assert all(len(trial.actuator_force) == len(force) for trial in found)
    # With a latency, each force belongs to an acceleration as many samples later.
    late = [trial.aligned for trial in find_trials(whole, acceleration, SWEEP, RATE, latency=4)]
    assert [trial.handle_acceleration[0] for trial in late] == [start + 4 for start in starts]
    assert all(len(trial.handle_acceleration) == len(force) for trial in late)
    for trial, same in zip(late, found, strict=True):
        assert np.array_equal(trial.actuator_force, same.actuator_force)


@pytest.mark.parametrize(
    ("force", "reason"),
    [
        (np.zeros(9000), "correlates"),
        (1e-12 * excitation(SWEEP, RATE), "correlates"),
        (excitation(replace(SWEEP, end_frequency=300.0), RATE), "correlates"),
        (excitation(SWEEP, RATE)[:-1], "must be at least 3000"),
        (np.full(9000, np.nan), "NaN"),
    ],
)
def test_a_recording_without_the_sweep_is_refused(force: np.ndarray, reason: str) -> None:
    with pytest.raises(RecordingError, match=reason):
        find_trials(force, np.zeros(len(force)), SWEEP, RATE)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion against theory and against the virtual rig, which has a friction of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.handle.mechanics import RIGID, sampled_response
from haptic_accel.core.identification.evaluation import identify_handle
from haptic_accel.core.identification.fit import Friction, HandleFit, Point
from haptic_accel.core.identification.motion import simulated
from haptic_accel.core.identification.sweep import SweepParameters, excitation
from haptic_accel.core.model import (
    AccelerometerParameters,
    FloatArray,
    GripParameters,
    HandleParameters,
    MountParameters,
    held,
)
from haptic_accel.core.rig.master_rig import DriveParameters, MasterRigParameters
from haptic_accel.core.trial import run_identification
from nightly import rest_slow

RATE = 1000.0
SWEEP = SweepParameters()
SHORT = SweepParameters(duration=1.0)
TABLE_I = HandleParameters()
CORNER = 500.0  # Hz
PAPER = MasterRigParameters(
    mount=MountParameters(frequency=290.0, damping=0.11),
    drive=DriveParameters(delay=110e-6, coulomb_friction=0.036),
)
IDEAL = MasterRigParameters(
    accelerometer=AccelerometerParameters(bandwidth=100e3, noise_density=0.00017)  # 0.07 m/s^2
)
LARGEST = {"m_h": 0.01, "k_u": 0.03, "b_u": 0.05, "b_s": 0.08}  # relative errors
LARGEST_DELAY_ERROR = 15e-6  # s
HALF_INTERVAL = 1.96  # standard errors, of 95 %


def settled(force: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return frequency, and force and acceleration of the last repeat as spectra."""
    samples = len(force) // SHORT.repeats
    lines = np.fft.rfftfreq(samples, 1 / RATE)[10:200]
    return lines, np.fft.rfft(force[-samples:])[10:200], np.fft.rfft(moved[-samples:])[10:200]


@settings(deadline=None, max_examples=10)
@given(st.floats(-0.5e-3, 3e-3), st.floats(0.07, 0.3), st.sampled_from([0.0, 180.0, 290.0]))
def test_without_friction_it_is_the_response(delay: float, m_h: float, mount: float) -> None:
    handle, accelerometer = replace(TABLE_I, m_h=m_h), MountParameters(mount)
    force = excitation(SHORT, RATE)
    point = Point(handle, accelerometer, delay, CORNER, Friction())
    (moved,) = simulated([point], force, RATE)
    frequency, given_force, found = settled(force, moved)
    expected = given_force * sampled_response(
        handle, frequency, RATE, delay, CORNER, accelerometer
    )
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_an_actuator_that_sticks_moves_nothing() -> None:
    # Its force acts between two masses that friction holds together.
    point = Point(TABLE_I, RIGID, 0.0, CORNER, Friction(100.0, 1e-6))
    (moved,) = simulated([point], excitation(SHORT, RATE), RATE)
    assert np.abs(moved).max() < 0.01


@pytest.mark.parametrize("friction", [0.01, 0.06])
def test_friction_acts_as_in_the_rig(friction: float) -> None:
    drive = replace(PAPER.drive, coulomb_friction=friction)
    quiet = replace(PAPER.accelerometer, noise_density=0.0)
    (trial,) = run_identification(
        replace(PAPER, drive=drive, accelerometer=quiet), SHORT, RATE, latency=0
    )
    rubbing, free = (
        simulated(
            [Point(TABLE_I, PAPER.mount, 110e-6, CORNER, Friction(force))],
            trial.actuator_force,
            RATE,
        )[0]
        for force in (friction, 0.0)
    )
    lacking = np.std(trial.handle_acceleration - free)
    assert np.std(trial.handle_acceleration - rubbing) < 0.25 * lacking


# Fits


def identified(
    rig: MasterRigParameters, seed: int, sweep: SweepParameters, trials: int
) -> tuple[HandleFit, HandleParameters]:
    """Identify the handle as one user holds it; return the fit and the true handle."""
    handle = held(rig.handle, GripParameters(variation=0.15), seed)
    recorded = run_identification(replace(rig, handle=handle), sweep, RATE, seed, trials)
    sensor = rig.accelerometer
    found = identify_handle({"average": recorded}, sweep, sensor.range, sensor.bandwidth)
    return found.fit, handle


def errors(fit: HandleFit, rig: MasterRigParameters, handle: HandleParameters) -> FloatArray:
    """Return the error of each parameter in standard errors."""
    true = {name: getattr(handle, name) for name in LARGEST}
    true |= {"delay": rig.drive.delay, "friction": rig.drive.coulomb_friction}
    return np.array([(fit.value(n) - v) / fit.standard_errors[n] for n, v in true.items()])


def check_errors(fit: HandleFit, rig: MasterRigParameters, handle: HandleParameters) -> None:
    """Hold a fit against what is promised."""
    for name, largest in LARGEST.items():
        assert fit.value(name) == pytest.approx(getattr(handle, name), rel=largest), name
    assert fit.delay == pytest.approx(rig.drive.delay, abs=LARGEST_DELAY_ERROR)


@pytest.mark.parametrize("friction", rest_slow([0.06, 0.0]))
def test_friction_is_found_with_the_handle(friction: float) -> None:
    rig = replace(PAPER, drive=replace(PAPER.drive, coulomb_friction=friction))
    fit, handle = identified(rig, seed=5, sweep=SHORT, trials=2)
    check_errors(fit, rig, handle)
    assert fit.bearing.friction == pytest.approx(friction, abs=0.003)
    assert (np.abs(errors(fit, rig, handle)) < 2 * HALF_INTERVAL).all()


@pytest.mark.slow
def test_a_friction_that_is_not_as_expected_is_allowed_for() -> None:
    drive = replace(PAPER.drive, slip_velocity=0.02)
    rig = replace(PAPER, drive=drive)
    fit, handle = identified(rig, seed=5, sweep=SHORT, trials=2)
    check_errors(fit, rig, handle)
    # Only its own force is another matter: it is reached at ten times the slip velocity.
    assert (np.abs(errors(fit, rig, handle))[:-1] < 2 * HALF_INTERVAL).all()


@pytest.mark.slow
@pytest.mark.parametrize("rig", [PAPER, IDEAL], ids=["paper", "ideal"])
def test_intervals_cover_the_truth_for_most_users(rig: MasterRigParameters) -> None:
    scaled = []
    for seed in range(10):
        fit, handle = identified(rig, seed, SWEEP, trials=4)
        check_errors(fit, rig, handle)
        scaled.append(errors(fit, rig, handle))
    covered = np.abs(scaled) < HALF_INTERVAL
    assert covered.mean() >= 0.85

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The discrete model against the rig, against known filters, and its stability."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from haptic_accel.core.handle.mechanics import sampled_response
from haptic_accel.core.handle.plant import DiscreteModel
from haptic_accel.core.identification.estimate import RecordingError, identify_discrete
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import FloatArray, HandleParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.trial import run_identification

RATE = 1000.0
FREQUENCY = np.linspace(15.0, 400.0, 300)
FORCE = np.random.default_rng(0).normal(0.0, 1.0, 4000)


def radius(model: DiscreteModel) -> float:
    """Largest radius of a pole."""
    return max(float(np.abs(np.roots(section[3:])).max()) for section in model.sections)


def acceleration(model: DiscreteModel, force: FloatArray) -> FloatArray:
    """Return a model's response to a force from rest, m/s^2."""
    delayed = np.concatenate([np.zeros(model.delay_samples), force])[: len(force)]
    return np.asarray(signal.sosfilt(model.sections, delayed))


@pytest.mark.parametrize("seed", [0, 1])
def test_the_rig_is_reproduced(seed: int) -> None:
    parameters = SweepParameters(end_frequency=450.0)
    (trial,) = run_identification(MasterRigParameters(), parameters, RATE, seed, latency=0)
    model = identify_discrete(trial.actuator_force, trial.handle_acceleration, 5, RATE)
    ratio = model.response(FREQUENCY) / sampled_response(HandleParameters(), FREQUENCY, RATE)
    # A tenth of what is asked for, 1 dB and 5 degrees.
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 0.1
    assert np.abs(np.degrees(np.angle(ratio))).max() < 0.5
    assert radius(model) < 1.0
    rest = trial.handle_acceleration - acceleration(model, trial.actuator_force)
    assert rest.std() == pytest.approx(MasterRigParameters().accelerometer.noise, rel=0.05)


@settings(deadline=None, max_examples=6)
@given(st.integers(1, 7), st.floats(20.0, 400.0))
def test_a_known_filter_comes_back(order: int, corner: float) -> None:
    sections = np.asarray(signal.butter(order, corner, "highpass", fs=RATE, output="sos"))
    known = DiscreteModel(sections, RATE, 1)
    found = identify_discrete(FORCE, acceleration(known, FORCE), order, RATE)
    error = found.response(FREQUENCY) - known.response(FREQUENCY)
    assert np.abs(error).max() < 0.01


@pytest.mark.parametrize("order", [2, 5])
def test_a_plant_that_grows_gives_a_stable_model(order: int) -> None:
    unstable = signal.lfilter([0.0, 1.0], [1.0, -1.001], FORCE)
    model = identify_discrete(FORCE, unstable, order, RATE)
    assert radius(model) < 1.0
    assert np.isfinite(model.response(FREQUENCY)).all()


def test_an_offset_of_the_sensor_does_no_harm() -> None:
    sections = np.asarray(signal.butter(2, [20.0, 200.0], "bandpass", fs=RATE, output="sos"))
    known = DiscreteModel(sections, RATE, 1)
    found = identify_discrete(FORCE, acceleration(known, FORCE) + 9.81, 4, RATE)
    assert np.abs(found.response(FREQUENCY) - known.response(FREQUENCY)).max() < 0.01


def bad(force: FloatArray, value: float) -> FloatArray:
    spoilt = force.copy()
    spoilt[3] = value
    return spoilt


@pytest.mark.parametrize(
    ("force", "acceleration", "message"),
    [
        (FORCE, FORCE[1:], "actuator_force and handle_acceleration: have 4000 and 3999 samples"),
        (FORCE, bad(FORCE, math.nan), "handle_acceleration: holds NaN or infinity"),
        (0 * FORCE, FORCE, "actuator_force: is constant, which identifies nothing$"),
        (FORCE, 0 * FORCE, "handle_acceleration: is constant, which identifies nothing$"),
        (FORCE[:110], FORCE[:110], "recording: 110 samples, must be at least 111 for order 5$"),
    ],
)
def test_a_bad_recording_is_refused(
    force: FloatArray, acceleration: FloatArray, message: str
) -> None:
    with pytest.raises(RecordingError, match="^" + message):
        identify_discrete(force, acceleration, 5, RATE)


@pytest.mark.parametrize(
    ("order", "rate", "message"),
    [
        (0, RATE, "order = 0: must be from 1 to 40"),
        (41, RATE, "order = 41: must be from 1 to 40"),
        (5, 0.0, "rate = 0.0: must be above 0 Hz"),
    ],
)
def test_an_impossible_argument_is_refused(order: int, rate: float, message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}$"):
        identify_discrete(FORCE, FORCE, order, rate)

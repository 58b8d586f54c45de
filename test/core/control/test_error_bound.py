# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bound within limits of travel and force against what theory says of it."""

from __future__ import annotations

import numpy as np
import pytest
from band_noise import band_noise
from scipy import signal

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.error_bound import bounds, causal_bound
from haptic_accel.core.control.inversion import measured_spectrum
from haptic_accel.core.handle.mechanics import travel_response
from haptic_accel.core.handle.plant import DiscreteModel, IdentifiedPlant, Plant
from haptic_accel.core.model import FloatArray, MountParameters, handle_model
from haptic_accel.core.tick import CUSHION_END
from nightly import rest_slow

RATE = 1000.0
IDEAL = Plant().coupled().delayed(1)
WIDE = ActuatorParameters(travel=0.1)
LATE = Plant(mount=MountParameters(280.0, 0.127), delay=225e-6).coupled().delayed(1)


def texture(low: float, rms: float) -> FloatArray:
    """Return 4 s of noise between a frequency in Hz and six times it, m/s^2."""
    return band_noise(low, min(400.0, 6 * low), 4.0, rms, seed=3)


@pytest.mark.parametrize("low", [8.0, 30.0])
def test_a_small_input_has_no_limits(low: float) -> None:
    small = texture(low, 0.5)
    free = causal_bound(IDEAL, RATE, measured_spectrum(small, RATE), granted_delay=2)
    assert bounds(IDEAL, RATE, small, granted_delay=2).limited == pytest.approx(free, abs=0.1)


@pytest.mark.parametrize("granted", [1, 2, 3])
def test_without_limits_it_is_the_bound_of_all_causal_filters(granted: int) -> None:
    quiet = texture(30.0, 1e-2)
    free = causal_bound(LATE, RATE, measured_spectrum(quiet, RATE), granted_delay=granted)
    found = bounds(LATE, RATE, quiet, granted_delay=granted, actuator=WIDE).limited
    assert found == pytest.approx(free, abs=0.6)  # which needs motion below 0.2 Hz


@pytest.mark.parametrize("low", rest_slow([8.0, 15.0]))
def test_a_larger_input_costs_more_error_and_never_less_than_without_limits(low: float) -> None:
    errors = []
    for rms in (1.0, 4.0, 12.0, 40.0, 200.0):
        loud = texture(low, rms)
        errors.append(bounds(IDEAL, RATE, loud, granted_delay=2).limited)
        free = causal_bound(IDEAL, RATE, measured_spectrum(loud, RATE), granted_delay=2)
        assert errors[-1] >= free
    assert np.all(np.diff(errors) > -0.1)  # a larger input stands out of the sensor's noise
    assert errors[-1] == pytest.approx(100.0, abs=10.0)  # hardly anything can be displayed


def test_an_input_that_is_cut_out_of_another_has_the_same_bound() -> None:
    # Wherever it is cut, even where its acceleration is far from its mean.
    whole = texture(15.0, 3.0) + 5.0
    whole_bound = bounds(IDEAL, RATE, whole, granted_delay=2).limited
    for begin in (500, 507, 514, 521):
        found = bounds(IDEAL, RATE, whole[begin:], granted_delay=2).limited
        assert found == pytest.approx(whole_bound, abs=0.2)


def test_less_travel_costs_more_error() -> None:
    loud = texture(8.0, 4.0)
    errors = [
        bounds(
            LATE, RATE, loud, granted_delay=2, actuator=ActuatorParameters(travel=travel)
        ).limited
        for travel in (3.8e-3, 2.5e-3, 1.3e-3)
    ]
    assert errors == sorted(errors)
    assert errors[0] < errors[-1] - 20.0


@pytest.mark.parametrize("share", [0.9, 0.5, 0.2])
def test_of_a_sine_the_travel_leaves_what_fits_into_it(share: float) -> None:
    # A sine can only be made smaller: the error is the part of it that is missing.
    plant, frequency, limit = Plant(), np.array([20.0]), 2e-3
    travel = travel_response(plant.handle, frequency) / handle_model(plant.handle).response(
        frequency
    )
    amplitude = limit / share / float(np.abs(travel[0]))
    time = np.arange(8000) / RATE
    fading_in = np.clip(time / 2.0, 0.0, 1.0)
    sine = fading_in * amplitude * np.sin(2 * np.pi * frequency[0] * time)
    passed = float(
        np.abs(
            signal.freqz_sos(
                signal.butter(4, 15.0, "high", fs=RATE, output="sos"), frequency, fs=RATE
            )[1][0]
        )
    )
    actuator = ActuatorParameters(travel=limit / CUSHION_END)
    found = bounds(plant, RATE, sine / passed, actuator=actuator).limited
    assert found == pytest.approx(100.0 * (1.0 - share), abs=4.0)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1])
def test_a_plant_without_dynamics_lacks_the_force_above_the_peak(share: float) -> None:
    # Handle = gain x force one sample later: the best filter divides by the gain, and what the
    # peak of the force leaves of it is the same for all frequencies.
    gain = 2.0
    plant = IdentifiedPlant(DiscreteModel(np.array([[gain, 0, 0, 1.0, 0, 0]]), RATE, 1))
    # Small, so that travel is no limit.
    noise = 1e-2 * np.random.default_rng(1).standard_normal(6000)
    noise[0] = 0.0
    needed = float(np.abs(noise).max()) / gain
    actuator = ActuatorParameters(peak_force=share * needed, travel=0.1)
    found = bounds(plant, RATE, noise, high_pass_frequency=0.01, actuator=actuator).limited
    assert found == pytest.approx(100.0 * (1.0 - share), abs=2.0)

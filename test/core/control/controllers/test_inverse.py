# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The inverse as a controller: its parameters, its samples, and a rig that follows it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from haptic_accel.core import model
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.compensation import LARGEST_ACCELERATION
from haptic_accel.core.control.controllers import Loop
from haptic_accel.core.control.controllers.fixed import InverseController, InverseParameters
from haptic_accel.core.control.filters import high_pass
from haptic_accel.core.control.inversion import (
    SENSOR_DENSITY,
    Goal,
    design_inverse,
    measured_spectrum,
    predict,
)
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.rig.master_rig import (
    DriveParameters,
    ExplorationParameters,
    MasterRigParameters,
)
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.tick.control import SLIP_VELOCITY, FrictionCompensation, SampleFilter
from haptic_accel.core.trial import Trial, run_trial
from nightly import rest_slow

RATE = 1000.0
SILENT = model.AccelerometerParameters(noise_density=0.0, bits=32)
MOUNT = model.MountParameters(280.0, 0.127)
STILL = ExplorationParameters(stroke_speed=0.0, press_depth=0.0, height=0.0)
"""Without the hand's own motion, the handle does what the actuator makes it do."""

UNLIMITED = ActuatorParameters(travel=0.1, continuous_force=100.0)


def texture(rate: float, seconds: float = 4.0) -> model.FloatArray:
    """Noise from 60 to 200 Hz, 1.5 m/s^2 RMS."""
    random = np.random.default_rng(1)
    count = round(seconds * rate)
    lines = np.fft.rfft(random.normal(size=count))
    frequency = np.fft.rfftfreq(count, 1 / rate)
    lines[(frequency < 60.0) | (frequency > 200.0)] = 0.0
    values = np.fft.irfft(lines, count)
    return 1.5 * values / values.std()


def follow(
    controller: str,
    rate: float = RATE,
    mount: model.MountParameters | None = None,
    delay: float = 0.0,
    latency: int = LATENCY,
) -> tuple[Trial, Plant]:
    mount = mount or model.MountParameters()
    master = MasterRigParameters(
        mount=mount,
        drive=DriveParameters(delay=delay, bits=32),
        accelerometer=SILENT,
        exploration=STILL,
    )
    plant = Plant(mount=mount, delay=delay)
    trial = run_trial(
        controller,
        RigParameters(master=master),
        duration=4.0,
        rate=rate,
        latency=latency,
        recording=texture(rate),
        controllers={"plant": plant, "actuator": UNLIMITED},
    )
    return trial, plant


def error(trial: Trial) -> float:
    """Return the error in %, after low frequencies have been let in."""
    return trial.evaluate(round(trial.rate)).nrmse_percent


@pytest.mark.parametrize(("rate", "latency"), [(1000.0, 0), (1000.0, 3), (4000.0, 1)])
@pytest.mark.parametrize(("mount", "delay"), [(model.MountParameters(), 0.0), (MOUNT, 225e-6)])
def test_a_rig_without_noise_follows_as_predicted(
    rate: float, latency: int, mount: model.MountParameters, delay: float
) -> None:
    trial, plant = follow("inverse", rate, mount, delay, latency)
    plant = plant.coupled().delayed(latency)
    measured = measured_spectrum(trial.tool_acceleration, rate)
    # Here the tool's sensor is silent, so that what is taken for its noise is none.
    expected = predict(
        InverseParameters().filter(Loop(rate, plant=plant)),
        plant,
        lambda f: measured(f) - SENSOR_DENSITY**2,
    )
    # The slave at the other end of the coupling is not quite at rest.
    assert error(trial) == pytest.approx(expected.nrmse_percent, rel=0.15, abs=1.0)
    assert np.std(trial.actuator_force) == pytest.approx(expected.force_rms, rel=0.05)
    assert error(trial) < 20.0


@pytest.mark.parametrize("rate", rest_slow([1000.0, 4000.0]))
def test_it_is_far_better_than_the_papers_controllers(rate: float) -> None:
    inverse = error(follow("inverse", rate)[0])
    assert inverse < 0.5 * min(error(follow(name, rate)[0]) for name in ("constant", "dynamic"))


@pytest.mark.parametrize("rate", rest_slow([50.0, 1000.0, 4000.0, 20000.0], now=3))
def test_samples_give_what_the_filters_response_says(rate: float) -> None:
    parameters = InverseParameters(memory=0.1)
    loop = Loop(rate)
    controller, inverse = InverseController(parameters, loop), parameters.filter(loop)
    frequency = rate / 8
    # What is desired has passed the high-pass; four seconds until it has settled, then whole
    # periods.
    passed = SampleFilter(high_pass(15.0, rate))
    settle = 8 * round(rate / 2)
    tone = [passed.process(math.cos(math.pi / 4 * index)) for index in range(settle + 400)]
    forces = [controller.force(value, 0.0) for value in tone]
    turns = np.exp(-1j * math.pi / 4 * np.arange(settle, settle + 400))
    gain = 2.0 / 400 * np.dot(np.asarray(forces[settle:]), turns)
    high_passed_gain = signal.freqz_sos(high_pass(15.0, rate), [frequency], fs=rate)[1]
    expected = inverse.response([frequency]) * high_passed_gain
    assert gain == pytest.approx(complex(expected[0]), rel=1e-3)


def test_reset_forgets_the_past() -> None:
    controller, fresh = (InverseController(InverseParameters(), Loop(RATE)) for _ in range(2))
    for index in range(300):
        controller.force(math.sin(index), 0.0)
    controller.reset()
    for each in (controller, fresh):
        assert [each.force(0.0, 0.0) for _ in range(300)] == [0.0] * 300
    for index in range(300):
        expected = fresh.force(float(index), 0.0)
        # The ring stands elsewhere, and with it the order in which the products are added.
        assert controller.force(float(index), 0.0) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(max_examples=30)
@given(
    st.sampled_from([1000.0, 4000.0]),
    st.lists(st.floats(-LARGEST_ACCELERATION, LARGEST_ACCELERATION), max_size=50),
)
def test_any_acceleration_gives_a_finite_force_that_dies_away(
    rate: float, desired: list[float]
) -> None:
    passed, controller = SampleFilter(high_pass(15.0, rate)), CONTROLLED[rate]
    controller.reset()
    forces = [controller.force(passed.process(value), 0.0) for value in desired]
    later = [controller.force(passed.process(0.0), 0.0) for _ in range(round(4 * rate))]
    assert np.isfinite(forces).all()
    total = sum(map(abs, desired))
    assert np.abs(later).max() <= 1.0 * total + 1e-9
    assert np.abs(later[-100:]).max() <= 1e-5 * total + 1e-9


CONTROLLED = {
    rate: InverseController(InverseParameters(), Loop(rate)) for rate in (1000.0, 4000.0)
}


# Parameters


def test_its_parameters_have_dotted_names() -> None:
    names = set(schema(InverseParameters, "inverse."))
    assert names == {
        "inverse.granted_time",
        "inverse.texture.rise",
        "inverse.memory",
        "inverse.texture.fall",
    }


def test_a_rate_too_low_for_the_high_pass_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^rate = 25: must be above twice high_pass_freq"):
        InverseController(InverseParameters(), Loop(25.0))


def test_plant_and_high_pass_are_the_loops() -> None:
    plant = Plant(mount=MOUNT, delay=2e-4)
    found = InverseParameters().filter(Loop(RATE, 30.0, plant))
    expected = design_inverse(plant, RATE, Goal(high_pass_frequency=30.0))
    assert found.taps == pytest.approx(expected.taps)
    assert found.goal.high_pass_frequency == 30.0


def test_its_metric_is_the_trials() -> None:
    # What the handle did is compared as it is, but for what no texture has.
    trial, _ = follow("inverse")
    assert trial.actual_acceleration[100:-100] == pytest.approx(
        trial.handle_acceleration[100:-100], abs=0.02 * np.std(trial.handle_acceleration)
    )


HANDLE = model.HandleParameters()


def test_without_friction_it_gives_nothing() -> None:
    compensation = FrictionCompensation(HANDLE, 0.0, RATE)
    assert [compensation.force(f, 1.0) for f in (1.0, -3.0, 0.5)] == [0.0] * 3


def test_it_pushes_the_way_the_actuator_slips() -> None:
    friction, frequency, force = 0.05, 100.0, 0.5
    compensation = FrictionCompensation(HANDLE, friction, RATE)
    omega = 2 * math.pi * frequency
    given = []
    for index in range(2000):
        given.append(compensation.force(force * math.sin(omega * index / RATE), 0.0))
    late = np.array(given[1000:])
    # By eq. (1) with the handle at rest, its amplitude of slip is F w / |k_s - m_a w^2 + i b_s w|.
    slip = force * omega / abs(HANDLE.k_s - HANDLE.m_a * omega**2 + 1j * HANDLE.b_s * omega)
    assert slip > 10 * SLIP_VELOCITY
    assert np.abs(late).max() == pytest.approx(friction, rel=0.01)
    # Above its resonance a mass moves against its spring: f_a pulls it to the handle, so that its
    # speed lags the force by more than a quarter turn, and what helps it leads by less.
    spectrum = np.fft.rfft(late)[round(frequency * len(late) / RATE)]
    driven = np.fft.rfft([force * math.sin(omega * i / RATE) for i in range(1000, 2000)])
    phase = np.angle(spectrum / driven[round(frequency * len(late) / RATE)])
    mechanics = 1j * omega / (HANDLE.k_s - HANDLE.m_a * omega**2 + 1j * HANDLE.b_s * omega)
    # The middle of the sample that the force is held for.
    expected = np.angle(mechanics)
    assert math.remainder(float(phase - expected), 2 * math.pi) == pytest.approx(0.0, abs=0.2)


def test_a_handle_that_lags_slips_when_it_does_as_desired() -> None:
    desired = np.random.default_rng(0).normal(0.0, 5.0, 60)
    before = np.concatenate([np.zeros(3), desired])
    late = (before[:-3] + before[1:-2]) / 2  # two and a half samples
    told = FrictionCompensation(HANDLE, 0.05, RATE, lag=2.5)
    shown = FrictionCompensation(HANDLE, 0.05, RATE)
    for wanted, moved in zip(desired.tolist(), late.tolist(), strict=True):
        assert told.force(0.2, wanted) == pytest.approx(shown.force(0.2, moved))


def test_at_rest_it_gives_next_to_nothing() -> None:
    compensation = FrictionCompensation(HANDLE, 0.05, RATE)
    random = np.random.default_rng(0)
    # Noise of the tool's accelerometer, and the force that it makes.
    given = [compensation.force(0.01 * a, a) for a in random.normal(0, 0.07, 1000).tolist()]
    assert np.abs(given).max() < 0.05 / 3


@pytest.mark.parametrize("controller", ["inverse", "adaptive"])
@pytest.mark.slow
def test_on_a_rig_with_friction_it_takes_most_of_the_error_that_friction_makes(
    controller: str,
) -> None:
    rig = RigParameters()
    dry = replace(rig.master, drive=DriveParameters(coulomb_friction=0.05, bits=32))

    def error(master: object, friction: float) -> float:
        trial = run_trial(
            controller,
            replace(rig, master=master),  # type: ignore[arg-type]
            duration=4.0,
            recording=texture(RATE),
            controllers={"plant": Plant(friction=friction)},
        )
        return trial.evaluate(2000).nrmse_percent

    without, ignored, given = error(rig.master, 0.0), error(dry, 0.0), error(dry, 0.05)
    assert without < given < ignored
    assert given - without < 0.6 * (ignored - without)


def test_reset_forgets_the_slip() -> None:
    used, fresh = (FrictionCompensation(HANDLE, 0.05, RATE) for _ in range(2))
    used.force(3.0, 5.0)
    used.reset()
    assert used.force(0.1, 0.0) == fresh.force(0.1, 0.0)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protection of the actuator: peak and heat for any command, travel on the simulated rig."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core import model
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.identification.sweep import SweepParameters, excitation
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import (
    DriveParameters,
    ExplorationParameters,
    MasterRig,
    MasterRigParameters,
)
from haptic_accel.core.tick import CUSHION, CUSHION_END, ActuatorGuard, TravelEstimator

RATE = 1000.0
RATES = [1000.0, 4000.0]
COIL = ActuatorParameters()
PEAK_FORCE, CONTINUOUS_FORCE, TRAVEL = COIL.peak_force, COIL.continuous_force, COIL.travel
STILL = ExplorationParameters(stroke_speed=0.0, press_depth=0.0, height=0.0)
SENSOR_RANGE = 5 * model.GRAVITY

forces = st.lists(
    st.one_of(st.floats(-10.0, 10.0), st.floats(-1e300, 1e300), st.just(PEAK_FORCE)),
    min_size=1,
    max_size=100,
)
handle_accelerations = st.floats(-1e4, 1e4)


def guard(actuator: ActuatorParameters = COIL, rate: float = RATE) -> ActuatorGuard:
    return ActuatorGuard(actuator, rate)


def limited(guard: ActuatorGuard, force: float, handle: float = 0.0) -> float:
    """Return the force that acts until the next sample for a requested one, N."""
    force = guard.within(force, handle)
    guard.advance(force, handle)
    return force


def wide(**limits: float) -> ActuatorParameters:
    """Return an actuator of so much travel that it is no limit."""
    return ActuatorParameters(travel=0.1, **limits)


def alternating(force: float, count: int) -> list[float]:
    """Return a force that heats, and moves next to nothing."""
    return [force * (-1.0) ** index for index in range(count)]


# Peak and heat


@given(
    requested=forces,
    repeats=st.integers(1, 5),
    handle=handle_accelerations,
    actuator=st.builds(
        ActuatorParameters,
        peak_force=st.one_of(st.just(0.0), st.floats(1e-3, 100.0)),
        continuous_force=st.one_of(st.just(0.0), st.floats(0.0, 100.0)),
        thermal_time=st.floats(0.01, 20.0),
        travel=st.floats(1e-6, 0.1),
    ),
    rate=st.floats(31.0, 20e3),
)
def test_no_command_overheats_the_coil_or_exceeds_its_peak(
    requested: list[float], repeats: int, handle: float, actuator: ActuatorParameters, rate: float
) -> None:
    coil = ActuatorGuard(actuator, rate)
    bearable = min(actuator.peak_force, actuator.continuous_force) ** 2
    heat, weight = 0.0, -math.expm1(-1 / (rate * actuator.thermal_time))
    for force in requested * repeats:
        applied = limited(coil, force, handle)
        assert abs(applied) <= actuator.peak_force
        heat += weight * (applied**2 - heat)
        assert heat <= bearable * (1 + 1e-9)
    assert coil.heat_share() == pytest.approx(heat / bearable if bearable else 0.0)
    assert coil.heat_share() <= 1 + 1e-9


def test_a_cold_coil_gives_its_peak() -> None:
    cold = guard(wide())
    # A tenth of what it bears takes 10 s x 0.1 x (2.2 / 6.6)^2 of the peak.
    requested = alternating(PEAK_FORCE, 110)
    assert [limited(cold, force) for force in requested] == requested
    assert (cold.heated, cold.saturated) == (0, 0)
    assert 0.09 < cold.heat_share() < 0.1


def test_the_continuous_force_is_free_for_ever() -> None:
    warm = guard(wide(thermal_time=0.1))
    requested = alternating(CONTINUOUS_FORCE, 20_000)
    assert [limited(warm, force) for force in requested] == requested
    assert warm.heated == 0
    assert warm.heat_share() == pytest.approx(1.0)


def test_a_warm_coil_gives_what_it_bears_and_cools_again() -> None:
    coil = guard(wide(thermal_time=0.1))
    applied = [limited(coil, force) for force in alternating(PEAK_FORCE, 2000)]
    assert np.abs(applied[-100:]) == pytest.approx(CONTINUOUS_FORCE, rel=1e-3)
    assert coil.heated > 1900
    for _ in range(300):
        limited(coil, 0.0)
    assert limited(coil, PEAK_FORCE) == PEAK_FORCE


@pytest.mark.parametrize("share", [0.0, 0.1, 0.101, 0.5, 0.99, 1.0, 1.1])
def test_the_heat_of_the_permitted_force_falls_evenly_as_the_coil_warms_up(share: float) -> None:
    coil = guard()
    coil.heat = share * CONTINUOUS_FORCE**2
    permitted = np.interp(share, [0.1, 1.0], [PEAK_FORCE**2, CONTINUOUS_FORCE**2])
    for _ in range(2):
        assert coil.within(-100.0, 0.0) == pytest.approx(-math.sqrt(permitted))
    if share <= 0.1:
        assert coil.within(PEAK_FORCE, 0.0) == PEAK_FORCE
    assert (coil.saturated, coil.heated) == ((2, 0) if share <= 0.1 else (0, 2))


def test_a_coil_that_one_sample_would_overheat_gets_what_it_bears_of_it() -> None:
    coil = guard(wide(continuous_force=0.1, thermal_time=0.1))
    applied = [limited(coil, force) for force in alternating(PEAK_FORCE, 100)]
    # Its whole heat in one sample: the square of a tenth of a newton a hundred times over.
    assert applied[0] == pytest.approx(1.0, rel=0.01)
    assert coil.heat_share() == pytest.approx(1.0)
    assert np.abs(applied[1:]) == pytest.approx(0.1)


def test_a_coil_that_bears_no_force_gets_none() -> None:
    for coil in (guard(wide(continuous_force=0.0)), guard(wide(peak_force=0.0))):
        assert [limited(coil, force) for force in (1.0, -1e300)] == [0.0, 0.0]
        assert coil.heat_share() == 0.0


# Travel


@pytest.mark.parametrize("rate", RATES)
@given(
    samples=st.lists(
        # 1.1 mm of the spring, and 0.3 mm of the handle's; 1.5 times that where they resonate.
        st.tuples(st.floats(-0.3, 0.3), st.floats(-5.0, 5.0)),
        max_size=100,
    )
)
def test_within_the_free_travel_nothing_is_changed(
    rate: float, samples: list[tuple[float, float]]
) -> None:
    free = guard(rate=rate)
    for force, handle in samples:
        assert limited(free, force, handle) == force
    assert free.cushioned == 0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_force_that_would_press_it_on_its_stop_lets_it_rest_before(sign: float) -> None:
    pressed = guard()
    applied = [limited(pressed, 3.0 * sign) for _ in range(2000)]
    assert CUSHION * TRAVEL < abs(pressed.travel) < TRAVEL
    # There the spring alone holds what is left of the force, which no longer moves.
    assert applied[-1] == pytest.approx(-266.0 * pressed.travel, rel=1e-3)
    assert np.ptp(applied[-100:]) < 1e-6
    # A force that pulls it back is not touched.
    assert limited(pressed, -3.0 * sign) == -3.0 * sign


def damped(way: float, velocity: float) -> float:
    """Return the acceleration of a critically damped approach, m/s^2."""
    return 120.0**2 * way - 2 * 120.0 * velocity


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("share", "velocity", "outward"),
    [
        *((0.85, velocity, damped) for velocity in (0.01, -0.01, -0.1)),
        *((1.0, velocity, damped) for velocity in (0.0, 5e-324, 1e-9, -1e-9)),
        (0.9, 0.1, lambda way, velocity: -(velocity**2) / (2 * way)),
        # Within a sample.
        *((share, 0.1, lambda _, velocity: -velocity * RATE) for share in (0.9499, 0.96)),
    ],
)
def test_the_cushion_leaves_an_approach_to_its_end(
    share: float, velocity: float, outward: Callable[[float, float], float], side: float
) -> None:
    coil = guard()
    coil.travel, coil.velocity = side * share * TRAVEL, side * velocity
    push = coil.within(-side * 5.0, side * 3.0)
    relative = -side * push / COIL.m_a - 3.0
    relative -= (COIL.k_s * share * TRAVEL + COIL.b_s * max(0.0, velocity)) / COIL.m_a
    assert relative == pytest.approx(outward((CUSHION_END - share) * TRAVEL, velocity))
    assert coil.cushioned == 1


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("rate", "ahead"), [(500.0, 7e-3), (1000.0, 3.5e-3), (4000.0, 3.5e-3)])
def test_braking_begins_so_long_before_the_cushion(rate: float, ahead: float, side: float) -> None:
    coil = guard(rate=rate)
    for share, cushioned in ((0.999, 0), (1.001, 1)):
        coil.velocity = side * share * CUSHION * TRAVEL / ahead
        coil.within(-side * 5.0, 0.0)
        assert coil.cushioned == cushioned


def driven(
    rate: float,
    command: Callable[[float], float],
    *,
    guarded: bool,
    rig: MasterRigParameters | None = None,
    seconds: float = 1.0,
) -> tuple[MasterRig, ActuatorGuard, model.FloatArray, model.FloatArray]:
    """Let a command drive the simulated actuator; return force and energy by sample too."""
    master = MasterRig(rig or MasterRigParameters(exploration=STILL), rate)
    limits = guard(rate=rate)
    heard, applied, energy = 0.0, [], []
    for index in range(round(seconds * rate)):
        master.advance(index / rate)
        force = command(index / rate)
        if guarded:
            force = limited(limits, force, heard)
        acceleration = master.measure().acceleration[ACTUATOR_AXIS]
        # As in the compensation: one sample old, and none where the sensor is at its range.
        heard = acceleration if abs(acceleration) < 0.999 * SENSOR_RANGE else 0.0
        energy.append(master.energy())
        master.apply_actuator_force(along_actuator(force))
        applied.append(force)
    return master, limits, np.array(applied), np.array(energy)


def hits(master: MasterRig) -> int:
    return master.counters()["travel_stops_hit"]


RIG = MasterRigParameters(exploration=STILL)
SAGGING = replace(RIG, grip=model.GripParameters(gravity=6.9))
# Like the paper's, in another grip.
PAPERS = replace(RIG, grip=model.GripParameters(posture="hook"), drive=DriveParameters(delay=2e-4))
PAPERS = replace(PAPERS, mount=model.MountParameters(280.0, 0.127))


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    ("frequency", "rig"), [(5.0, RIG), (10.0, SAGGING), (15.0, PAPERS), (30.0, SAGGING)]
)
def test_an_absurd_command_does_not_hit_the_stops(
    rate: float, frequency: float, rig: MasterRigParameters
) -> None:
    def command(time: float) -> float:
        return 3.0 * math.sin(2 * math.pi * frequency * time)

    free, _, _, _ = driven(rate, command, guarded=False, rig=rig)
    kept, limits, _, _ = driven(rate, command, guarded=True, rig=rig)
    assert hits(free) >= 20
    # A sag that the estimate does not know yet may cost the first.
    assert hits(kept) <= 2
    assert limits.cushioned > 0


@pytest.mark.parametrize("posture", ["pinch", "hook"])
@pytest.mark.parametrize("frequency", [8.0, 20.0])
@pytest.mark.slow
def test_nor_does_it_on_a_rig_like_the_papers_in_another_grip(
    posture: str, frequency: float
) -> None:
    rig = MasterRigParameters(
        exploration=STILL,
        grip=model.GripParameters(posture=posture),
        mount=model.MountParameters(280.0, 0.127),
        drive=DriveParameters(delay=225e-6),
    )

    def command(time: float) -> float:
        return math.copysign(3.0, math.sin(2 * math.pi * frequency * time))

    free, _, _, _ = driven(RATE, command, guarded=False, rig=rig)
    kept, _, _, _ = driven(RATE, command, guarded=True, rig=rig)
    assert hits(kept) < hits(free) / 5


@pytest.mark.parametrize("rate", [500.0, *RATES])
def test_the_cushion_brakes_once_adds_no_energy_and_does_not_ring(rate: float) -> None:
    rig = MasterRigParameters(
        exploration=STILL, accelerometer=model.AccelerometerParameters(noise_density=0.0, bits=32)
    )
    pushed = 4e-3

    def push(time: float) -> float:
        return -5.0 if time < pushed - 1e-9 else 0.0

    free, _, _, unbraked = driven(rate, push, guarded=False, rig=rig, seconds=0.3)
    kept, _, force, energy = driven(rate, push, guarded=True, rig=rig, seconds=0.3)
    assert hits(free) > 0
    assert hits(kept) == 0
    begun = round(pushed * rate)
    after = energy[begun:]
    assert np.diff(after).max() < 0.01 * after[0]
    assert after[-1] < 1e-3 * after[0]
    assert unbraked[begun] >= after[0]
    # One stretch of force, all of it inwards; it may begin while the push lasts.
    braking = force - [push(index / rate) for index in range(len(force))]
    assert braking.min() >= 0.0
    assert braking.max() > 0.1
    assert sum(one == 0.0 < other for one, other in pairwise([0.0, *braking.tolist()])) == 1


# Estimate of the travel


def test_a_constant_force_stretches_the_spring() -> None:
    estimator = TravelEstimator(model.Suspension(k_s=200.0), 1000.0)
    for _ in range(2000):
        travel = estimator.observe(0.3, 0.0)
    assert travel == pytest.approx(-0.3 / 200.0)
    estimator.reset()
    assert estimator.travel == 0.0


def test_gravity_that_the_accelerometer_feels_makes_it_sag() -> None:
    suspension = model.Suspension()
    estimator = TravelEstimator(suspension, 1000.0)
    for _ in range(2000):
        estimator.observe(0.0, 9.81)
    assert estimator.travel == pytest.approx(-suspension.m_a * 9.81 / suspension.k_s)


@given(
    st.floats(-5e-3, 5e-3),
    st.floats(-1.0, 1.0),
    st.floats(-5.0, 5.0),
    st.floats(-20.0, 20.0),
    st.floats(20.0, 20e3),
)
def test_a_sample_is_the_motion_of_a_driven_oscillator(
    travel: float, velocity: float, force: float, handle: float, rate: float
) -> None:
    suspension = model.Suspension(b_s=0.2)
    estimator = TravelEstimator(suspension, rate)
    estimator.travel, estimator.velocity = travel, velocity
    estimator.observe(force, handle)
    # d(t) = rest + exp(-decay t) (first cos(turn t) + second sin(turn t))
    decay = suspension.b_s / (2 * suspension.m_a)
    turn = math.sqrt(suspension.k_s / suspension.m_a - decay**2)
    rest = -(force + suspension.m_a * handle) / suspension.k_s
    first = travel - rest
    second = (velocity + decay * first) / turn
    fade, cos, sin = math.exp(-decay / rate), math.cos(turn / rate), math.sin(turn / rate)
    expected = rest + fade * (first * cos + second * sin)
    assert estimator.travel == pytest.approx(expected, abs=1e-12)
    expected = turn * (second * cos - first * sin) - decay * (first * cos + second * sin)
    assert estimator.velocity == pytest.approx(fade * expected, abs=1e-9)


def test_it_follows_the_simulated_actuator_through_the_sweep() -> None:
    rig = MasterRigParameters(
        grip=model.GripParameters(gravity=6.9),
        accelerometer=model.AccelerometerParameters(bandwidth=100e3, noise_density=0.0, bits=32),
        exploration=ExplorationParameters(press_depth=0.0),
    )
    rate = 1000.0
    master = MasterRig(rig, rate)
    estimator = TravelEstimator(model.Suspension(), rate)
    true, found = [], []
    applied = 0.0
    for index, force in enumerate(excitation(SweepParameters(), rate).tolist()):
        master.advance(index / rate)
        found.append(estimator.observe(applied, master.measure().acceleration[ACTUATOR_AXIS]))
        true.append(master.travel)
        master.apply_actuator_force(along_actuator(force))
        applied = force
    settled = slice(round(0.3 * rate), None)  # the estimate starts in the middle
    error = np.array(found)[settled] - np.array(true)[settled]
    # A sample of acceleration stands for the period before it, half a period late.
    assert np.abs(error).max() < 0.05 * np.abs(true).max()


def test_a_rate_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match="rate = 0"):
        TravelEstimator(model.Suspension(), 0.0)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The handle with three coils: its mechanics by hand, energy, and the rig with one coil."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core import model
from haptic_accel.core.handle.response import cross_coupling, sampled_response
from haptic_accel.core.handle.three_axis import (
    GYRATION_RADIUS,
    BodyParameters,
    CoilMounting,
    SensorMounts,
    mass_matrix,
)
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import (
    DriveParameters,
    ExplorationParameters,
    MasterRig,
    MasterRigParameters,
    ThreeAxisRig,
)
from haptic_accel.core.rig.master_rig import (
    SimulatedMasterParameters as Parameters,
)

RATE = 1000.0
PERIOD = 1 / RATE
TABLE_I = model.HandleParameters()
CENTRED = BodyParameters(sensor_x=0.0, sensor_y=0.0, sensor_z=0.0)
LOSSLESS = replace(TABLE_I, b_s=0.0, b_u=0.0)

few = settings(deadline=None, max_examples=20)
speeds = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
slow = st.tuples(*[st.floats(-0.05, 0.05)] * 3)


class Straight(Parameters):
    """A handle whose coils lie along the axes, through the centre of mass."""

    coils = CoilMounting(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def ideal(ideal_master: MasterRigParameters) -> Parameters:
    """Return the default handle with ideal instruments and a hand at rest."""
    same = ("drive", "accelerometer", "arm", "exploration")
    return Parameters(**{name: getattr(ideal_master, name) for name in same})


RESTING = ExplorationParameters(
    height=0.0, press_depth=0.0, stroke_speed=0.0, stroke_length=0.001, strokes=1
)
STILL = Parameters(exploration=RESTING)


def run(rig: ThreeAxisRig, samples: int, rate: float = RATE) -> list[float]:
    """Let samples pass from the start, return the energy at each, J."""
    energies = []
    for index in range(samples):
        rig.advance(index / rate)
        energies.append(rig.energy())
    return energies


# Response


@pytest.mark.parametrize("mode", [0.0, 287.0])
@pytest.mark.parametrize("delay", [0.0, 68e-6, 1.3e-3])
def test_without_tilts_and_offsets_each_axis_is_that_of_one_coil(
    mode: float, delay: float
) -> None:
    frequency = np.linspace(5.0, 490.0, 50)
    mount = model.MountParameters(mode, 0.1)
    straight = Straight(
        body=CENTRED,
        mounts=SensorMounts(mount, mount, mount),
        drive=DriveParameters(delay=delay),
    )
    found = ThreeAxisRig(straight, RATE).response(frequency, RATE)
    expected = sampled_response(TABLE_I, frequency, RATE, delay, mount=mount)
    for axis in range(3):
        assert found[:, axis, axis] == pytest.approx(expected, rel=1e-9)
    assert np.abs(found[:, ~np.eye(3, dtype=bool)]).max() < 1e-12


def test_it_then_moves_as_the_rig_with_one_coil(
    ideal: Parameters, ideal_master: MasterRigParameters
) -> None:
    drive = DriveParameters(bits=14, delay=1.3e-3, coulomb_friction=0.05)
    grip = model.GripParameters(variation=0.15, gravity=6.9)
    exploration = ExplorationParameters()
    same: dict[str, Any] = {"drive": drive, "grip": grip, "exploration": exploration}
    three = ThreeAxisRig(Straight(**vars(ideal) | {"body": CENTRED} | same), RATE, seed=3)
    one = MasterRig(replace(ideal_master, **same), RATE, seed=3)
    force = np.random.default_rng(1).normal(0.0, 1.5, 2000).tolist()
    for index, each in enumerate(force):
        for rig in (three, one):
            rig.advance(index * PERIOD)
            rig.apply_arm_force((0.0, 0.0, -0.5))
            rig.apply_actuator_force((0.0, 0.0, each))
        # Along x there is one coil more.
        of_three, of_one = three.measure(), one.measure()
        assert of_three.position[2] == pytest.approx(of_one.position[2], abs=1e-12)
        assert of_three.acceleration[2] == pytest.approx(of_one.acceleration[2], abs=1e-6)
        assert three.travel[2] == pytest.approx(one.travel, abs=1e-12)
    assert three.counters() == one.counters()
    assert one.counters()["travel_stops_hit"] > 0


def test_at_high_frequencies_masses_alone_decide() -> None:
    # Newton and Euler for a handle whose coils are light.
    body, coils = BodyParameters(), CoilMounting()
    tiny = replace(TABLE_I, m_a=1e-6, k_s=0.0, b_s=0.0)
    rate = 1e6
    unfiltered = replace(
        Parameters(handle=tiny),
        accelerometer=model.AccelerometerParameters(bandwidth=100e3),
    )
    rig = ThreeAxisRig(unfiltered, rate)
    frequency = np.array([3000.0])
    low_pass = 1 / (1 + 1j * frequency[0] / 100e3)
    found = rig.response(frequency, rate)[0] / low_pass
    sensor = np.array([body.sensor_x, body.sensor_y, body.sensor_z])
    inertia = TABLE_I.m_h * GYRATION_RADIUS**2
    for coil in range(3):
        direction, place = coils.directions[:, coil], coils.positions[:, coil]
        spin = np.cross(place, direction) / inertia
        expected = direction / TABLE_I.m_h + np.cross(spin, sensor)
        assert np.abs(found[:, coil]) == pytest.approx(np.abs(expected), rel=0.02, abs=0.05)


def test_the_mass_matrix_is_that_of_handle_and_coils() -> None:
    coils = CoilMounting()
    mass = mass_matrix(TABLE_I, coils)
    assert mass == pytest.approx(mass.T)
    assert np.linalg.eigvalsh(mass).min() > 0
    # All together moves as 0.128 + 0.018 kg; a coil alone as 0.018 kg.
    assert mass[:3, :3] == pytest.approx(0.146 * np.eye(3))
    assert mass[6:, 6:] == pytest.approx(0.018 * np.eye(3))
    assert mass[:3, 6:] == pytest.approx(0.018 * coils.directions)


def test_a_coil_moves_another_as_much_as_that_one_moves_it(
    ideal: Parameters,
) -> None:
    travels = np.zeros((3, 3, 40))
    for coil in range(3):
        rig = ThreeAxisRig(ideal, RATE)
        for index in range(40):
            rig.advance(index * PERIOD)
            travels[:, coil, index] = rig.travel
            rig.apply_actuator_force(vector_along(coil, 1.0 if index == 0 else 0.0))
    assert travels == pytest.approx(travels.swapaxes(0, 1), abs=1e-15)
    assert np.abs(travels[0, 1]).max() > 0.01 * np.abs(travels[0, 0]).max()


def vector_along(axis: int, value: float) -> model.Vector:
    x, y, z = (value if axis == each else 0.0 for each in range(3))
    return x, y, z


@pytest.mark.parametrize("turned", [0.0, math.radians(10)])
def test_the_rig_follows_its_response(ideal: Parameters, turned: float) -> None:
    parameters = replace(
        ideal,
        body=BodyParameters(sensor_rotation=turned, sensor_axis="x"),
        mounts=SensorMounts(*(model.MountParameters(f, 0.1) for f in (240.0, 0.0, 287.0))),
        drive=DriveParameters(bits=32, delay=230e-6, force_scale=-0.9),
    )
    rig = ThreeAxisRig(parameters, RATE)
    time = np.arange(1000) * PERIOD
    lines = [[20, 50, 110, 201], [23, 53, 113, 251], [29, 61, 127, 307]]
    force = np.array(
        [sum(0.1 * np.sin(2 * np.pi * f * time + f * f) for f in each) for each in lines]
    )
    measured = []
    for index, (x, y, z) in enumerate(np.tile(force, 3).T.tolist()):
        rig.advance(index * PERIOD)
        measured.append(rig.measure().acceleration)
        rig.apply_actuator_force((x, y, z))
    acceleration = np.fft.rfft(measured[-1000:], axis=0)
    for coil, frequencies in enumerate(lines):
        gain = acceleration[frequencies] / np.fft.rfft(force[coil])[frequencies, np.newaxis]
        expected = rig.response(frequencies, RATE)[:, :, coil]
        assert np.abs(gain - expected).max() < 1e-3 * np.abs(expected).max()


def test_the_coupling_to_the_slave_is_a_stiffer_grip_without_a_stiffer_turn(
    ideal: Parameters,
) -> None:
    frequency = np.array([10.0, 15.0, 20.0, 60.0])
    straight = Straight(**vars(ideal) | {"body": CENTRED})
    coupled = ThreeAxisRig(straight, RATE).response(frequency, RATE, coupling=250.0)
    stiffer = sampled_response(replace(TABLE_I, k_u=1750.0), frequency, RATE)
    assert coupled[:, 1, 1] == pytest.approx(stiffer, rel=1e-9)


def test_the_default_cross_coupling_is_10_db() -> None:
    frequency = np.geomspace(40.0, 400.0, 20)
    found = cross_coupling(ThreeAxisRig(Parameters(), RATE).response(frequency, RATE))
    assert found == pytest.approx(-10.0, abs=0.6)


def test_a_turned_accelerometer_measures_the_same_vector_in_its_own_frame(
    ideal: Parameters,
) -> None:
    angle = math.radians(10)
    told = ThreeAxisRig(ideal, RATE)
    body = BodyParameters(sensor_axis="z", sensor_rotation=angle)
    turned = ThreeAxisRig(replace(ideal, body=body), RATE)
    for rig in (told, turned):
        rig.apply_actuator_force((1.0, -0.5, 0.7))
        rig.advance(3 * PERIOD)
    x, y, z = told.measure().acceleration
    # The sensor's x axis is turned from x towards y.
    assert turned.measure().acceleration == pytest.approx(
        (math.cos(angle) * x + math.sin(angle) * y, math.cos(angle) * y - math.sin(angle) * x, z),
        abs=1e-6,
    )


def test_another_mount_changes_nothing_at_once_and_then_rings(
    ideal: Parameters,
) -> None:
    rig = ThreeAxisRig(ideal, RATE)
    rig.apply_actuator_force((1.0, -0.5, 0.7))
    rig.advance(0.05)
    before = rig.measure()
    rig.change_mount(model.MountParameters(200.0, 0.01))
    assert rig.measure() == before
    rig.apply_actuator_force((0.0, 0.0, 0.0))
    rung = []
    for index in range(51, 551):
        rig.advance(index * PERIOD)
        rung.append(rig.measure().acceleration)
    peaks = np.argmax(np.abs(np.fft.rfft(rung, axis=0)), axis=0) * RATE / len(rung)
    assert peaks == pytest.approx([200.0] * 3, abs=4.0)
    assert np.abs(rung).max() < 20.0  # 1 N on 0.128 kg, rung up to twice


# Statics


def test_constant_forces_are_held_by_the_coils_own_springs(
    ideal: Parameters,
) -> None:
    rig = ThreeAxisRig(ideal, RATE)
    rig.apply_actuator_force((0.5, -0.3, 0.2))
    run(rig, 3000)
    assert rig.travel == pytest.approx((-0.5 / 266.0, 0.3 / 266.0, -0.2 / 266.0))
    assert rig.measure().position == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_the_arm_s_force_is_held_by_the_grip_along_all_axes(
    ideal: Parameters,
) -> None:
    rig = ThreeAxisRig(ideal, RATE)
    rig.apply_arm_force((0.3, -0.9, 100.0))
    run(rig, 3000)
    held = (0.3 / 1500.0, -0.9 / 1500.0, 3.3 / 1500.0)
    assert rig.measure().position == pytest.approx(held)


def test_a_handle_held_against_gravity_is_at_rest(ideal: Parameters) -> None:
    mounts = SensorMounts(*[model.MountParameters(280.0, 0.1)] * 3)
    held = replace(ideal, grip=model.GripParameters(gravity=6.9), mounts=mounts)
    rig = ThreeAxisRig(held, RATE)
    rig.apply_arm_force((0.0, 0.0, 0.0))
    start = rig.measure().position
    assert start[2] == pytest.approx(-0.146 * 6.9 / 1500.0)
    run(rig, 200)
    assert rig.measure().position == pytest.approx(start, abs=1e-12)
    assert rig.measure().acceleration == pytest.approx((0.0, 0.0, 6.9), abs=1e-6)


def test_the_hand_leads_the_handle_along_x_and_z(ideal: Parameters) -> None:
    rig = ThreeAxisRig(replace(ideal, exploration=ExplorationParameters()), RATE)
    for index in range(1000):
        rig.apply_arm_force((0.0, 0.0, 0.0))
        rig.advance(index * PERIOD)
    x, y, z = rig.measure().position
    assert x == pytest.approx(0.032, abs=0.01)  # 0.4 s of a stroke of 0.1 m/s, after its ramp
    assert y == pytest.approx(0.0, abs=1e-5)
    assert z == pytest.approx(-0.0047, abs=1e-4)


# Energy


@few
@given(slow, slow, slow)
def test_without_damping_energy_is_conserved(
    handle: model.Vector, coils: model.Vector, spin: model.Vector
) -> None:
    rig = ThreeAxisRig(replace(STILL, handle=LOSSLESS), RATE)
    rig.disturb(handle, coils, spin)
    thrown = rig.energy()
    assert run(rig, 300) == pytest.approx([thrown] * 300, rel=1e-9, abs=1e-15)
    assert rig.counters()["travel_stops_hit"] == 0


@few
@given(speeds, speeds | st.tuples(*[st.sampled_from([-3.0, 0.0, 3.0])] * 3))
def test_damping_and_travel_stops_only_take_energy(
    handle: model.Vector, coils: model.Vector
) -> None:
    rig = ThreeAxisRig(STILL, RATE)
    rig.disturb(handle, coils)
    energies = run(rig, 500)
    assert (np.diff(energies) <= 1e-15).all()
    assert energies[-1] <= 1e-3 * energies[0] + 1e-15
    assert rig.counters()["travel_stops_hit"] >= sum(abs(each) == 3.0 for each in coils)


@few
@given(speeds, speeds, st.floats(1e-3, 0.5), st.sampled_from([1000.0, 4000.0]))
def test_dry_friction_only_takes_energy(
    handle: model.Vector, coils: model.Vector, friction: float, rate: float
) -> None:
    drive = DriveParameters(coulomb_friction=friction)
    rig = ThreeAxisRig(replace(STILL, handle=LOSSLESS, drive=drive), rate)
    rig.disturb(handle, coils)
    energies = run(rig, 400, rate)
    assert (np.diff(energies) <= 1e-12 * energies[0] + 1e-15).all()


# Limits and instruments


def test_each_coil_is_limited_and_ignores_nan(ideal: Parameters) -> None:
    rig = ThreeAxisRig(Straight(**vars(ideal)), RATE)
    rig.apply_actuator_force((math.nan, -100.0, 0.1))
    rig.advance(1e-4)
    x, y, z = rig.travel
    assert x == 0.0
    assert y / z == pytest.approx(-66.0)
    assert rig.counters()["actuator_saturated"] == 1


def test_the_axes_have_independent_noise_and_z_that_of_one_coil() -> None:
    rigs = ThreeAxisRig(STILL, RATE, 5), MasterRig(MasterRigParameters(), RATE, 5)
    for rig in rigs:
        rig.apply_arm_force((0.0, 0.0, 0.0))
    three, one = (np.array([rig.measure().acceleration for _ in range(4000)]) for rig in rigs)
    assert three[:, 2] == pytest.approx(one[:, 2])
    assert three.std(axis=0) == pytest.approx(model.AccelerometerParameters().noise, rel=0.05)
    assert np.abs(np.corrcoef(three.T) - np.eye(3)).max() < 0.06


def test_another_grip_changes_nothing_at_once() -> None:
    rig = ThreeAxisRig(STILL, RATE)
    rig.disturb((0.1, 0.2, -0.1))
    rig.advance(0.005)
    before: model.FloatArray = np.array(rig.measure().position + rig.travel)
    rig.hold(model.GripParameters(posture="pinch"))
    assert rig.handle.k_u == pytest.approx(0.75 * 1500.0)
    assert np.array(rig.measure().position + rig.travel) == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: BodyParameters(sensor_axis="w"), "sensor_axis = 'w': must be one of x, y, z"),
        (
            lambda: BodyParameters(sensor_rotation=10.0),
            "sensor_rotation = 10.0: must be from -3.14159 to 3.14159 rad",
        ),
        (
            lambda: ThreeAxisRig(replace(STILL, handle=replace(TABLE_I, m_h=0.03)), RATE),
            "m_h = 0.03: must be above 0.036 kg, the mass of two coils, which move with the"
            " handle",
        ),
    ],
)
def test_impossible_handles_are_refused_in_one_line(wrong: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{message}[^\n]*$"):
        wrong()

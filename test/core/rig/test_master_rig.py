# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated master with one coil and with three: mechanics, energy, and its own limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.handle.mechanics import cross_coupling, sampled_response
from haptic_accel.core.handle.three_axis import (
    GYRATION_RADIUS,
    BodyParameters,
    CoilMounting,
    SensorMounts,
    mass_matrix,
)
from haptic_accel.core.model import (
    POSTURES,
    AccelerometerParameters,
    GripParameters,
    HandleParameters,
    ModeParameters,
    MountParameters,
    Vector,
    held,
)
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import (
    DriveParameters,
    ExplorationParameters,
    MasterRig,
    MasterRigParameters,
    ThreeAxisRig,
)
from haptic_accel.core.rig.master_rig import SimulatedMasterParameters as Parameters
from haptic_accel.core.tick.rigs import LONGEST_ADVANCE

RATE = 1000.0
PERIOD = 1 / RATE

RESTING = ExplorationParameters(
    height=0.0, press_depth=0.0, stroke_speed=0.0, stroke_length=0.001, strokes=1
)
STILL, STILL_THREE = MasterRigParameters(exploration=RESTING), Parameters(exploration=RESTING)
AVERAGE = GripParameters()

Rig = MasterRig | ThreeAxisRig
Build = Callable[..., Rig]

TABLE_I = HandleParameters()
CENTRED = BodyParameters(sensor_x=0.0, sensor_y=0.0, sensor_z=0.0)
LOSSLESS = replace(TABLE_I, b_s=0.0, b_u=0.0)

few = settings(deadline=None, max_examples=20)


class Straight(Parameters):
    """A handle whose coils lie along the axes, through the centre of mass."""

    coils = CoilMounting(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def ideal(ideal_master: MasterRigParameters) -> Parameters:
    """Return the default handle with ideal instruments and a hand at rest."""
    same = ("drive", "accelerometer", "arm", "exploration")
    return Parameters(**{name: getattr(ideal_master, name) for name in same})


@pytest.fixture(params=["one coil", "three coils"])
def build(
    request: pytest.FixtureRequest, ideal_master: MasterRigParameters, ideal: Parameters
) -> Build:
    """Build ideal rigs with one coil, or with three, held in some way by a hand."""

    def built(grip: GripParameters = AVERAGE, hand: ExplorationParameters = RESTING) -> Rig:
        if request.param == "one coil":
            return MasterRig(replace(ideal_master, grip=grip, exploration=hand), RATE)
        return ThreeAxisRig(replace(ideal, grip=grip, exploration=hand), RATE)

    return built


def coils(rig: Rig, force: Vector) -> Vector:
    """Return the components of a vector along the coils of a rig."""
    return force if isinstance(rig, ThreeAxisRig) else along_actuator(force[ACTUATOR_AXIS])


def travel(rig: Rig) -> Vector:
    """Return the travel of each coil, m."""
    return rig.travel if isinstance(rig, ThreeAxisRig) else along_actuator(rig.travel)


def run(rig: Rig, first: int, last: int, rate: float = RATE) -> list[float]:
    """Let samples pass, return the energy at each, J."""
    energies = []
    for index in range(first, last):
        rig.advance(index / rate)
        energies.append(rig.energy())
    return energies


def accelerations(
    rig: Rig, ticks: Iterable[int], rate: float = RATE, forces: Iterable[float] = ()
) -> list[float]:
    """Return what the accelerometer reads at ticks, after each of which a force may follow."""
    found = []
    for index, command in zip_longest(ticks, forces):
        rig.advance(index / rate)
        found.append(rig.measure().acceleration[ACTUATOR_AXIS])
        if command is not None:
            rig.apply_actuator_force(along_actuator(command))
    return found


def travels(rig: MasterRig, samples: int, rate: float = RATE) -> list[float]:
    """Return the travel at each of some samples, m."""
    found = []
    for index in range(samples):
        rig.advance(index / rate)
        found.append(rig.travel)
    return found


# The handle's dynamics


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
@pytest.mark.parametrize(
    ("mode", "delay"), [(0.0, 0.0), (280.0, 0.0), (0.0, 230e-6), (320.0, 1.3e-3)]
)
def test_the_handle_follows_eq_3_behind_hold_and_low_pass(
    ideal_master: MasterRigParameters, rate: float, mode: float, delay: float
) -> None:
    mount = MountParameters(mode, 0.1)
    drive = replace(ideal_master.drive, delay=delay)
    rig = MasterRig(replace(ideal_master, drive=drive, mount=mount), rate)
    frequencies = [10, 15, 17, 20, 30, 50, 100, 150, 200]
    count = int(rate)  # one second: whole periods of each sine
    time = np.arange(count) / rate
    # Phases that keep the sum of sines, and so the travel, small.
    force = sum(
        0.1 * np.sin(2 * math.pi * f * time + phase**2) for phase, f in enumerate(frequencies)
    )
    measured = accelerations(rig, range(3 * count), rate, np.tile(force, 3).tolist())
    # The third second: the slowest mode has decayed by more than 1e-20.
    gain = np.fft.rfft(measured[-count:]) / np.fft.rfft(force)
    for frequency in frequencies:
        expected = sampled_response(HandleParameters(), [frequency], rate, delay, mount=mount)
        assert abs(gain[frequency] / expected - 1) < 1e-5
    assert rig.counters() == {
        "accelerometer_saturated": 0,
        "actuator_saturated": 0,
        "travel_stops_hit": 0,
    }


def transmitted(frequency: float, mode: float, damping: float) -> complex:
    """Motion of a mass on spring and damper over that of its base (Den Hartog, sec. 2.12)."""
    ratio = frequency / mode
    damper = 2j * damping * ratio
    return (1 + damper) / (1 - ratio**2 + damper)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (MountParameters(120.0, 0.1), ModeParameters(210.0, 0.05, 1.0, on_mount=True)),
        (MountParameters(120.0, 0.1), ModeParameters(210.0, 0.05, 0.4, on_mount=False)),
        (MountParameters(), ModeParameters(150.0, 0.08, 0.6, on_mount=False)),
    ],
    ids=["in series", "in parallel", "beside the rigid handle"],
)
def test_two_modes_are_transmitted_in_series_or_in_parallel(
    ideal_master: MasterRigParameters, first: MountParameters, second: ModeParameters
) -> None:
    # The low-pass and the hold are the same with and without modes: a high rate has no aliases.
    rate = 8000.0
    gains = []
    for mount, other in ((first, second), (MountParameters(), ModeParameters())):
        rig = MasterRig(replace(ideal_master, mount=mount, second=other), rate)
        gains.append(np.fft.rfft(accelerations(rig, range(8000), rate, [1.0, 0.0])))
    for frequency in (40, 100, 140, 180, 205, 250):
        of_first = transmitted(frequency, first.frequency, first.damping) if first.frequency else 1
        of_second = transmitted(frequency, second.frequency, second.damping)
        base = of_first if second.on_mount else 1.0
        expected = (1 - second.share) * of_first + second.share * base * of_second
        assert gains[0][frequency] / gains[1][frequency] == pytest.approx(expected, rel=0.02)


def test_swapped_wires_push_the_other_way(ideal_master: MasterRigParameters) -> None:
    moved = []
    for scale in (1.0, 0.7, -1.0):
        drive = replace(ideal_master.drive, force_scale=scale)
        rig = MasterRig(replace(ideal_master, drive=drive), RATE)
        rig.apply_actuator_force(along_actuator(0.5))
        rig.advance(5 * PERIOD)
        moved.append(rig.travel)
    assert moved[1] == pytest.approx(0.7 * moved[0])
    assert moved[2] == pytest.approx(-moved[0])


@few
@given(st.lists(st.floats(0.0, 1.0), max_size=5))
def test_how_often_it_is_looked_at_does_not_matter(parts: list[float]) -> None:
    once, often = MasterRig(STILL, RATE), MasterRig(STILL, RATE)
    for rig in (once, often):
        rig.apply_arm_force((0.1, 0.0, -0.5))
        rig.apply_actuator_force(along_actuator(0.3))
    for index in range(20):
        once.advance((index + 1) * PERIOD)
        for part in parts:  # not in order: a time that has passed changes nothing
            often.advance((index + part) * PERIOD)
        often.advance((index + 1) * PERIOD)
        one, other = once.measure(), often.measure()
        assert other.velocity == pytest.approx(one.velocity, abs=1e-12)
        assert other.acceleration[ACTUATOR_AXIS] == one.acceleration[ACTUATOR_AXIS]


# With one coil and with three


def test_another_mount_changes_nothing_at_once_and_then_rings(build: Build) -> None:
    rig = build()
    rig.change_mount(MountParameters(100.0, 0.5))
    rig.apply_actuator_force((1.0, -0.5, 0.7))
    rig.advance(0.05)
    before, travelled = rig.measure(), travel(rig)
    rig.change_mount(MountParameters(200.0, 0.01))
    assert (rig.measure(), travel(rig)) == (before, travelled)
    rig.apply_actuator_force((0.0, 0.0, 0.0))
    rung = []
    for index in range(51, 551):
        rig.advance(index * PERIOD)
        rung.append(coils(rig, rig.measure().acceleration))
    peaks = np.argmax(np.abs(np.fft.rfft(rung, axis=0)), axis=0) * RATE / len(rung)
    assert peaks == pytest.approx(coils(rig, (200.0, 200.0, 200.0)), abs=4.0)
    assert np.abs(rung).max() < 20.0  # 1 N on 0.128 kg, rung up to twice


def test_constant_forces_are_held_by_the_coils_own_springs(build: Build) -> None:
    rig = build()
    force = coils(rig, (0.5, -0.3, 0.2))
    rig.apply_actuator_force(force)
    run(rig, 0, 3000)
    assert travel(rig) == pytest.approx(np.divide(force, -266.0))
    assert rig.measure().position == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("force", "held_force"),
    [((0.3, -0.9, -0.6), (0.3, -0.9, -0.6)), ((-1e6, 100.0, math.inf), (-3.3, 3.3, 3.3))],
)
def test_the_arm_s_force_within_its_limit_is_held_by_the_grip(
    build: Build, force: Vector, held_force: Vector
) -> None:
    rig = build()
    rig.apply_arm_force(force)
    run(rig, 0, 3000)
    x, y, z = held_force
    expected = (x, y if isinstance(rig, ThreeAxisRig) else 0.0, z)
    assert np.multiply(rig.measure().position, 1500.0) == pytest.approx(expected)


def test_a_handle_held_against_gravity_is_at_rest_and_its_sensor_tells_gravity(
    build: Build,
) -> None:
    rig = build(GripParameters(gravity=6.9))
    rig.change_mount(MountParameters(280.0, 0.1))
    rig.apply_arm_force((0.0, 0.0, 0.0))
    start, before = rig.measure().position, travel(rig)
    assert start[2] == pytest.approx(-0.146 * 6.9 / 1500.0)
    along = CoilMounting().directions[2, 2] if isinstance(rig, ThreeAxisRig) else 1.0
    assert before[2] == pytest.approx(-0.018 * 6.9 * along / 266)
    assert accelerations(rig, range(200)) == pytest.approx([6.9] * 200, abs=1e-6)
    assert rig.measure().acceleration == pytest.approx((0.0, 0.0, 6.9), abs=1e-6)
    assert rig.measure().position == pytest.approx(start, abs=1e-12)
    assert travel(rig) == pytest.approx(before, abs=1e-9)


def test_the_handle_follows_the_hand_along_x_and_z(build: Build) -> None:
    rig = build(hand=ExplorationParameters())
    hold(rig, 0, 1000)
    x, y, z = rig.measure().position
    assert x == pytest.approx(0.032, abs=0.01)  # 0.4 s of a stroke of 0.1 m/s, after its ramp
    assert y == pytest.approx(0.0, abs=1e-5)
    assert z == pytest.approx(-0.0047, abs=1e-4)
    # In the middle of the first stroke: the grip's damping leaves no lag at constant speed.
    assert rig.measure().velocity[0] == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("force", [0.0, math.nan])
def test_at_rest_it_stays_at_rest_and_nan_is_no_force(build: Build, force: float) -> None:
    rig = build()
    rig.apply_actuator_force((force, force, force))
    rig.apply_arm_force((force, force, force))
    assert max(run(rig, 0, 100)) == 0.0
    assert rig.measure().position == (0.0, 0.0, 0.0)


KINDS: dict[str, Callable[[int], Rig]] = {
    "one coil": lambda seed: MasterRig(MasterRigParameters(), RATE, seed),
    "three coils": lambda seed: ThreeAxisRig(Parameters(), RATE, seed),
}


@pytest.mark.parametrize("kind", KINDS)
@few
@given(
    posture=st.sampled_from(sorted(POSTURES)),
    variation=st.floats(0.0, 1.0),
    seed=st.integers(0, 10),
)
def test_another_grip_is_the_same_user_s_and_nothing_moves(
    kind: str, posture: str, variation: float, seed: int
) -> None:
    rig = KINDS[kind](seed)
    rig.apply_arm_force((0.0, 0.0, 0.0))
    rig.apply_actuator_force((0.5, 1.0, 1.0))
    run(rig, 1, 900)
    before, travelled = rig.measure(), travel(rig)
    grip = GripParameters(posture=posture, variation=variation)
    rig.hold(grip)
    after = rig.measure()
    assert (after.position, after.velocity) == (before.position, before.velocity)
    assert travel(rig) == travelled
    assert rig.handle == held(HandleParameters(), grip, seed)
    run(rig, 900, 1000)
    assert math.isfinite(rig.measure().acceleration[ACTUATOR_AXIS])


speeds = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
slow = st.tuples(*[st.floats(-0.05, 0.05)] * 3)


@few
@given(
    slow,
    slow,
    speeds,
    st.floats(0.0, 1.0),
    st.floats(2e-3, 1.0),
    st.sampled_from([1000.0, 4000.0]),
)
def test_dry_friction_only_takes_energy(
    handle: Vector, coils: Vector, fast: Vector, friction: float, slip: float, rate: float
) -> None:
    drive = DriveParameters(coulomb_friction=friction, slip_velocity=slip)
    one = MasterRig(replace(STILL, drive=drive), rate)
    one.disturb(*fast[:2])
    three = ThreeAxisRig(replace(STILL_THREE, handle=LOSSLESS, drive=drive), rate)
    three.disturb(handle, coils)
    for rig in (one, three):
        for before, after in pairwise([rig.energy(), *run(rig, 0, 400, rate)]):
            assert after <= before * (1 + 1e-9) + 1e-15
    # The stops of an undamped handle are not exact: they would be seen in place of the friction.
    assert three.counters()["travel_stops_hit"] == 0


# Energy


@few
@given(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5) | st.floats(2.0, 5.0) | st.floats(-5.0, -2.0))
def test_energy_never_grows_without_input_nor_in_the_travel_stops(
    handle_velocity: float, relative_velocity: float
) -> None:
    rig = MasterRig(STILL, RATE)
    actuator_velocity = handle_velocity + relative_velocity
    rig.disturb(handle_velocity, actuator_velocity)
    energies = [rig.energy(), *run(rig, 1, 500)]
    given_energy = (0.128 * handle_velocity**2 + 0.018 * actuator_velocity**2) / 2
    assert energies[0] == pytest.approx(given_energy)
    assert (np.diff(energies) <= 1e-15).all()
    # Slowest mode: 17 /s, twice for energy.
    assert energies[-1] <= 1e-4 * energies[0]
    assert rig.counters()["travel_stops_hit"] > 0 or abs(relative_velocity) < 2.0


def test_undamped_stops_give_back_what_they_took() -> None:
    # Nothing takes energy away, so 300 ms of bouncing show what the stops make of it: they are
    # looked at every 50 us only, and may be left a little late.
    undamped = replace(
        STILL, handle=HandleParameters(b_s=0.0, b_u=0.0), drive=DriveParameters(stop_damping=0.0)
    )
    rig = MasterRig(undamped, RATE)
    rig.disturb(0.0, 3.0)
    energies = [rig.energy(), *run(rig, 1, 300)]
    assert rig.counters()["travel_stops_hit"] > 10
    assert max(energies) < 1.15 * energies[0]


# Travel stops


def overrun(energy: float, force: float) -> float:
    """Return how deep an energy in J and a force in N press a stop of 3e4 N/m, without loss."""
    return (force + math.sqrt(force**2 + 2 * 3e4 * energy)) / 3e4


@pytest.mark.parametrize("force", [6.6, -6.6])
def test_full_force_overruns_the_stops_by_little(
    ideal_master: MasterRigParameters, force: float
) -> None:
    rig = MasterRig(ideal_master, 10e3)
    rig.apply_actuator_force(along_actuator(force))
    deepest = max(map(abs, travels(rig, 2000, 10e3)))
    # The force's work over the free travel at the most; 1.5 mm.
    assert 3.8e-3 < deepest < 3.8e-3 + overrun(6.6 * 3.8e-3, 6.6)
    # In the end the stop holds what the centring spring does not.
    held = (6.6 - 266.0 * 3.8e-3) / (3e4 + 266.0)
    assert rig.travel == pytest.approx(-math.copysign(3.8e-3 + held, force), rel=1e-3)
    assert rig.counters()["travel_stops_hit"] >= 1


@pytest.mark.parametrize("frequency", [5.0, 19.0, 40.0])
def test_full_force_back_and_forth_overruns_them_by_little(
    ideal_master: MasterRigParameters, frequency: float
) -> None:
    rig = MasterRig(ideal_master, RATE)
    deepest = 0.0
    for index in range(1000):
        rig.advance(index * PERIOD)
        rig.apply_actuator_force(
            along_actuator(math.copysign(6.6, math.sin(2 * math.pi * frequency * index * PERIOD)))
        )
        deepest = max(deepest, abs(rig.travel))
    # From one stop to the other the force works over twice the free travel.
    assert deepest < 3.8e-3 + overrun(2 * 6.6 * 3.8e-3, 6.6)


def test_a_stop_counts_once_a_visit(ideal_master: MasterRigParameters) -> None:
    damped = replace(ideal_master, handle=HandleParameters(b_s=10.0))
    rig = MasterRig(damped, RATE)
    for visit in (1, 2, 3):
        rig.apply_actuator_force(along_actuator(3.0))
        rig.advance(visit - 1 + 0.1)
        run(rig, 1000 * visit - 850, 1000 * visit - 500)
        assert rig.counters()["travel_stops_hit"] == visit
        rig.apply_actuator_force(along_actuator(0.0))
        run(rig, 1000 * visit - 500, 1000 * visit)


# The hand


def exploring() -> MasterRig:
    return MasterRig(MasterRigParameters(), RATE)


def hold(rig: Rig, first: int, last: int) -> None:
    """Let samples pass, with a command of no force at each, as of a coupling in balance."""
    for index in range(first, last):
        rig.advance(index * PERIOD)
        rig.apply_arm_force((0.0, 0.0, 0.0))


def test_the_hand_rests_until_the_arm_gets_a_force() -> None:
    rig = exploring()
    start = rig.measure().position
    run(rig, 0, 1000)
    rig.apply_actuator_force(along_actuator(0.0))
    run(rig, 1000, 2000)
    assert rig.measure().position == start
    assert start == pytest.approx((0.0, 0.0, 0.010), abs=28e-6)
    hold(rig, 2000, 2700)
    assert rig.measure().position[2] == pytest.approx(-0.0047, abs=1e-3)


@pytest.mark.parametrize("gravity", [0.0, 6.9])
def test_before_the_first_force_another_grip_is_one_from_the_beginning(gravity: float) -> None:
    grip = GripParameters(posture="pinch", gravity=gravity)
    changed, begun = exploring(), MasterRig(MasterRigParameters(grip=grip), RATE)
    changed.hold(grip)
    for rig in (changed, begun):
        rig.apply_actuator_force(along_actuator(1.0))
        run(rig, 0, 50)
    assert changed.measure() == begun.measure()


# Limits and stalls


def test_a_command_beyond_the_peak_is_cut_and_counted(ideal_master: MasterRigParameters) -> None:
    most, more = MasterRig(ideal_master, RATE), MasterRig(ideal_master, RATE)
    most.apply_actuator_force(along_actuator(6.6))
    more.apply_actuator_force(along_actuator(1e6))
    for rig in (most, more):
        run(rig, 0, 20)
    assert more.measure() == most.measure()
    assert most.counters()["actuator_saturated"] == 0
    assert more.counters()["actuator_saturated"] == 1
    more.apply_actuator_force(along_actuator(-math.inf))
    assert more.counters()["actuator_saturated"] == 2


@pytest.mark.parametrize(("command", "steps"), [(0.4, 0), (0.6, 1), (-2.4, -2), (-2.6, -3)])
def test_commands_have_the_converter_s_steps(
    ideal_master: MasterRigParameters, command: float, steps: int
) -> None:
    rig = MasterRig(replace(ideal_master, drive=DriveParameters(bits=14)), RATE)
    step = 2 * 6.6 / 2**14  # 0.8 mN
    rig.apply_actuator_force(along_actuator(command * step))
    run(rig, 0, 2000)
    assert rig.travel == pytest.approx(-steps * step / 266.0, abs=1e-12)


def test_release_takes_all_forces_off(ideal_master: MasterRigParameters) -> None:
    rig = MasterRig(ideal_master, RATE)
    rig.apply_actuator_force(along_actuator(1.0))
    rig.apply_arm_force((1.0, 0.0, 1.0))
    run(rig, 0, 100)
    rig.release()
    energies = run(rig, 100, 1000)
    assert (np.diff(energies) <= 1e-15).all()
    assert energies[-1] < 1e-6 * energies[0]


@pytest.mark.parametrize("stall", [0.2, 3.0, 3600.0])
def test_after_a_stall_the_rig_has_stood_still(stall: float) -> None:
    going, stalled = exploring(), exploring()
    for rig in (going, stalled):
        rig.apply_actuator_force(along_actuator(0.5))
        hold(rig, 0, 1001)
    going.advance(1.0 + LONGEST_ADVANCE)
    stalled.advance(1.0 + stall)
    for index in range(500):
        going.advance(1.0 + LONGEST_ADVANCE + index * PERIOD)
        stalled.advance(1.0 + stall + index * PERIOD)
        for rig in (going, stalled):
            rig.apply_arm_force((0.0, 0.0, 0.0))
        one, other = going.measure(), stalled.measure()
        assert other.position == pytest.approx(one.position, abs=60e-6)
        assert other.velocity == pytest.approx(one.velocity, abs=1e-6)


def test_the_stops_hold_during_a_stall_too(ideal_master: MasterRigParameters) -> None:
    rig = MasterRig(ideal_master, RATE)
    rig.apply_actuator_force(along_actuator(6.6))
    rig.advance(LONGEST_ADVANCE)
    assert abs(rig.travel) < 3.8e-3 + overrun(6.6 * 3.8e-3, 6.6)
    assert rig.counters()["travel_stops_hit"] >= 1


@pytest.mark.parametrize("rate", [50.0, 333.0, 1500.0, 20e3])
def test_the_rate_of_reading_does_not_change_the_motion(rate: float) -> None:
    rig, usual = MasterRig(MasterRigParameters(), rate), exploring()
    for each in (rig, usual):
        each.apply_arm_force((0.0, 0.0, -0.2))
    run(usual, 0, 1001)
    for index in range(round(rate) + 1):
        rig.advance(index / rate)
    assert rig.measure().velocity == pytest.approx(usual.measure().velocity, abs=1e-4)
    assert rig.measure().position == pytest.approx(usual.measure().position, abs=60e-6)


# Instruments


def test_the_accelerometer_saturates_and_counts(ideal_master: MasterRigParameters) -> None:
    small = AccelerometerParameters(range=1.0, noise_density=0.0)
    rig = MasterRig(replace(ideal_master, accelerometer=small), RATE)
    rig.apply_actuator_force(along_actuator(1.0))
    rig.advance(PERIOD)
    assert rig.measure().acceleration[ACTUATOR_AXIS] == 1.0
    assert rig.counters()["accelerometer_saturated"] == 1


# What a real rig has besides


def test_dry_friction_stops_a_small_swing_away_from_the_middle() -> None:
    drive = DriveParameters(coulomb_friction=0.1)
    free = replace(STILL.handle, b_s=0.0, m_h=1e3, k_u=0.0, b_u=0.0)
    rig = MasterRig(replace(STILL, handle=free, drive=drive), RATE)
    rig.disturb(actuator_velocity=0.1)
    amplitudes = [abs(each) for each in travels(rig, 400)]
    # Up to the first turn, kinetic energy goes into the spring and into friction.
    k_s, m_a, force, velocity = 266.0, 0.018, 0.1, 0.1
    first = (math.sqrt(force**2 + k_s * m_a * velocity**2) - force) / k_s
    assert max(amplitudes) == pytest.approx(first, rel=0.02)
    # After that it is within F / k of the middle, and does not swing back.
    assert max(amplitudes[50:]) < force / k_s
    assert all(after <= before for before, after in pairwise(amplitudes[50:]))


def test_friction_held_for_a_sample_is_close_to_friction_that_follows_the_slip(
    ideal_master: MasterRigParameters,
) -> None:
    def shaken(friction: float, reads: int) -> np.ndarray:
        """Return the acceleration under forces of 1 ms, with a number of reads in each."""
        drive = replace(ideal_master.drive, coulomb_friction=friction)
        still = replace(ideal_master, exploration=STILL.exploration, drive=drive)
        rig = MasterRig(still, RATE * reads)
        found = []
        for index in range(500):
            for read in range(reads):
                rig.advance((index + read / reads) * PERIOD)
            found.append(rig.measure().acceleration[ACTUATOR_AXIS])
            rig.apply_actuator_force(
                along_actuator(0.5 * math.sin(2 * math.pi * 80.0 * index * PERIOD))
            )
        return np.array(found)

    free, coarse, fine = shaken(0.0, 1), shaken(0.016, 1), shaken(0.016, 100)
    effect = np.std(fine - free)
    assert effect > 0.02 * np.std(free)
    assert np.std(coarse - fine) < 0.3 * effect


def test_users_differ_from_seed_to_seed_about_the_average_one() -> None:
    average, grip = HandleParameters(), GripParameters(variation=0.2)
    users = [held(average, grip, seed) for seed in range(400)]
    stiffness = np.log([user.k_u / average.k_u for user in users])
    assert abs(stiffness.mean()) < 0.03  # three standard errors
    assert stiffness.std() == pytest.approx(0.2, rel=0.12)
    # The actuator is the same in every hand.
    assert {(user.m_a, user.k_s, user.b_s) for user in users} == {(0.018, 266.0, 2.0)}
    assert held(average, grip, 7) == held(average, grip, 7)


def test_a_handle_turned_upright_sinks_into_the_grip(ideal_master: MasterRigParameters) -> None:
    rig = MasterRig(replace(ideal_master, exploration=STILL.exploration), RATE)
    rig.disturb()
    rig.hold(GripParameters(gravity=6.9))
    run(rig, 1, 2000)
    # Both masses on the grip's spring, the actuator's on its own.
    sample = rig.measure()
    assert sample.position[2] == pytest.approx(-(0.128 + 0.018) * 6.9 / 1500, rel=1e-3)
    assert rig.travel == pytest.approx(-0.018 * 6.9 / 266, rel=1e-3)
    assert sample.acceleration[ACTUATOR_AXIS] == pytest.approx(6.9, abs=1e-3)


@few
@given(
    handle=st.builds(
        HandleParameters,
        m_a=st.floats(1e-3, 1.0),
        k_s=st.floats(0.0, 1e5),
        b_s=st.floats(0.0, 100.0),
        m_h=st.floats(5e-3, 10.0),
        k_u=st.floats(0.0, 1e5),
        b_u=st.floats(0.0, 500.0),
    ),
    mount=st.builds(MountParameters, frequency=st.floats(0.0, 2000.0)),
    drive=st.builds(
        DriveParameters, coulomb_friction=st.floats(0.0, 1.0), delay=st.floats(0.0, 0.02)
    ),
    rate=st.sampled_from([200.0, 1000.0, 5000.0]),
)
def test_whatever_is_physically_possible_runs(
    handle: HandleParameters, mount: MountParameters, drive: DriveParameters, rate: float
) -> None:
    rig = MasterRig(replace(STILL, handle=handle, mount=mount, drive=drive), rate)
    accelerations(rig, range(100), rate, ([1.0] * 10 + [-1.0] * 10) * 5)
    # 1 N on the lightest mass for 0.5 s, and springs that can give back what they got.
    assert rig.energy() < 1e3
    assert math.isfinite(rig.measure().acceleration[ACTUATOR_AXIS])


# Three coils


@pytest.mark.parametrize("mode", [0.0, 287.0])
@pytest.mark.parametrize("delay", [0.0, 68e-6, 1.3e-3])
def test_without_tilts_and_offsets_each_axis_is_that_of_one_coil(
    mode: float, delay: float
) -> None:
    frequency = np.linspace(5.0, 490.0, 50)
    mount = MountParameters(mode, 0.1)
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
    grip = GripParameters(variation=0.15, gravity=6.9)
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
        accelerometer=AccelerometerParameters(bandwidth=100e3),
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


def vector_along(axis: int, value: float) -> Vector:
    x, y, z = (value if axis == each else 0.0 for each in range(3))
    return x, y, z


@pytest.mark.parametrize("turned", [0.0, math.radians(10)])
def test_the_rig_follows_its_response(ideal: Parameters, turned: float) -> None:
    parameters = replace(
        ideal,
        body=BodyParameters(sensor_rotation=turned, sensor_axis="x"),
        mounts=SensorMounts(*(MountParameters(f, 0.1) for f in (240.0, 0.0, 287.0))),
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


# Energy


@few
@given(slow, slow, slow)
def test_without_damping_energy_is_conserved(handle: Vector, coils: Vector, spin: Vector) -> None:
    rig = ThreeAxisRig(replace(STILL_THREE, handle=LOSSLESS), RATE)
    rig.disturb(handle, coils, spin)
    thrown = rig.energy()
    assert run(rig, 0, 300) == pytest.approx([thrown] * 300, rel=1e-9, abs=1e-15)
    assert rig.counters()["travel_stops_hit"] == 0


@few
@given(speeds, speeds | st.tuples(*[st.sampled_from([-3.0, 0.0, 3.0])] * 3))
def test_damping_and_travel_stops_only_take_energy(handle: Vector, coils: Vector) -> None:
    rig = ThreeAxisRig(STILL_THREE, RATE)
    rig.disturb(handle, coils)
    energies = run(rig, 0, 500)
    assert (np.diff(energies) <= 1e-15).all()
    assert energies[-1] <= 1e-3 * energies[0] + 1e-15
    assert rig.counters()["travel_stops_hit"] >= sum(abs(each) == 3.0 for each in coils)


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
    rigs = ThreeAxisRig(STILL_THREE, RATE, 5), MasterRig(MasterRigParameters(), RATE, 5)
    for rig in rigs:
        rig.apply_arm_force((0.0, 0.0, 0.0))
    three, one = (np.array([rig.measure().acceleration for _ in range(4000)]) for rig in rigs)
    assert three[:, 2] == pytest.approx(one[:, 2])
    assert three.std(axis=0) == pytest.approx(AccelerometerParameters().noise, rel=0.05)
    assert np.abs(np.corrcoef(three.T) - np.eye(3)).max() < 0.06


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: BodyParameters(sensor_axis="w"), "sensor_axis = 'w': must be one of x, y, z"),
        (
            lambda: BodyParameters(sensor_rotation=10.0),
            "sensor_rotation = 10.0: must be from -3.14159 to 3.14159 rad",
        ),
        (
            lambda: ThreeAxisRig(replace(STILL_THREE, handle=replace(TABLE_I, m_h=0.03)), RATE),
            "m_h = 0.03: must be above 0.036 kg, the mass of two coils, which move with the"
            " handle",
        ),
    ],
)
def test_impossible_handles_are_refused_in_one_line(wrong: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{message}[^\n]*$"):
        wrong()

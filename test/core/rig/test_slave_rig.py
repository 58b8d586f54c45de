# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated slave: contact and friction by their laws, energy, texture, recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.model import AccelerometerParameters, FloatArray, Vector
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.rig import ArmParameters, Sample
from haptic_accel.core.rig.slave_rig import (
    SlaveRig,
    SlaveRigParameters,
    SurfaceParameters,
    ToolParameters,
)
from haptic_accel.core.tick.rigs import LONGEST_ADVANCE

RATE = 1000.0
PERIOD = 1 / RATE

few = settings(deadline=None, max_examples=20)

LOSSLESS = SlaveRigParameters(
    tool=ToolParameters(viscous_friction=0.0, coulomb_friction=0.0, height=0.001),
    surface=SurfaceParameters(contact_damping=0.0, friction=0.0),
    arm=ArmParameters(position_resolution=0.0),
)
ROUGH = SurfaceParameters(stiffness=6e6, friction=0.35, roughness=6e-6, roughness_exponent=1.5)


def run(rig: SlaveRig, first: int, last: int) -> list[float]:
    """Let samples pass, return the energy at each, J."""
    energies = []
    for index in range(first, last):
        rig.advance(index * PERIOD)
        energies.append(rig.energy())
    return energies


# Free motion


def test_in_the_air_the_arm_s_force_accelerates_the_tool(ideal_slave: SlaveRigParameters) -> None:
    free = replace(ideal_slave, tool=replace(LOSSLESS.tool, height=0.01))
    rig = SlaveRig(free, RATE)
    rig.apply_arm_force((0.06, 7.0, 0.12))
    rig.advance(PERIOD)
    # 0.06 kg, 1 ms; the accelerometer's 500 Hz low-pass has come to 1 - exp(-pi) of 2 m/s^2.
    sample = rig.measure()
    assert sample.velocity == pytest.approx((1e-3, 0.0, 2e-3))
    assert sample.position == pytest.approx((0.5e-6, 0.0, 0.01 + 1e-6), abs=1e-12)
    assert sample.acceleration[ACTUATOR_AXIS] == pytest.approx(
        2.0 * (1 - math.exp(-math.pi)), rel=1e-6
    )
    run(rig, 1, 20)
    assert rig.measure().acceleration[ACTUATOR_AXIS] == pytest.approx(2.0)
    rig.release()
    run(rig, 20, 40)
    assert rig.measure().acceleration[ACTUATOR_AXIS] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("dry", "viscous", "samples", "left"),
    [
        (0.0, 3.0, 20, math.exp(-3.0 * 0.020 / 0.060)),  # v = v0 exp(-b t / m)
        (0.1, 0.0, 100, 1 - 0.1 / 0.060 * 0.1 / 0.5),  # a constant force against the motion
    ],
)
def test_joints_slow_the_tool_as_they_should(
    ideal_slave: SlaveRigParameters, dry: float, viscous: float, samples: int, left: float
) -> None:
    tool = ToolParameters(coulomb_friction=dry, viscous_friction=viscous, height=0.05)
    rig = SlaveRig(replace(ideal_slave, tool=tool), RATE)
    rig.disturb(0.4, 0.3)  # 0.5 m/s
    run(rig, 0, samples + 1)
    assert rig.measure().velocity == pytest.approx((0.4 * left, 0.0, 0.3 * left), rel=1e-3)


def test_the_arm_s_motors_have_their_limit_and_ignore_nan(ideal_slave: SlaveRigParameters) -> None:
    rig = SlaveRig(replace(ideal_slave, tool=LOSSLESS.tool), RATE)
    rig.apply_arm_force((-1e9, 0.0, math.inf))
    rig.advance(PERIOD)
    velocity = 3.3 / 0.060 * PERIOD
    assert rig.measure().velocity == pytest.approx((-velocity, 0.0, velocity))
    rig.apply_arm_force((math.nan, math.nan, math.nan))
    rig.advance(2 * PERIOD)
    assert rig.measure().velocity == pytest.approx((-velocity, 0.0, velocity))


def test_the_actuator_s_force_means_nothing_to_it(ideal_slave: SlaveRigParameters) -> None:
    rig = SlaveRig(ideal_slave, RATE)
    rig.apply_actuator_force(along_actuator(5.0))
    assert run(rig, 0, 100)[-1] == 0.0
    assert rig.measure().position == (0.0, 0.0, 0.01)


# Contact


@pytest.mark.parametrize("stiffness", [1e6, 6e6])
@pytest.mark.parametrize("force", [0.2, 1.0, 3.0])
def test_the_surface_yields_by_hertz_s_law(
    ideal_slave: SlaveRigParameters, stiffness: float, force: float
) -> None:
    surface = SurfaceParameters(stiffness=stiffness)
    tool = ToolParameters(height=0.0)
    rig = SlaveRig(replace(ideal_slave, surface=surface, tool=tool), RATE)
    rig.apply_arm_force((0.0, 0.0, -force))
    run(rig, 0, 3000)
    assert rig.contact_force[2] == pytest.approx(force, rel=1e-4)
    assert rig.measure().position[2] == pytest.approx(-((force / stiffness) ** (2 / 3)), rel=1e-4)


@few
@given(st.floats(-0.2, 0.2), st.floats(-0.3, -0.02))
def test_a_thrown_tool_bounces_without_loss(velocity_x: float, velocity_z: float) -> None:
    rig = SlaveRig(LOSSLESS, RATE)
    rig.disturb(velocity_x, velocity_z)
    thrown = rig.energy()
    assert thrown == pytest.approx(0.06 * (velocity_x**2 + velocity_z**2) / 2)
    energies = run(rig, 0, 100)
    assert energies == pytest.approx([thrown] * len(energies), rel=0.01)
    assert rig.measure().velocity[2] == pytest.approx(-velocity_z, rel=0.01)
    assert rig.measure().velocity[0] == pytest.approx(velocity_x)


@few
@given(st.floats(0.02, 0.3), st.floats(0.05, 0.3))
def test_neither_does_texture_make_energy(velocity_x: float, velocity_z: float) -> None:
    rig = SlaveRig(replace(LOSSLESS, surface=replace(ROUGH, friction=0, contact_damping=0)), RATE)
    rig.disturb(velocity_x, -velocity_z)
    thrown = rig.energy()
    energies = run(rig, 0, 150)
    assert energies == pytest.approx([thrown] * len(energies), rel=0.01)


@few
@given(st.floats(-0.2, 0.2), st.floats(-0.3, 0.0), st.sampled_from([ROUGH, SurfaceParameters()]))
def test_with_friction_and_damping_energy_only_falls(
    velocity_x: float, velocity_z: float, surface: SurfaceParameters
) -> None:
    rig = SlaveRig(SlaveRigParameters(ToolParameters(height=0.0), surface=surface), RATE)
    rig.disturb(velocity_x, velocity_z)
    thrown = rig.energy()
    energies = [thrown, *run(rig, 1, 200)]
    assert (np.diff(energies) <= 1e-6 * thrown + 1e-15).all()


@few
@given(st.floats(0.0, 0.3), st.floats(-0.3, -0.02), st.floats(-3.0, 3.0))
def test_the_surface_only_pushes(velocity_x: float, velocity_z: float, force: float) -> None:
    rig = SlaveRig(replace(LOSSLESS, surface=SurfaceParameters(contact_damping=100.0)), RATE)
    rig.disturb(velocity_x, velocity_z)
    rig.apply_arm_force((0.0, 0.0, force))
    for sample in samples(rig, range(100)):
        force = rig.contact_force[2]
        assert force == 0.0 if sample.position[2] >= 0 else force >= 0.0


def test_damping_takes_more_from_a_harder_blow() -> None:
    # Hunt and Crossley: restitution falls about linearly with the speed of impact.
    restitution = []
    for velocity in (0.02, 0.05, 0.1, 0.2):
        rig = SlaveRig(replace(LOSSLESS, surface=SurfaceParameters(contact_damping=1.5)), RATE)
        rig.disturb(0.0, -velocity)
        run(rig, 0, 150)
        restitution.append(rig.measure().velocity[2] / velocity)
    lost = 1 - np.array(restitution)
    assert (np.diff(lost) > 0).all()
    # For small losses 1 - e = 2/3 of the damping factor times the speed.
    assert lost[:2] == pytest.approx([2 / 3 * 1.5 * 0.02, 2 / 3 * 1.5 * 0.05], rel=0.1)


# Friction and texture


@pytest.mark.parametrize("friction", [0.1, 0.5])
@pytest.mark.parametrize("press", [0.5, 1.0])
def test_sliding_takes_the_force_of_coulomb_s_law(
    ideal_slave: SlaveRigParameters, friction: float, press: float
) -> None:
    # Pulled by what 0.1 m/s should take: mu N, the joints' dry and viscous friction.
    surface = SurfaceParameters(friction=friction)
    rig = SlaveRig(replace(ideal_slave, surface=surface, tool=ToolParameters(height=0.0)), RATE)
    rig.disturb(0.1, 0.0)
    rig.apply_arm_force((friction * press + 0.1 + 3.0 * 0.1, 0.0, -press))
    run(rig, 0, 2000)
    assert rig.measure().velocity[0] == pytest.approx(0.1, rel=0.01)


def drag(speed: float, press: float, surface: SurfaceParameters = ROUGH) -> float:
    """Drag the tool at a speed in m/s pressed by a force in N; return RMS acceleration."""
    parameters = SlaveRigParameters(
        tool=ToolParameters(height=0.0),
        accelerometer=AccelerometerParameters(noise_density=0.0),
        surface=surface,
    )
    rig = SlaveRig(parameters, RATE, seed=1)
    rig.disturb(speed, 0.0)
    pull = surface.friction * press + 0.1 + 3.0 * speed  # what sliding takes
    found = []
    for sample in samples(rig, range(1500)):
        found.append(sample.acceleration[ACTUATOR_AXIS])
        correction = 10.0 * (speed - sample.velocity[0])
        rig.apply_arm_force((pull + correction, 0.0, -press))
    return float(np.std(found[500:]))


def test_faster_strokes_accelerate_the_tool_more() -> None:
    rms = [drag(speed, 1.0) for speed in (0.03, 0.06, 0.12)]
    assert rms[0] > 0.2
    assert rms[1] > 2 * rms[0]
    assert rms[2] > 1.2 * rms[1]


@pytest.mark.parametrize(("speed", "contact_damping"), [(0.2, 15.0), (0.1, 1.5)])
def test_harder_pressing_accelerates_the_tool_more(speed: float, contact_damping: float) -> None:
    # Where the contact is no longer stiff enough to make the tool follow the texture: above
    # its resonance, or near to it with little damping. A slow tool follows however it is
    # pressed, and jumps less.
    surface = replace(ROUGH, contact_damping=contact_damping)
    rms = [drag(speed, press, surface) for press in (0.3, 1.0, 3.0)]
    assert rms[1] > 1.1 * rms[0]
    assert rms[2] > 1.1 * rms[1]


def test_a_rougher_surface_accelerates_the_tool_more() -> None:
    rms = [drag(0.06, 1.0, replace(ROUGH, roughness=height)) for height in (0.0, 2e-6, 6e-6)]
    assert rms[0] < 0.01
    assert rms[0] < rms[1] < rms[2]


def samples(rig: SlaveRig, ticks: Iterable[int], rate: float = RATE) -> Iterator[Sample]:
    """Yield what is measured at ticks."""
    for index in ticks:
        rig.advance(index / rate)
        yield rig.measure()


def measured(rig: SlaveRig, ticks: Iterable[int], rate: float = RATE) -> list[float]:
    """Return the acceleration along the actuator at ticks."""
    return [sample.acceleration[ACTUATOR_AXIS] for sample in samples(rig, ticks, rate)]


def test_the_seed_decides_about_texture_and_noise() -> None:
    parameters = SlaveRigParameters(ToolParameters(height=0.0), surface=ROUGH)

    def motion(seed: int) -> list[float]:
        rig = SlaveRig(parameters, RATE, seed)
        rig.apply_arm_force((1.0, 0.0, -1.0))
        return measured(rig, range(100))

    assert motion(1) == motion(1)
    assert motion(1) != motion(2)


# Recordings

TURN = np.array([1.0, 2.0, 3.0, 4.0, 5.0])


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.5, 0.9])
@pytest.mark.parametrize("rate", [1000.0, 3000.0])
def test_a_recording_is_played_over_and_over_from_the_first_force(
    rate: float, offset: float
) -> None:
    rig = SlaveRig(SlaveRigParameters(), rate, recording=TURN)
    assert measured(rig, range(4), rate) == [0.0] * 4
    # The force comes between two samples, when the coupling has answered.
    rig.advance((3 + offset) / rate)
    rig.apply_arm_force((0.0, 0.0, 0.0))
    played = measured(rig, range(4, 4 + 1002), rate)
    assert played == [1.0 + index % 5 for index in range(1002)]


def test_a_recording_leaves_out_what_was_missed() -> None:
    rig = SlaveRig(SlaveRigParameters(), RATE, recording=TURN)
    rig.apply_arm_force((0.0, 0.0, 0.0))
    assert measured(rig, (1, 2, 5, 6, 11)) == [1.0, 2.0, 5.0, 1.0, 1.0]


def test_a_recording_does_not_touch_the_mechanics() -> None:
    playing = SlaveRig(SlaveRigParameters(), RATE, recording=TURN)
    silent = SlaveRig(SlaveRigParameters(), RATE)
    for rig in (playing, silent):
        rig.apply_arm_force((0.5, 0.0, -1.0))
        run(rig, 0, 300)
    assert playing.measure()[:2] == silent.measure()[:2]


# Time


def test_a_time_that_has_passed_changes_nothing() -> None:
    rig = SlaveRig(LOSSLESS, RATE)
    rig.disturb(0.1, 0.0)
    rig.advance(0.05)
    position = rig.measure().position
    rig.advance(0.05)
    rig.advance(0.01)
    assert rig.measure().position == position
    assert position[0] == pytest.approx(0.1 * 0.05)


@pytest.mark.parametrize("stall", [0.2, 3600.0])
def test_after_a_stall_the_tool_has_stood_still(stall: float) -> None:
    rig = SlaveRig(LOSSLESS, RATE)
    rig.disturb(0.1, 0.0)
    rig.advance(0.05)
    rig.advance(0.05 + stall)
    assert rig.measure().position[0] == pytest.approx(0.1 * (0.05 + LONGEST_ADVANCE))
    rig.advance(0.05 + stall + 0.01)
    assert rig.measure().position[0] == pytest.approx(0.1 * (0.06 + LONGEST_ADVANCE))


# Instruments


def test_positions_have_the_encoders_steps() -> None:
    rig = SlaveRig(replace(LOSSLESS, arm=ArmParameters(position_resolution=55e-6)), RATE)
    rig.disturb(0.01, 0.0)
    steps = {sample.position[0] / 55e-6 for sample in samples(rig, range(20))}
    assert sorted(steps) == pytest.approx([0.0, 1.0, 2.0, 3.0])


def test_the_accelerometer_saturates_and_counts() -> None:
    small = AccelerometerParameters(range=1.0, noise_density=0.0)
    rig = SlaveRig(replace(LOSSLESS, accelerometer=small), RATE)
    rig.apply_arm_force((0.0, 0.0, 3.0))
    rig.advance(PERIOD)
    assert rig.measure().acceleration[ACTUATOR_AXIS] == 1.0
    assert rig.counters() == {"accelerometer_saturated": 1}


# Another surface


def within(name: str) -> st.SearchStrategy[float]:
    """Draw what a parameter of a surface may be."""
    _, specification = schema(SurfaceParameters)[name]
    return st.floats(specification.low, specification.high)


contact = {
    name: within(name) for name in ("stiffness", "friction", "roughness", "roughness_exponent")
}
bumps = {
    name: within(name) for name in ("bump_height", "bump_width", "bump_pitch", "bump_irregularity")
}
surfaces = st.builds(SurfaceParameters, **contact, **bumps)


def pressed(surface: SurfaceParameters = ROUGH) -> SlaveRig:
    """Return a rig whose tip came to rest on a surface under 1 N."""
    rig = SlaveRig(replace(LOSSLESS, tool=ToolParameters(height=1e-4), surface=surface), RATE)
    rig.apply_arm_force((0.0, 0.0, -1.0))
    run(rig, 1, 200)
    return rig


@few
@given(surfaces)
def test_another_surface_presses_as_the_one_before_at_that_moment(
    other: SurfaceParameters,
) -> None:
    rig = pressed()
    before, force = rig.measure(), rig.contact_force[2]
    assert force == pytest.approx(1.0, rel=0.05)
    rig.change_surface(replace(other, contact_damping=ROUGH.contact_damping))
    after = rig.measure()
    assert (after.position, after.velocity) == (before.position, before.velocity)
    # The damping sees another slope, up to that of a steep bump, at what is left of the speed.
    assert rig.contact_force[2] == pytest.approx(force, rel=1e-2)


@few
@given(surfaces, within("contact_damping"), st.floats(0.0, 2e-3))
def test_in_the_air_another_surface_is_not_felt(
    other: SurfaceParameters, contact_damping: float, height: float
) -> None:
    rig = SlaveRig(replace(LOSSLESS, tool=ToolParameters(height=height)), RATE)
    rig.change_surface(replace(other, contact_damping=contact_damping))
    assert rig.contact_force[2] == pytest.approx(0.0, abs=1e-9)
    run(rig, 1, 20)
    assert rig.measure().position[2] == pytest.approx(height, abs=1e-9)


@few
@given(st.lists(surfaces, min_size=1, max_size=3))
def test_dragged_over_any_surfaces_everything_stays_finite(
    others: list[SurfaceParameters],
) -> None:
    rig = pressed()
    rig.apply_arm_force((1.0, 0.0, -1.0))
    for count, other in enumerate(others):
        rig.change_surface(other)
        run(rig, 200 + 50 * count, 250 + 50 * count)
        sample = rig.measure()
        assert all(map(math.isfinite, (*sample.position, *sample.velocity, *sample.acceleration)))


def test_after_lifting_a_changed_surface_is_the_same_as_one_from_the_start() -> None:
    changed = SlaveRig(replace(LOSSLESS, surface=SurfaceParameters()), RATE)
    changed.change_surface(ROUGH)
    begun = SlaveRig(replace(LOSSLESS, surface=ROUGH), RATE)
    for rig in (changed, begun):
        rig.apply_arm_force((0.3, 0.0, -1.0))
    assert run(changed, 1, 300) == run(begun, 1, 300)
    assert changed.measure() == begun.measure()


# Three axes


def with_axes(parameters: SlaveRigParameters, axes: str = "x, y, z") -> SlaveRigParameters:
    return replace(parameters, tool=replace(parameters.tool, axes=axes))


def accelerations(rig: SlaveRig, force: Vector, count: int = 1000) -> FloatArray:
    """Hold a force, return the accelerations of all samples, m/s^2."""
    rig.apply_arm_force(force)
    return np.array([sample.acceleration for sample in samples(rig, range(count))])


def test_more_axes_change_neither_the_motion_nor_z() -> None:
    parameters = SlaveRigParameters(ToolParameters(height=0.0), surface=ROUGH)
    one, three = SlaveRig(parameters, RATE, 3), SlaveRig(with_axes(parameters), RATE, 3)
    of_one, of_three = (accelerations(rig, (1.0, 0.0, -1.0)) for rig in (one, three))
    assert np.array_equal(of_one[:, 2], of_three[:, 2])
    assert not of_one[:, :2].any()
    assert of_three[:, :2].std(axis=0).min() > 0.1
    assert one.measure()[:2] == three.measure()[:2]


def test_in_the_air_x_is_the_arm_s_force_behind_the_low_pass(
    ideal_slave: SlaveRigParameters,
) -> None:
    free = replace(ideal_slave, tool=replace(LOSSLESS.tool, height=0.01))
    found = accelerations(SlaveRig(with_axes(free), RATE), (0.06, 7.0, 0.12), 3)
    risen = 1 - np.exp(-math.pi * np.arange(3))
    assert found[:, 0] == pytest.approx(1.0 * risen, rel=1e-6)
    assert found[:, 2] == pytest.approx(2.0 * risen, rel=1e-6)
    assert not found[:, 1].any()


def test_friction_along_the_stroke_slows_the_tool(ideal_slave: SlaveRigParameters) -> None:
    tool = replace(LOSSLESS.tool, height=0.0)
    soft = SurfaceParameters(friction=0.3, contact_damping=300.0)
    sliding = replace(ideal_slave, tool=tool, surface=soft)
    rig = SlaveRig(with_axes(sliding), RATE)
    rig.disturb(0.5, 0.0)
    found = accelerations(rig, (0.0, 0.0, -1.0), 80)
    # Coulomb: 0.3 of 1 N on 0.06 kg, against the motion.
    assert found[40:, 0] == pytest.approx(-0.3 / 0.06, rel=0.02)


def test_on_a_rough_surface_all_axes_vibrate_independently(
    ideal_slave: SlaveRigParameters,
) -> None:
    surface = replace(ROUGH, friction=0.0)
    dragged = replace(ideal_slave, tool=ToolParameters(height=0.0), surface=surface)
    found = accelerations(SlaveRig(with_axes(dragged), RATE), (0.4, 0.0, -1.0), 3000)[1000:]
    # Without friction x and y are the normal force on slopes along and across the stroke.
    assert found[:, 1].std() == pytest.approx(found[:, 0].std(), rel=0.3)
    assert abs(np.corrcoef(found[:, 0], found[:, 1])[0, 1]) < 0.1


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_added_texture_changes_the_friction_along_the_stroke(
    ideal_slave: SlaveRigParameters, way: float
) -> None:
    sliding = replace(
        ideal_slave, tool=ToolParameters(height=0.0), surface=SurfaceParameters(friction=0.4)
    )
    rigs = [
        SlaveRig(with_axes(sliding), RATE, texture=texture)
        for texture in (None, lambda speed, force: 2.0)
    ]
    for rig in rigs:
        rig.disturb(0.5 * way, 0.0)
    without, with_it = (accelerations(rig, (2.0 * way, 0.0, -1.0), 60)[30:] for rig in rigs)
    assert with_it - without == pytest.approx(
        np.tile((-0.4 * 2.0 * way, 0.0, 2.0), (30, 1)), abs=1e-3
    )


@pytest.mark.parametrize(
    ("axes", "played"), [("z", [0.0, 0.0, 1.0]), ("x, z", [1.0, 0.0, 1.0]), ("x, y, z", [1.0] * 3)]
)
def test_a_recording_of_three_axes_is_played_along_those_of_the_tool(
    axes: str, played: list[float]
) -> None:
    recording = TURN[:, np.newaxis] * (1.0, 10.0, 100.0)
    rig = SlaveRig(with_axes(SlaveRigParameters(), axes), RATE, recording=recording)
    found = accelerations(rig, (0.0, 0.0, 0.0), 12)
    expected = np.resize(recording, (12, 3)) * played
    assert np.array_equal(found, expected)


def test_a_recording_of_one_axis_is_played_along_z_and_of_two_refused() -> None:
    rig = SlaveRig(with_axes(SlaveRigParameters()), RATE, recording=TURN)
    assert np.array_equal(accelerations(rig, (0.0, 0.0, 0.0), 5), np.outer(TURN, (0.0, 0.0, 1.0)))
    with pytest.raises(ParameterError, match=r"^recording: .*\(5, 2\): must be one column, or x"):
        SlaveRig(SlaveRigParameters(), RATE, recording=np.zeros((5, 2)))


def test_axes_that_do_not_exist_are_refused() -> None:
    with pytest.raises(ParameterError, match="^axes = x, w: must be some of x, y, z, in this"):
        ToolParameters(axes="x, w")

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the virtual slave: a tool in a scene."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.model import ZERO, FloatArray, Vector, vector
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Plane
from haptic_accel.core.surfaces.taps import Mode, TapModel
from haptic_accel.core.surfaces.texture import TextureModel
from haptic_accel.core.surfaces.virtual_rig import VirtualRig, VirtualRigParameters
from haptic_accel.core.tick.rigs import RETURN_AFTER

RATE = 1000.0
WHITE = TextureModel(
    "white",
    RATE,
    speeds=np.array([0.0, 0.5, 0.0, 0.5]),
    forces=np.array([0.0, 0.0, 5.0, 5.0]),
    lsf=np.tile(math.pi * np.array([1.0, 2.0]) / 3, (4, 1)),  # those of A(z) = 1
    deviation=np.array([0.0, 0.0, 0.0, 2.0]),
)
MODE = Mode(150.0, 90.0, 100.0)
TAP = TapModel((MODE,))


def scene(texture: TextureModel | None = None, tap: TapModel | None = None) -> Scene:
    return Scene((SceneObject("bench", Plane(), Material("wood", texture=texture, tap=tap)),))


def accelerations(
    rig: VirtualRig, force: Vector, seconds: float, since: float = 0.0
) -> FloatArray:
    """Hold a force; return the acceleration of each sample, m/s^2, shape (n, 3)."""
    found = []
    rig.apply_arm_force(force)
    for index in range(1, round(seconds * RATE) + 1):
        rig.advance(since + index / RATE)
        found.append(rig.measure().acceleration)
    return np.array(found)


def run(rig: VirtualRig, force: Vector, seconds: float, since: float = 0.0) -> FloatArray:
    """Hold a force; return the acceleration of each sample along z, m/s^2."""
    return accelerations(rig, force, seconds, since)[:, ACTUATOR_AXIS]


def touching(texture: TextureModel | None = None, tap: TapModel | None = None) -> VirtualRig:
    parameters = VirtualRigParameters(ToolParameters(height=0.0005, coulomb_friction=0.0))
    return VirtualRig(parameters, scene(texture, tap), RATE, seed=1)


def test_a_tool_stands_still_until_its_first_force() -> None:
    rig = touching(WHITE, TAP)
    rig.advance(1.0)
    assert rig.measure()[:3] == ((0.0, 0.0, pytest.approx(0.0005, abs=30e-6)), ZERO, ZERO)


def test_a_tool_that_rests_is_pressed_back_as_it_presses() -> None:
    rig = touching()
    run(rig, (0.0, 0.0, -1.5), 1.0)
    assert rig.motion.contact is not None
    assert rig.motion.contact.object.name == "bench"
    assert rig.contact_force == pytest.approx((0.0, 0.0, 1.5), abs=1e-3)


def test_the_sample_of_the_contact_has_the_beginning_of_the_tap() -> None:
    rig = touching(tap=TAP)
    onset, speed, found = None, 0.0, []
    rig.apply_arm_force((0.0, 0.0, -1.0))
    for index in range(1, 200):
        rig.advance(index / RATE)
        found.append(rig.measure().acceleration[ACTUATOR_AXIS])
        if onset is None and rig.motion.contact:
            onset, speed = index - 1, rig.motion.contact.impact_speed
    assert onset is not None
    assert not any(found[:onset])
    time = np.arange(1, 21) / RATE
    ringing = MODE.amplitude * speed * np.exp(-90.0 * time) * np.sin(2 * np.pi * 150.0 * time)
    assert found[onset : onset + 20] == pytest.approx(ringing)


def test_a_texture_is_felt_while_the_tool_slides_and_rings_down_in_the_air() -> None:
    rig = touching(WHITE)
    still = run(rig, (0.0, 0.0, -2.0), 0.2)
    sliding = run(rig, (2.0, 0.0, -2.0), 1.0, since=0.2)
    assert not np.any(still)
    assert np.std(sliding[-500:]) > 0.1
    lifted = run(rig, (0.0, 0.0, 3.0), 0.3, since=1.2)
    assert rig.motion.contact is None
    assert rig.contact_force == (0.0, 0.0, 0.0)
    assert np.std(lifted[-100:]) < 1e-6


def test_the_same_seed_gives_the_same_samples() -> None:
    def stroke(seed: int) -> FloatArray:
        rig = VirtualRig(VirtualRigParameters(), scene(WHITE, TAP), RATE, seed)
        return run(rig, (1.0, 0.0, -1.0), 0.5)

    assert np.array_equal(stroke(3), stroke(3))
    assert not np.array_equal(stroke(3), stroke(4))


def test_a_stall_is_not_simulated_afterwards() -> None:
    rig = touching()
    run(rig, (1.0, 0.0, -1.0), 0.1)
    rig.advance(100.0)
    assert rig.measure().position[0] < 0.2


def test_a_tool_that_is_let_go_is_put_back() -> None:
    rig = touching(WHITE, TAP)
    run(rig, (1.0, 0.0, -1.0), 0.5)
    rig.release()
    rig.advance(0.5 + RETURN_AFTER / 2)
    rig.advance(0.5 + 2 * RETURN_AFTER)
    assert rig.measure().position == (0.0, 0.0, pytest.approx(0.0005, abs=30e-6))


def test_another_scene_changes_neither_motion_nor_force_at_that_moment() -> None:
    rig = touching(WHITE)
    run(rig, (1.0, 0.0, -1.5), 0.5)
    before = rig.measure()
    other = Material("rubber", stiffness=800.0, texture=replace(WHITE, name="other"))
    rig.change_scene(Scene((SceneObject("mat", Plane(), other),), name="other"))
    assert rig.measure() == before
    force = rig.contact_force
    run(rig, (1.0, 0.0, -1.5), 1 / RATE, since=0.5)
    assert rig.motion.contact is not None
    assert rig.motion.contact.object.name == "mat"
    assert rig.contact_force[2] == pytest.approx(force[2], rel=0.05)


# Three axes

SLOPE = math.radians(20.0)


def in_three_axes(
    texture: TextureModel | None = None, tap: TapModel | None = None, slope: float = 0.0
) -> VirtualRig:
    """Return a rig above a plane that rises along y by an angle in rad."""
    tool = ToolParameters(height=0.0005, coulomb_friction=0.0, axes="x, y, z")
    material = Material("wood", texture=texture, tap=tap, static_friction=0.4, friction=0.4)
    tilted = Scene((SceneObject("bench", Plane(), material, rotation=(slope, 0.0, 0.0)),))
    return VirtualRig(VirtualRigParameters(tool), tilted, RATE, seed=1)


def test_a_tap_is_felt_along_the_normal_where_the_tool_does_not_slide() -> None:
    rig = in_three_axes(tap=TAP, slope=SLOPE)
    normal = np.array((0.0, -math.sin(SLOPE), math.cos(SLOPE)))
    found = accelerations(rig, vector(-2.0 * normal), 0.3)
    assert np.abs(found[:, 2]).max() > 1.0
    assert found == pytest.approx(np.outer(found @ normal, normal), abs=1e-6)


def test_a_texture_is_felt_along_the_normal_and_in_the_friction() -> None:
    plain, rough = in_three_axes(), in_three_axes(WHITE)
    force = (1.5, 0.0, -2.0)
    still, vibrating = (accelerations(rig, force, 0.5)[200:] for rig in (plain, rough))
    texture = vibrating - still
    assert texture[:, 2].std() > 0.1
    assert texture[:, 0] == pytest.approx(-0.4 * texture[:, 2], rel=0.01, abs=1e-6)
    assert not texture[:, 1].any()


def test_a_tool_that_slips_is_accelerated_along_the_surface() -> None:
    rig = in_three_axes()
    accelerations(rig, (0.0, 0.0, -2.0), 0.5)
    stuck = accelerations(rig, (0.7, 0.0, -2.0), 0.5, since=0.5)
    slipping = accelerations(rig, (1.4, 0.0, -2.0), 0.05, since=1.0)
    # Friction holds 0.8 N; what is left accelerates the tool of 0.06 kg, but for the joints.
    assert np.abs(stuck[-100:]).max() < 1e-3
    assert slipping[:, 0].max() == pytest.approx(0.6 / 0.06, rel=0.1)
    assert slipping[:, 0].sum() / RATE == pytest.approx(rig.measure().velocity[0], rel=0.01)
    assert np.abs(slipping[:, 1]).max() < 1e-9


def test_along_z_alone_it_is_the_vibration_wherever_the_normal_points() -> None:
    one, three = touching(WHITE, TAP), in_three_axes(WHITE, TAP)
    of_one, of_three = (accelerations(rig, (0.0, 0.0, -2.0), 0.3) for rig in (one, three))
    assert of_three[:, 2] == pytest.approx(of_one[:, 2], abs=1e-9)
    assert not of_one[:, :2].any()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""From turns to the tip and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.devices.can.arm import ArticulatedArm, Kinematics, LinearStage, PlanarArm
from haptic_accel.devices.can.parameters import JointParameters, LinkParameters, StageParameters

KINEMATICS: dict[str, Kinematics] = {
    "stage": LinearStage(StageParameters(axis="y", travel=0.02)),
    "planar": PlanarArm(LinkParameters(upper=0.2, fore=0.1)),
    "arm": ArticulatedArm(LinkParameters()),
    "arm, motor in the shoulder": ArticulatedArm(LinkParameters(elbow="shoulder")),
}
STEP = 1e-6  # rad

angles = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
every = pytest.mark.parametrize("kinematics", KINEMATICS.values(), ids=KINEMATICS)


@every
@given(angles=angles)
def test_the_jacobian_is_the_derivative(kinematics: Kinematics, angles: tuple[float, ...]) -> None:
    q = np.array(angles[: len(kinematics.home)])
    for joint, column in enumerate(kinematics.jacobian(q).T):
        step = np.zeros(len(q))
        step[joint] = STEP
        after, before = kinematics.position(q + step), kinematics.position(q - step)
        numeric = (np.array(after) - np.array(before)) / (2 * STEP)
        assert column == pytest.approx(numeric, abs=1e-8)


def test_the_omni_s_arm_at_known_angles() -> None:
    arm = ArticulatedArm(LinkParameters(upper=0.2, fore=0.1))
    quarter = math.pi / 2
    assert arm.position((0.0, 0.0, 0.0)) == pytest.approx((0.2, 0.0, -0.1))
    assert arm.position((quarter, 0.0, 0.0)) == pytest.approx((0.0, 0.2, -0.1))
    # The forearm keeps its direction when the shoulder turns: both motors are in the base.
    assert arm.position((0.0, quarter, 0.0)) == pytest.approx((0.0, 0.0, 0.1))
    assert arm.position((0.0, 0.0, quarter)) == pytest.approx((0.3, 0.0, 0.0))
    other = ArticulatedArm(LinkParameters(upper=0.2, fore=0.1, elbow="shoulder"))
    assert other.position((0.0, quarter, 0.0)) == pytest.approx((0.1, 0.0, 0.2))


def test_the_stage_goes_its_travel_in_a_turn() -> None:
    stage = KINEMATICS["stage"]
    assert stage.position((2 * math.pi,)) == pytest.approx((0.0, 0.02, 0.0))
    # 1 N along 20 mm is as much work as the torque along a turn.
    assert pytest.approx(0.02 / (2 * math.pi)) == stage.jacobian((0.0,)).T @ (9.0, 1.0, 9.0)


@every
@given(waist=st.floats(-1.5, 1.5), shoulder=st.floats(-0.5, 0.5), bend=st.floats(-1.2, 1.2))
def test_angles_bring_the_tip_where_it_was(
    kinematics: Kinematics, waist: float, shoulder: float, bend: float
) -> None:
    """With the elbow above and the tip before the waist, as `angles` has it."""
    q = (waist, shoulder, bend)[-len(kinematics.home) :]
    position = kinematics.position(q)
    assert kinematics.position(kinematics.angles(position)) == pytest.approx(position, abs=1e-9)


@every
@given(position=st.tuples(*[st.floats(-5.0, 5.0)] * 3))
def test_no_position_is_too_far(
    kinematics: Kinematics, position: tuple[float, float, float]
) -> None:
    found = kinematics.angles(position)
    assert len(found) == len(kinematics.home)
    assert all(map(math.isfinite, found))


joints = st.builds(
    JointParameters,
    gear_ratio=st.floats(0.1, 200.0),
    direction=st.sampled_from([-1, 1]),
    offset=st.floats(-3.0, 3.0),
)


@given(joints, st.floats(-100.0, 100.0), st.floats(-10.0, 10.0))
def test_motor_and_joint(joint: JointParameters, turns: float, torque: float) -> None:
    assert joint.turns(joint.angle(turns)) == pytest.approx(turns, abs=1e-9)
    assert joint.joint_torque(joint.motor_torque(torque)) == pytest.approx(torque)
    # The gear loses no power.
    motor = joint.motor_torque(torque) * 2 * math.pi
    assert motor == pytest.approx(torque * joint.angle_per_turn)

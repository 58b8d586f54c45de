# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures that several tests of the core start from."""

from __future__ import annotations

from dataclasses import replace

import pytest

from haptic_accel.core.model import AccelerometerParameters
from haptic_accel.core.rig import ArmParameters, master_rig
from haptic_accel.core.rig.slave_rig import SlaveRigParameters
from haptic_accel.core.simulated_rig import RigParameters


@pytest.fixture
def ideal_accelerometer() -> AccelerometerParameters:
    """Return one without noise and, with steps of 2e-8 m/s^2, as good as without quantisation."""
    return AccelerometerParameters(noise_density=0.0, bits=32)


@pytest.fixture
def ideal_arm() -> ArmParameters:
    return ArmParameters(position_resolution=0.0)


@pytest.fixture
def still_hand() -> master_rig.ExplorationParameters:
    """Return a hand that wants to be at the origin for ever."""
    return master_rig.ExplorationParameters(
        height=0.0, press_depth=0.0, stroke_speed=0.0, stroke_length=0.001, strokes=1
    )


@pytest.fixture
def ideal_master(
    ideal_accelerometer: AccelerometerParameters,
    ideal_arm: ArmParameters,
    still_hand: master_rig.ExplorationParameters,
) -> master_rig.MasterRigParameters:
    """Return Table I with ideal instruments and a hand at rest: nothing but the mechanics."""
    return master_rig.MasterRigParameters(
        drive=master_rig.DriveParameters(bits=32),
        accelerometer=ideal_accelerometer,
        arm=ideal_arm,
        exploration=still_hand,
    )


@pytest.fixture
def ideal_slave(
    ideal_accelerometer: AccelerometerParameters, ideal_arm: ArmParameters
) -> SlaveRigParameters:
    """Return the default tool on a smooth surface, with ideal instruments."""
    return SlaveRigParameters(accelerometer=ideal_accelerometer, arm=ideal_arm)


@pytest.fixture
def ideal_rig(
    ideal_accelerometer: AccelerometerParameters, ideal_slave: SlaveRigParameters
) -> RigParameters:
    """Return both sides with accelerometers without noise; the hand explores a smooth surface."""
    master = replace(RigParameters().master, accelerometer=ideal_accelerometer)
    return RigParameters(master, ideal_slave)

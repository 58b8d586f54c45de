"""Kinematics of arms: turns of motors to motion of the tip, force at the tip to torques.

Base frame: z up, x forwards when the waist is at zero, y to the left (REP-103).

The articulated arm is that of a Phantom Omni without its wrist: link lengths and forward map from
Jarillo-Silva et al., PHANToM OMNI Haptic Device: Kinematic and Manipulability (CERMA 2009), turned
into this frame with its origin in the shoulder. Joint 1 is the waist, about z, positive to the
left. Joint 2 is the shoulder, the upper link's angle above the horizontal. Joint 3 is the elbow,
where both motors are in the base and so independent of each other: the forearm's angle from the
downward vertical, positive forwards.
"""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter

TURN = 2 * math.pi
"""Angle of a full turn, rad."""

OMNI_LINK = 0.135
"""Length of both links of a Phantom Omni, m (Jarillo-Silva et al. 2009, table of L_1 and L_2)."""

OMNI_FORCE = 3.3
"""Largest force of a Phantom Omni, N (data sheet)."""

SHORTEST = 1e-9
"""Shortest distance to divide by, m."""

AXES = ("x", "y", "z")

Angles: TypeAlias = tuple[float, ...]
"""One value per joint: rad, rad/s or N m."""


@dataclass(frozen=True)
class StageParameters(Checked):
    """Linear stage with one motor."""

    axis: str = parameter("z", "axis of motion", choices=AXES)
    travel: float = parameter(
        0.04, "travel per turn of the joint: lead or circumference", unit="m", low=1e-5, high=10.0
    )


@dataclass(frozen=True)
class LinkParameters(Checked):
    """Links of an arm."""

    upper: float = parameter(
        OMNI_LINK, "length from shoulder to elbow (Phantom Omni)", unit="m", low=0.01, high=10.0
    )
    fore: float = parameter(
        OMNI_LINK, "length from elbow to tip (Phantom Omni)", unit="m", low=0.01, high=10.0
    )
    elbow: str = parameter(
        "base",
        "place of the elbow's motor: base, so that its angle is that of the forearm to the"
        " vertical, or shoulder, so that it is that to the upper link's normal",
        choices=("base", "shoulder"),
    )


def node_parameter(node: int) -> Any:
    """Declare the node id of a joint's axis."""
    return parameter(node, "node id of its axis (ODrive: 0 to 63)", low=0, high=63)


@dataclass(frozen=True)
class JointParameters(Checked):
    """Transmission from a motor to its joint."""

    node_id: int = node_parameter(0)
    gear_ratio: float = parameter(
        1.0, "turns of the motor per turn of the joint", low=0.01, high=1e4
    )
    direction: int = parameter(
        1, "1 if the joint turns as its motor does, otherwise -1", low=-1, high=1
    )
    offset: float = parameter(
        0.0, "angle of the joint when the motor is at 0 turns", unit="rad", low=-100.0, high=100.0
    )
    torque_limit: float = parameter(
        OMNI_FORCE * 2 * OMNI_LINK,
        "limit of the motor's torque: 3.3 N at the full reach of a Phantom Omni, without a gear",
        unit="N m",
        low=0.0,
        high=1e3,
    )

    def __post_init__(self) -> None:
        """Check all fields; the direction must not be zero."""
        super().__post_init__()
        if self.direction == 0:
            raise ParameterError("direction = 0: must be 1 or -1")

    @property
    def angle_per_turn(self) -> float:
        """Angle of the joint per turn of the motor, rad."""
        return self.direction * TURN / self.gear_ratio

    def angle(self, turns: float) -> float:
        """Return the joint's angle in rad for turns of its motor."""
        return self.offset + self.angle_per_turn * turns

    def turns(self, angle: float) -> float:
        """Return the motor's turns for an angle of the joint in rad."""
        return (angle - self.offset) / self.angle_per_turn

    def motor_torque(self, torque: float) -> float:
        """Return the motor's torque for one of the joint, N m, without the gear's friction."""
        return self.direction * torque / self.gear_ratio

    def joint_torque(self, torque: float) -> float:
        """Return the joint's torque for a torque of the motor, N m."""
        return self.direction * torque * self.gear_ratio


@dataclass(frozen=True)
class SecondJointParameters(JointParameters):
    """Transmission of the second joint."""

    node_id: int = node_parameter(1)


@dataclass(frozen=True)
class ThirdJointParameters(JointParameters):
    """Transmission of the third joint."""

    node_id: int = node_parameter(2)


class Kinematics(ABC):
    """Relation between the angles of the joints and the position of the tip."""

    home: Angles
    """Angles in the middle of the workspace, far from singularities, rad."""

    @abstractmethod
    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position, m, for angles in rad."""

    @abstractmethod
    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the Jacobian, shape (3, joints), m/rad, at angles in rad."""

    @abstractmethod
    def angles(self, position: Vector) -> Angles:
        """Return the angles, rad, that bring the tip to a position, m, or as near as possible."""


class LinearStage(Kinematics):
    """Motor that moves the tip along an axis."""

    home: Angles = (0.0,)

    def __init__(self, parameters: StageParameters) -> None:
        self._axis = AXES.index(parameters.axis)
        self._jacobian = np.zeros((3, 1))
        self._jacobian[self._axis] = parameters.travel / TURN

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position, m."""
        x, y, z = (self._jacobian @ angles).tolist()
        return x, y, z

    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the travel per angle, m/rad."""
        return self._jacobian

    def angles(self, position: Vector) -> Angles:
        """Return the angle for a position along the axis, rad."""
        return (position[self._axis] / float(self._jacobian[self._axis, 0]),)


class ArticulatedArm(Kinematics):
    """Waist, shoulder and elbow."""

    # Upper link horizontal, forearm hanging: the links are at right angles.
    home: Angles = (0.0, 0.0, 0.0)

    def __init__(self, parameters: LinkParameters) -> None:
        self._upper, self._fore = parameters.upper, parameters.fore
        self._relative = parameters.elbow == "shoulder"

    def _pose(self, angles: Sequence[float]) -> tuple[float, complex, complex]:
        """Return the waist's angle, and both links as lengths outwards + j upwards, m."""
        waist, shoulder, elbow = (0.0, *angles)[-3:]
        if self._relative:
            elbow += shoulder
        return waist, cmath.rect(self._upper, shoulder), -1j * cmath.rect(self._fore, elbow)

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position from the shoulder, m."""
        waist, upper, fore = self._pose(angles)
        tip = upper + fore
        return tip.real * math.cos(waist), tip.real * math.sin(waist), tip.imag

    def jacobian(self, angles: Sequence[float]) -> FloatArray:
        """Return the Jacobian, m/rad.

        It is singular where the links are in line, or the tip is above or below the waist.
        """
        waist, upper, fore = self._pose(angles)
        tip = upper + fore
        cos_waist, sin_waist = math.cos(waist), math.sin(waist)
        columns = [(-tip.real * sin_waist, tip.real * cos_waist, 0.0)]
        for turned in (tip if self._relative else upper, fore):
            by_angle = 1j * turned
            columns.append((by_angle.real * cos_waist, by_angle.real * sin_waist, by_angle.imag))
        return np.array(columns[-len(self.home) :]).T

    def angles(self, position: Vector) -> Angles:
        """Return the angles with the elbow above the line from shoulder to tip, rad."""
        x, y, z = position
        out = math.hypot(x, y)
        distance = math.hypot(out, z)
        # Law of cosines; out of reach, the arm stretches towards the position.
        cosine = (self._upper**2 + distance**2 - self._fore**2) / (
            2 * self._upper * max(distance, SHORTEST)
        )
        shoulder = math.atan2(z, out) + math.acos(min(1.0, max(-1.0, cosine)))
        fore = complex(out, z) - cmath.rect(self._upper, shoulder)
        elbow = math.atan2(fore.real, -fore.imag) - self._relative * shoulder
        return (math.atan2(y, x), shoulder, elbow)[-len(self.home) :]


class PlanarArm(ArticulatedArm):
    """Shoulder and elbow of the articulated arm, in the plane of x and z."""

    home: Angles = ArticulatedArm.home[1:]

    def angles(self, position: Vector) -> Angles:
        """Return the angles with the elbow above the line from shoulder to tip, rad."""
        return super().angles((position[0], 0.0, position[2]))

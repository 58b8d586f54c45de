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

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from haptic_accel.core.model import Vector
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

Columns: TypeAlias = tuple[Vector, ...]
"""A Jacobian, one column a joint: m/s of the tip per rad/s of the joint."""


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


def node_parameter(node: int) -> int:
    """Declare the node id of a joint's axis."""
    declared: int = parameter(node, "node id of its axis (ODrive: 0 to 63)", low=0, high=63)
    return declared


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

    axes: tuple[int, ...]
    """Indices of x, y, z along which the tip can move, as many as joints."""

    home: Angles
    """Angles in the middle of the workspace, far from singularities, rad."""

    @abstractmethod
    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position, m, for angles in rad."""

    @abstractmethod
    def jacobian(self, angles: Sequence[float]) -> Columns:
        """Return the Jacobian, m/rad, at angles in rad."""

    @abstractmethod
    def angles(self, position: Vector) -> Angles:
        """Return the angles, rad, that bring the tip to a position, m, or as near as possible."""


class LinearStage(Kinematics):
    """Motor that moves the tip along an axis."""

    home: Angles = (0.0,)

    def __init__(self, parameters: StageParameters) -> None:
        self.axes = (AXES.index(parameters.axis),)
        per_angle = parameters.travel / TURN
        self._per_angle = per_angle
        x, y, z = (per_angle if axis == parameters.axis else 0.0 for axis in AXES)
        self._column: Vector = (x, y, z)

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position, m."""
        x, y, z = self._column
        return x * angles[0], y * angles[0], z * angles[0]

    def jacobian(self, angles: Sequence[float]) -> Columns:
        """Return the travel per angle, m/rad."""
        return (self._column,)

    def angles(self, position: Vector) -> Angles:
        """Return the angle for a position along the axis, rad."""
        return (position[self.axes[0]] / self._per_angle,)


class ArticulatedArm(Kinematics):
    """Waist, shoulder and elbow."""

    axes = (0, 1, 2)
    # Upper link horizontal, forearm hanging: the links are at right angles.
    home: Angles = (0.0, 0.0, 0.0)

    def __init__(self, parameters: LinkParameters) -> None:
        self._upper, self._fore = parameters.upper, parameters.fore
        self._relative = parameters.elbow == "shoulder"

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position from the shoulder, m."""
        waist, shoulder, elbow = angles
        if self._relative:
            elbow += shoulder
        reach = self._upper * math.cos(shoulder) + self._fore * math.sin(elbow)
        height = self._upper * math.sin(shoulder) - self._fore * math.cos(elbow)
        return reach * math.cos(waist), reach * math.sin(waist), height

    def jacobian(self, angles: Sequence[float]) -> Columns:
        """Return the Jacobian, m/rad.

        It is singular where the links are in line, or the tip is above or below the waist.
        """
        waist, shoulder, elbow = angles
        if self._relative:
            elbow += shoulder
        cos_waist, sin_waist = math.cos(waist), math.sin(waist)
        upper_out, upper_up = self._upper * math.cos(shoulder), self._upper * math.sin(shoulder)
        fore_out, fore_up = self._fore * math.sin(elbow), -self._fore * math.cos(elbow)
        reach = upper_out + fore_out
        by_shoulder_out, by_shoulder_up = -upper_up, upper_out
        by_elbow_out, by_elbow_up = -fore_up, fore_out
        if self._relative:
            by_shoulder_out += by_elbow_out
            by_shoulder_up += by_elbow_up
        return (
            (-reach * sin_waist, reach * cos_waist, 0.0),
            (by_shoulder_out * cos_waist, by_shoulder_out * sin_waist, by_shoulder_up),
            (by_elbow_out * cos_waist, by_elbow_out * sin_waist, by_elbow_up),
        )

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
        elbow = math.atan2(
            out - self._upper * math.cos(shoulder), self._upper * math.sin(shoulder) - z
        )
        return math.atan2(y, x), shoulder, elbow - shoulder if self._relative else elbow


class PlanarArm(Kinematics):
    """Shoulder and elbow of the articulated arm, in the plane of x and z."""

    axes = (0, 2)
    home: Angles = ArticulatedArm.home[1:]

    def __init__(self, parameters: LinkParameters) -> None:
        self._arm = ArticulatedArm(parameters)

    def position(self, angles: Sequence[float]) -> Vector:
        """Return the tip's position from the shoulder, m."""
        return self._arm.position((0.0, *angles))

    def jacobian(self, angles: Sequence[float]) -> Columns:
        """Return the Jacobian, m/rad."""
        return self._arm.jacobian((0.0, *angles))[1:]

    def angles(self, position: Vector) -> Angles:
        """Return the angles with the elbow above the line from shoulder to tip, rad."""
        return self._arm.angles((position[0], 0.0, position[2]))[1:]


def tip_velocity(columns: Columns, velocities: Sequence[float]) -> Vector:
    """Return the tip's velocity, m/s, for those of the joints, rad/s: J times them."""
    x = y = z = 0.0
    for (dx, dy, dz), velocity in zip(columns, velocities, strict=True):
        x += dx * velocity
        y += dy * velocity
        z += dz * velocity
    return x, y, z


def joint_torques(columns: Columns, force: Vector) -> Angles:
    """Return the joints' torques, N m, for a force of the tip, N: J transposed times it."""
    x, y, z = force
    return tuple(dx * x + dy * y + dz * z for dx, dy, dz in columns)

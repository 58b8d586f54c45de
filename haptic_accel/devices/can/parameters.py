# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of an arm on a CAN bus."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass, field
from typing import Any

from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.devices.can.protocol import ERRORS
from haptic_accel.devices.interface import AUTO, MANUAL

KINEMATICS = ("stage", "planar", "arm")
"""Kinematics by number of joints: one, two and three."""

STREAMED, REQUESTED = "streamed", "requested"
"""Transmission of estimates: at the drives' configured rate, or on request."""

OMNI_LINK = 0.135
"""Length of both links of a Phantom Omni, m (Jarillo-Silva et al. 2009, table of L_1 and L_2)."""

OMNI_FORCE = 3.3
"""Largest force of a Phantom Omni, N (data sheet)."""


@dataclass(frozen=True)
class StageParameters(Checked):
    """Linear stage with one motor."""

    axis: str = parameter("z", "axis along which a stage moves", choices=("x", "y", "z"))
    travel: float = parameter(
        0.04, "travel of a stage per turn of its joint: lead or circumference", "m", 1e-5, 10.0
    )


@dataclass(frozen=True)
class LinkParameters(Checked):
    """Links of an arm."""

    upper: float = parameter(
        OMNI_LINK, "length of the link from shoulder to elbow (Phantom Omni)", "m", 0.01, 10.0
    )
    fore: float = parameter(
        OMNI_LINK, "length of the link from elbow to tip (Phantom Omni)", "m", 0.01, 10.0
    )
    elbow: str = parameter(
        "base",
        "position of the elbow's motor: base (its angle is that of the forearm to the"
        " vertical) or shoulder (to the upper link's normal)",
        choices=("base", "shoulder"),
    )


@dataclass(frozen=True)
class JointParameters(Checked):
    """Transmission from a motor to its joint."""

    node_id: int = parameter(0, "node id of the joint's axis (ODrive: 0 to 63)", low=0, high=63)
    gear_ratio: float = parameter(1.0, "motor's turns per turn of the joint", low=0.01, high=1e4)
    direction: int = parameter(
        1, "direction of the joint: 1 if it turns as its motor does, otherwise -1", low=-1, high=1
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
        return self.direction * math.tau / self.gear_ratio

    def angle(self, turns: float) -> float:
        """Return the joint's angle in rad for turns of its motor."""
        return self.offset + self.angle_per_turn * turns

    def turns(self, angle: float) -> float:
        """Return the motor's turns for an angle of the joint in rad."""
        return (angle - self.offset) / self.angle_per_turn

    def motor_torque(self, torque: float) -> float:
        """Return the motor's torque for a joint torque, N m, without gear friction."""
        return self.direction * torque / self.gear_ratio

    def joint_torque(self, torque: float) -> float:
        """Return the joint's torque for a torque of the motor, N m."""
        return self.direction * torque * self.gear_ratio


@dataclass(frozen=True)
class SecondJointParameters(JointParameters):
    """Transmission of the second joint."""

    node_id: int = like(JointParameters, "node_id", 1)


@dataclass(frozen=True)
class ThirdJointParameters(JointParameters):
    """Transmission of the third joint."""

    node_id: int = like(JointParameters, "node_id", 2)


@dataclass(frozen=True)
class CanParameters(Checked):
    """Bus, drives and arm."""

    interface: str = parameter(
        "",
        "python-can interface: socketcan, slcan, pcan, virtual ...; empty for python-can's"
        " configuration",
    )
    channel: str = parameter(
        "",
        "channel of the CAN interface: can0, /dev/ttyACM0 ...; empty for python-can's"
        " configuration",
    )
    bitrate: int = parameter(
        0,
        "bit rate of the bus; 0 for the configuration of python-can or, with socketcan, of the"
        " system",
        unit="bit/s",
        low=0,
        high=1_000_000,
    )
    options: str = parameter(
        "", 'further settings of the CAN interface, as JSON: {"sleep_after_open": 0}'
    )
    context: str = parameter(
        "default", "section of python-can's configuration that takes precedence over [default]"
    )
    firmware: str = parameter(
        "0.6", "firmware of the ODrives, for the names of their errors", choices=tuple(ERRORS)
    )
    estimates: str = parameter(
        STREAMED,
        "encoder estimates: streamed by the drives at their own rate, or requested at every"
        " sample",
        choices=(STREAMED, REQUESTED),
    )
    rearm: str = parameter(
        MANUAL,
        "re-arming after a lost bus or heartbeat returns: auto (at once) or manual (on"
        " request); after an axis error always on request",
        choices=(AUTO, MANUAL),
    )
    start_timeout: float = parameter(
        2.0,
        "longest time for the axes to send heartbeats, and then to enter closed loop",
        unit="s",
        low=0.1,
        high=60.0,
    )
    heartbeat_timeout: float = parameter(
        0.35,
        "time without a heartbeat of an axis after which all torques go to zero (ODrive: one each"
        " 0.1 s)",
        unit="s",
        low=0.005,
        high=10.0,
    )
    estimates_timeout: float = parameter(
        0.05, "age of an axis' estimates above which all torques go to zero", "s", 0.002, 10.0
    )
    kinematics: str = parameter(
        "arm",
        "kinematics of the arm; stage: joint1 moves along an axis; planar: joint1 and joint2 are"
        " shoulder and elbow;"
        " arm: joint1 to joint3 are waist, shoulder and elbow",
        choices=KINEMATICS,
    )
    stage: StageParameters = field(default_factory=StageParameters)
    links: LinkParameters = field(default_factory=LinkParameters)
    joint1: JointParameters = field(default_factory=JointParameters)
    joint2: JointParameters = field(default_factory=SecondJointParameters)
    joint3: JointParameters = field(default_factory=ThirdJointParameters)

    def __post_init__(self) -> None:
        """Check all fields, and that the options are readable and the joints' nodes differ.

        Raises
        ------
        ParameterError
            A value is not allowed; the message names it and the allowed values.
        """
        super().__post_init__()
        self.settings  # noqa: B018
        for (other, first), (name, joint) in itertools.combinations(self.joints.items(), 2):
            if joint.node_id == first.node_id:
                raise ParameterError(
                    f"{name}.node_id = {joint.node_id}: must not be that of {other}"
                )

    @property
    def joints(self) -> dict[str, JointParameters]:
        """Joints of the selected kinematics, by name."""
        count = 1 + KINEMATICS.index(self.kinematics)
        return {name: getattr(self, name) for name in ("joint1", "joint2", "joint3")[:count]}

    @property
    def settings(self) -> dict[str, Any]:
        """Other settings of the interface.

        Raises
        ------
        ParameterError
            The options are not a JSON object.
        """
        try:
            settings = json.loads(self.options or "{}")
        except ValueError:
            settings = None
        if not isinstance(settings, dict):
            raise ParameterError(f"options = {self.options!r}: must be a JSON object")
        return settings


@dataclass(frozen=True)
class CanMasterParameters(CanParameters):
    """Parameters of the master's arm."""

    context: str = like(CanParameters, "context", "master")


@dataclass(frozen=True)
class CanSlaveParameters(CanParameters):
    """Parameters of the slave's arm."""

    context: str = like(CanParameters, "context", "slave")

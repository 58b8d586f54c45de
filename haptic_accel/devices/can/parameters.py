"""What a user may say of an arm on a CAN bus."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.devices.can.kinematics import (
    JointParameters,
    Kinematics,
    LinearStage,
    LinkParameters,
    PlanarArm,
    SecondJointParameters,
    SerialArm,
    StageParameters,
    ThirdJointParameters,
)
from haptic_accel.devices.can.protocol import ERRORS

KINEMATICS = ("stage", "planar", "arm")
"""One, two and three joints."""

AUTO, MANUAL = "auto", "manual"
"""How an arm gets its torques back after it lost its bus."""

STREAMED, REQUESTED = "streamed", "requested"
"""Whether drives send estimates at a rate of their own, or are asked at every sample."""


def context_parameter(context: str) -> str:
    """Declare the section of python-can's configuration."""
    declared: str = parameter(
        context, "section of python-can's configuration that goes over its [default]"
    )
    return declared


@dataclass(frozen=True)
class CanParameters(Checked):
    """The bus, the drives on it, and the arm that they move."""

    interface: str = parameter(
        "", "of python-can: socketcan, slcan, pcan, virtual ...; empty as python-can is configured"
    )
    channel: str = parameter(
        "", "of the interface: can0, /dev/ttyACM0 ...; empty as python-can is configured"
    )
    bitrate: int = parameter(
        0,
        "of the bus; 0 as python-can or, with socketcan, the system is configured",
        unit="bit/s",
        low=0,
        high=1_000_000,
    )
    options: str = parameter(
        "", 'other settings of the interface, as JSON: {"sleep_after_open": 0}'
    )
    context: str = context_parameter("default")
    firmware: str = parameter(
        "0.6", "of the ODrives, for the names of their errors", choices=tuple(ERRORS)
    )
    estimates: str = parameter(
        STREAMED,
        "streamed by the drives at a rate of their own, or requested at every sample",
        choices=(STREAMED, REQUESTED),
    )
    rearm: str = parameter(
        MANUAL,
        "whether torques come back by themselves when a bus or a heartbeat that was lost does;"
        " after an axis error they never do",
        choices=(AUTO, MANUAL),
    )
    start_timeout: float = parameter(
        2.0,
        "for the axes to be heard, and then for them to be in closed loop",
        unit="s",
        low=0.1,
        high=60.0,
    )
    heartbeat_timeout: float = parameter(
        0.35,
        "silence of an axis after which all torques go to zero (ODrive: a heartbeat each 0.1 s)",
        unit="s",
        low=0.005,
        high=10.0,
    )
    estimates_timeout: float = parameter(
        0.05,
        "age of an axis' estimates from which on all torques go to zero",
        unit="s",
        low=0.002,
        high=10.0,
    )
    kinematics: str = parameter(
        "arm",
        "stage: joint1 moves along an axis; planar: joint1 and joint2 are shoulder and elbow;"
        " arm: joint1 to joint3 are waist, shoulder and elbow",
        choices=KINEMATICS,
    )
    stage: StageParameters = field(default_factory=StageParameters)
    links: LinkParameters = field(default_factory=LinkParameters)
    joint1: JointParameters = field(default_factory=JointParameters)
    joint2: JointParameters = field(default_factory=SecondJointParameters)
    joint3: JointParameters = field(default_factory=ThirdJointParameters)

    def __post_init__(self) -> None:
        """Check all fields, that options can be read, and that no two joints are one axis.

        Raises
        ------
        ParameterError
            Naming the value and what is allowed.
        """
        super().__post_init__()
        self.settings  # noqa: B018
        seen: dict[int, str] = {}
        for name, joint in self.joints.items():
            if joint.node_id in seen:
                raise ParameterError(
                    f"{name}.node_id = {joint.node_id}: must not be that of {seen[joint.node_id]}"
                )
            seen[joint.node_id] = name

    @property
    def joints(self) -> dict[str, JointParameters]:
        """The joints that there are, by name."""
        count = 1 + KINEMATICS.index(self.kinematics)
        all_joints = {"joint1": self.joint1, "joint2": self.joint2, "joint3": self.joint3}
        return dict(list(all_joints.items())[:count])

    @property
    def settings(self) -> dict[str, Any]:
        """The other settings of the interface.

        Raises
        ------
        ParameterError
            They are no JSON object.
        """
        if not self.options:
            return {}
        try:
            settings = json.loads(self.options)
        except ValueError:
            settings = None
        if not isinstance(settings, dict):
            raise ParameterError(f"options = {self.options!r}: must be a JSON object")
        return settings

    def arm(self) -> Kinematics:
        """Return where the tip is for the angles of the joints."""
        if self.kinematics == "stage":
            return LinearStage(self.stage)
        if self.kinematics == "planar":
            return PlanarArm(self.links)
        return SerialArm(self.links)


@dataclass(frozen=True)
class CanMasterParameters(CanParameters):
    """Of the master's arm."""

    context: str = context_parameter("master")


@dataclass(frozen=True)
class CanSlaveParameters(CanParameters):
    """Of the slave's arm."""

    context: str = context_parameter("slave")

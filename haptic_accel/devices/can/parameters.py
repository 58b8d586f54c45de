"""Parameters of an arm on a CAN bus."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, field
from typing import Any

from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.devices.can.kinematics import (
    ArticulatedArm,
    JointParameters,
    Kinematics,
    LinearStage,
    LinkParameters,
    PlanarArm,
    SecondJointParameters,
    StageParameters,
    ThirdJointParameters,
)
from haptic_accel.devices.can.protocol import ERRORS
from haptic_accel.devices.connection import AUTO, MANUAL

KINEMATICS = ("stage", "planar", "arm")
"""Kinematics by number of joints: one, two and three."""

STREAMED, REQUESTED = "streamed", "requested"
"""Transmission of estimates: by the drives at a rate of their own, or on request."""


def context_parameter(context: str) -> Any:
    """Declare the section of python-can's configuration file."""
    return parameter(
        context, "section of python-can's configuration that takes precedence over [default]"
    )


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
        "channel of the interface: can0, /dev/ttyACM0 ...; empty for python-can's configuration",
    )
    bitrate: int = parameter(
        0,
        "bit rate; 0 for the configuration of python-can or, with socketcan, of the system",
        unit="bit/s",
        low=0,
        high=1_000_000,
    )
    options: str = parameter(
        "", 'other settings of the interface, as JSON: {"sleep_after_open": 0}'
    )
    context: str = context_parameter("default")
    firmware: str = parameter(
        "0.6", "firmware of the ODrives, for the names of their errors", choices=tuple(ERRORS)
    )
    estimates: str = parameter(
        STREAMED,
        "transmission of estimates: streamed by the drives at a rate of their own, or requested"
        " at every sample",
        choices=(STREAMED, REQUESTED),
    )
    rearm: str = parameter(
        MANUAL,
        "return of the torques after a lost bus or heartbeat is back: auto, at once, or manual, on"
        " request; after an axis error always on request",
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
        0.05,
        "age of an axis' estimates above which all torques go to zero",
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
        """Check all fields, that options can be read, and that no two joints share a node.

        Raises
        ------
        ParameterError
            A value is not allowed; the message names it and the allowed ones.
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
        """Joints of these kinematics, by name."""
        joints = self.joint1, self.joint2, self.joint3
        count = 1 + KINEMATICS.index(self.kinematics)
        return {f"joint{place + 1}": joints[place] for place in range(count)}

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

    def arm(self) -> Kinematics:
        """Return the kinematics with the parameters of stage or links."""
        if self.kinematics == "stage":
            return LinearStage(self.stage)
        if self.kinematics == "planar":
            return PlanarArm(self.links)
        return ArticulatedArm(self.links)


@dataclass(frozen=True)
class CanMasterParameters(CanParameters):
    """Parameters of the master's arm."""

    context: str = context_parameter("master")


@dataclass(frozen=True)
class CanSlaveParameters(CanParameters):
    """Parameters of the slave's arm."""

    context: str = context_parameter("slave")

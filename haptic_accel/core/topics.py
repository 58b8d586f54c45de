# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics of the graph: names, types, frames and quality of service (no ROS imported)."""

from __future__ import annotations

from dataclasses import dataclass, replace

ARMS = ("master", "slave")
"""The two arms, which are also the sides of a coupling between two hosts."""

MASTER_FRAME = "master_base"
SLAVE_FRAME = "slave_base"
HANDLE_FRAME = "master_handle"
TOOL_FRAME = "slave_tool"


@dataclass(frozen=True)
class Topic:
    """Description of a topic.

    Attributes
    ----------
    name : str
        Relative to the graph's namespace unless it starts with a slash; CRTK's name if one exists.
    type : str
        ROS message type.
    frame : str
        frame_id of its messages.
    source : str
        Arm whose samples determine its stamps: master or slave.
    reliable : bool
        True for reliable subscriptions (events), False for best effort (signals, "sensor data").
    latched : bool
        True if later subscribers receive the last message ("transient local").
    """

    name: str
    type: str
    frame: str
    source: str
    reliable: bool = False
    latched: bool = False


_POSE = "geometry_msgs/msg/PoseStamped"
_TWIST = "geometry_msgs/msg/TwistStamped"
_WRENCH = "geometry_msgs/msg/WrenchStamped"
_ACCEL = "geometry_msgs/msg/AccelStamped"
_VECTOR = "geometry_msgs/msg/Vector3Stamped"
_BOOL = "std_msgs/msg/Bool"

VECTORS = {
    _POSE: "pose.position",
    _TWIST: "twist.linear",
    _WRENCH: "wrench.force",
    _ACCEL: "accel.linear",
    _VECTOR: "vector",
}
"""Path of the vector in each type of signal."""

MASTER_POSITION = Topic("master/measured_cp", _POSE, MASTER_FRAME, "master")
MASTER_VELOCITY = Topic("master/measured_cv", _TWIST, MASTER_FRAME, "master")
MASTER_ARM_FORCE = Topic("master/servo_cf", _WRENCH, MASTER_FRAME, "slave")
HANDLE_ACCELERATION = Topic("master/handle/acceleration", _ACCEL, HANDLE_FRAME, "master")
ACTUATOR_FORCE = Topic("master/handle/servo_cf", _WRENCH, HANDLE_FRAME, "slave")
HAND_SET_POINT = Topic("master/hand/setpoint_cp", _POSE, MASTER_FRAME, "master")
MASTER_WORK = Topic("master/work", _VECTOR, MASTER_FRAME, "master")
SLAVE_WORK = Topic("slave/work", _VECTOR, SLAVE_FRAME, "slave")
CONTACT_FORCE = Topic("slave/contact_force", _WRENCH, SLAVE_FRAME, "slave")
SLAVE_POSITION = Topic("slave/measured_cp", _POSE, SLAVE_FRAME, "slave")
SLAVE_VELOCITY = Topic("slave/measured_cv", _TWIST, SLAVE_FRAME, "slave")
SLAVE_ARM_FORCE = Topic("slave/servo_cf", _WRENCH, SLAVE_FRAME, "master")
TOOL_ACCELERATION = Topic("slave/tool/acceleration", _ACCEL, TOOL_FRAME, "slave")
DESIRED_ACCELERATION = Topic("compensator/desired_acceleration", _ACCEL, HANDLE_FRAME, "slave")
JOINT_STATES = Topic("joint_states", "sensor_msgs/msg/JointState", "", "", reliable=True)
JOINT_STATE_RATE = 50.0
"""Rate of joint states for displays, Hz: more than a screen shows."""

DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "", "", reliable=True)
PARAMETER_EVENTS = Topic(
    "/parameter_events", "rcl_interfaces/msg/ParameterEvent", "", "", reliable=True
)
"""Changes of parameters of all nodes: controller, surface or grip set in a running graph."""

DESCRIPTION = Topic("description", "std_msgs/msg/String", "", "", reliable=True, latched=True)
"""Parameters of each node of the graph as JSON, for recorders; see `bags.trial_metadata`. All
nodes publish to it, again after a change."""

EMERGENCY_STOP = Topic("estop", _BOOL, "", "", reliable=True, latched=True)
COMMON_STOP = replace(EMERGENCY_STOP, name=f"/{EMERGENCY_STOP.name}")
"""Emergency stop of the graphs in all namespaces."""

STOPS = tuple(
    each
    for topic in (EMERGENCY_STOP, COMMON_STOP)
    for each in (topic, replace(topic, reliable=False, latched=False))
)
"""Subscriptions of the emergency stop: to latched messages, and to publishers with weaker
settings, such as ``ros2 topic pub``."""

COUPLER_STOPPED = Topic("coupler/stopped", _BOOL, "", "", reliable=True, latched=True)
"""State of the coupler, true while stopped. Unlike `EMERGENCY_STOP` it has one sender, the
coupler."""

MASTER_STOPPED = Topic("master/stopped", _BOOL, "", "", reliable=True, latched=True)
SLAVE_STOPPED = Topic("slave/stopped", _BOOL, "", "", reliable=True, latched=True)

SIGNALS = (
    MASTER_POSITION,
    MASTER_VELOCITY,
    MASTER_ARM_FORCE,
    HANDLE_ACCELERATION,
    ACTUATOR_FORCE,
    SLAVE_POSITION,
    SLAVE_VELOCITY,
    SLAVE_ARM_FORCE,
    TOOL_ACCELERATION,
    DESIRED_ACCELERATION,
)
"""Sampled topics, each a stamped vector."""

BUNDLES = Topic("_bundles", "std_msgs/msg/UInt8MultiArray", "", "", reliable=True)
"""Samples of `SIGNALS` as sent by each process, bundled over some hundredths of a second, for the
recorder. ROS tools hide names with an underscore."""

ON_DEMAND = (MASTER_WORK, SLAVE_WORK, CONTACT_FORCE)
"""Sampled topics that are published only while they have a subscriber."""

ANALYSED = (TOOL_ACCELERATION, DESIRED_ACCELERATION, HANDLE_ACCELERATION, ACTUATOR_FORCE)
"""Signals for the analysis, along the actuator's axis."""


@dataclass(frozen=True)
class ArmTopics:
    """Topics of one arm's device.

    Attributes
    ----------
    position, velocity, acceleration : Topic
        Signals published by the device.
    arm_force, actuator_force : Topic
        Signals applied by the device; an arm without an actuator has no `actuator_force`.
    contact_force : Topic
        Force of the surface on the tool, N, if known and while there is a subscriber; None for an
        arm without a tool.
    stopped : Topic
        State published by the device: true during an emergency stop.
    work : Topic
        Work of its force per axis since the device was opened, J, while there is a subscriber.
    """

    position: Topic
    velocity: Topic
    acceleration: Topic
    arm_force: Topic
    stopped: Topic
    work: Topic
    actuator_force: Topic | None = None
    contact_force: Topic | None = None

    def topic(
        self, name: str, kind: str, *, reliable: bool = True, latched: bool = False
    ) -> Topic:
        """Return another topic of this arm, by CRTK's name, in the frame of its positions."""
        arm, frame = self.position.source, self.position.frame
        return Topic(f"{arm}/{name}", kind, frame, arm, reliable, latched)


MASTER = ArmTopics(
    MASTER_POSITION,
    MASTER_VELOCITY,
    HANDLE_ACCELERATION,
    MASTER_ARM_FORCE,
    MASTER_STOPPED,
    MASTER_WORK,
    ACTUATOR_FORCE,
)
SLAVE = ArmTopics(
    SLAVE_POSITION,
    SLAVE_VELOCITY,
    TOOL_ACCELERATION,
    SLAVE_ARM_FORCE,
    SLAVE_STOPPED,
    SLAVE_WORK,
    contact_force=CONTACT_FORCE,
)

DEVICES = {"slave_device": SLAVE, "master_device": MASTER}
"""Topics of each device node by its name; the user's device comes last."""

SLAVE_SIGNALS = (TOOL_ACCELERATION, SLAVE_POSITION, SLAVE_VELOCITY)
"""Signals of the slave's device; the first is the cause of the actuator's force."""

PLAYED = "played"
"""Prefix of the slave's signals published by `ros2 bag play`."""

TOPICS = (
    *SIGNALS,
    DESCRIPTION,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    COUPLER_STOPPED,
    MASTER_STOPPED,
    SLAVE_STOPPED,
)
"""All topics of the graph; the recorder stores all of them."""


def reporter(status: str) -> tuple[str, str]:
    """Return namespace and name of the node of a diagnostic status, "left/node: task".

    The namespace starts with a slash, and is empty for the root.
    """
    namespace, slash, node = status.partition(":")[0].rpartition("/")
    return slash + namespace, node

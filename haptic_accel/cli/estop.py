"""``haptic-accel estop``: the emergency stop from a terminal, and its release."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_accel.cli.options import arguments, verb
from haptic_accel.core.parameters import parameter
from haptic_accel.core.topics import EMERGENCY_STOP, MASTER_STOPPED, SLAVE_STOPPED
from haptic_accel.graph.claims import own_domain, stop_senders
from haptic_accel.graph.namespaces import NamespaceArguments

if TYPE_CHECKING:
    from rclpy.node import Node

PATIENCE = 2.5
"""Time-out for both devices to be found and to confirm, s, before the graph is joined anew."""

ATTEMPTS = 3
"""Number of times to join the graph. A process that joins in the same moment as a device may not
find it for more than 5 s; one that joins afterwards finds it at once."""

COUPLER_PATIENCE = 1.0
"""Time-out for the coupler after the devices, which stop without it, s."""

LOOK_PERIOD = 0.01
"""Interval between looks at the answers while no message comes, s."""

DEVICES = {MASTER_STOPPED: "master_device", SLAVE_STOPPED: "slave_device"}
"""Devices by the topic on which they confirm."""


@dataclass(frozen=True)
class StopArguments(NamespaceArguments):
    """Arguments of the emergency stop."""

    release: bool = parameter(False, "allow forces again")


@verb(
    "haptic-accel estop",
    "haptic-accel estop release:=true",
    "haptic-accel estop namespace:=left",
)
@arguments(StopArguments)
def estop(arguments: StopArguments) -> None:
    """Remove all forces from both devices at once; they refuse new ones until release:=true."""
    stop = not arguments.release
    # By signals first: ROS takes a while to import, and to join the graph.
    signalled = stop_senders(own_domain(), arguments.namespace) if stop else 0
    quick = f"{signalled} processes signalled after {_age():.2f} s, " if signalled else ""
    from haptic_accel.cli.joining import CallError, connected

    for _ in range(ATTEMPTS):
        with connected(arguments.namespace) as node:
            missing, coupler_answers = _confirmed(node, stop)
        if not missing:
            break
    else:
        names, seconds = " and ".join(missing), ATTEMPTS * PATIENCE
        raise CallError(f"{names} did not confirm within {seconds:g} s; is the graph running?")
    done = ": both devices are without force"
    if not stop:
        done = " released: both devices take forces again"
    print(
        f"emergency stop{done} ({quick}confirmed after {_age():.2f} s)"
        f"{'' if coupler_answers else '; the coupler does not answer'}"
    )


def _age() -> float:
    """Return the time since this process was started, s (proc(5), stat)."""
    stat = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
    started = int(stat[19]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started


def _confirmed(node: Node, stop: bool) -> tuple[list[str], bool]:
    """Return the devices that did not confirm, and true if the coupler did."""
    import rclpy
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Bool
    from std_srvs.srv import SetBool

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    # The topic first: it reaches the devices even if no other node is left.
    publisher = node.create_publisher(Bool, EMERGENCY_STOP.name, latched)
    publisher.publish(Bool(data=stop))
    answers: dict[str, bool] = {}
    for topic, device in DEVICES.items():
        node.create_subscription(
            Bool,
            topic.name,
            lambda message, device=device: answers.__setitem__(device, message.data),
            latched,
        )
    client = node.create_client(SetBool, EMERGENCY_STOP.name)
    coupler = None
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if coupler is None and client.service_is_ready():
            coupler = client.call_async(SetBool.Request(data=stop))
        missing = [device for device in DEVICES.values() if answers.get(device) is not stop]
        if not missing and coupler is not None and coupler.done():
            return [], True
        if not missing:
            deadline = min(deadline, time.monotonic() + COUPLER_PATIENCE)
        rclpy.spin_once(node, timeout_sec=LOOK_PERIOD)
    return missing, False

"""``haptic-accel estop``: the emergency stop from a terminal, and its release."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from haptic_accel.cli.options import Verb, words
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.process import DONE, FAILED
from haptic_accel.core.topics import EMERGENCY_STOP, MASTER_STOPPED, SLAVE_STOPPED
from haptic_accel.graph.words import parse_words

if TYPE_CHECKING:
    from haptic_accel.cli.calling import Caller

PATIENCE = 5.0
"""How long both devices may take to be found, and to confirm, s."""

COUPLER_PATIENCE = 1.0
"""How long the coupler may take after them, s: they stop without it."""

LOOK_PERIOD = 0.05
"""How often what is waited for is looked at while no message comes, s."""

DEVICES = {MASTER_STOPPED: "master_device", SLAVE_STOPPED: "slave_device"}
"""Who confirms on which topic."""


@dataclass(frozen=True)
class StopArguments(Checked):
    """What can be said."""

    release: bool = parameter(False, "allow forces again")
    namespace: str = parameter("", "of the graph")


@click.command(cls=Verb, examples=["haptic-accel estop", "haptic-accel estop release:=true"])
@words(StopArguments)
def estop(words: Sequence[str]) -> int:
    """Remove all forces from both devices at once; they refuse new ones until release:=true."""
    arguments = parse_words(words, StopArguments)
    # ROS takes a while to import: only who talks to it waits for that.
    from haptic_accel.cli.calling import connected

    stop = not arguments.release
    with connected(arguments.namespace) as caller:
        missing, coupler_answers = _confirmed(caller, stop)
    if missing:
        print(
            f"haptic-accel: {' and '.join(missing)} did not confirm within {PATIENCE:g} s;"
            " is the graph running?",
            file=sys.stderr,
        )
        return FAILED
    done = "both devices are without force" if stop else "both devices take forces again"
    said = "emergency stop" if stop else "emergency stop released"
    print(f"{said}: {done}" + ("" if coupler_answers else "; the coupler does not answer"))
    return DONE


def _confirmed(caller: Caller, stop: bool) -> tuple[list[str], bool]:
    """Ask devices and coupler; return the devices that did not confirm, and if the coupler did."""
    import rclpy
    from std_msgs.msg import Bool
    from std_srvs.srv import SetBool

    from haptic_accel.nodes.interface import quality

    node = caller.node
    # The topic first: a device hears it even when nobody else is left.
    publisher = node.create_publisher(Bool, EMERGENCY_STOP.name, quality(EMERGENCY_STOP, 1))
    publisher.publish(Bool(data=stop))
    answers: dict[str, bool] = {}
    for topic, device in DEVICES.items():
        node.create_subscription(
            Bool,
            topic.name,
            lambda message, device=device: answers.__setitem__(device, message.data),
            quality(topic),
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

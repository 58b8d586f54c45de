# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel estop``: the emergency stop from a terminal, and its release."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptic_accel.cli.options import arguments, verb
from haptic_accel.core.parameters import parameter
from haptic_accel.core.topics import (
    COMMON_STOP,
    EMERGENCY_STOP,
    MASTER,
    SLAVE,
    ArmTopics,
    Topic,
)
from haptic_accel.graph.claims import own_domain, stop_senders
from haptic_accel.graph.namespaces import NamespaceArguments

if TYPE_CHECKING:
    from rclpy.node import Node

PATIENCE = 2.5
"""Time-out for the devices to be found and to confirm, s, before the graph is joined anew."""

ATTEMPTS = 3
"""Number of times to join the graph. A process that joins in the same moment as a device may not
find it for more than 5 s; one that joins afterwards finds it at once."""

LEAST_LOOK = 0.5
"""Time for which graphs are looked for, s."""

ANSWERING_TIME = 1.5
"""Time-out for a service to be found, and to answer, s: the coupler waits 1 s for the devices."""

REASON_TIME = 3.0
"""Time for which a refused release is asked for again, s: the reason may just have gone."""

LOOK_PERIOD = 0.01
"""Interval between looks at the answers while no message comes, s."""

DEVICES = {MASTER: "master_device", SLAVE: "slave_device"}
"""Devices by the topics of their arms."""


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
    """Remove all forces from all devices at once; they refuse new ones until release:=true.

    Without a namespace every graph of the ROS domain is stopped. The release is that of one graph,
    and refused while somebody still asks for the stop.
    """
    if arguments.release:
        print(f"emergency stop {_release(arguments.namespace)}")
        return
    # By signals first: ROS takes a while to import, and to join the graph.
    signalled = stop_senders(own_domain(), arguments.namespace)
    quick = f"{signalled} processes signalled after {_age():.2f} s, " if signalled else ""
    from haptic_accel.cli.joining import CallError, connected

    topic = EMERGENCY_STOP if arguments.namespace else COMMON_STOP
    for _ in range(ATTEMPTS):
        with connected(arguments.namespace) as node:
            confirmed, missing = _stop(node, topic)
        if not missing:
            break
    else:
        names, seconds = " and ".join(missing), ATTEMPTS * PATIENCE
        raise CallError(f"{names} did not confirm within {seconds:g} s; is the graph running?")
    devices = {1: "the device is", 2: "both devices are"}.get(
        len(confirmed), f"all {len(confirmed)} devices are"
    )
    print(f"emergency stop: {devices} without force ({quick}confirmed after {_age():.2f} s)")


def _age() -> float:
    """Return the time since this process was started, s (proc(5), stat)."""
    stat = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
    started = int(stat[19]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started


def _stop(node: Node, topic: Topic) -> tuple[set[str], set[str]]:
    """Publish the stop; return the full names of devices that confirmed, and that did not."""
    import rclpy
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Bool

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(Bool, topic.name, latched).publish(Bool(data=True))
    answers: dict[str, bool] = {}
    asked: set[str] = set()
    begin = time.monotonic()
    while (passed := time.monotonic() - begin) < PATIENCE:
        # Anew each time: that an arm is elsewhere is known when its coupler has been found.
        devices = dict(_devices(node, everywhere=topic is COMMON_STOP))
        asked = set(devices)
        for device, name in devices.items():
            if device not in answers:
                answers[device] = False
                node.create_subscription(
                    Bool,
                    name,
                    lambda message, device=device: answers.update({device: message.data}),
                    latched,
                )
        if asked and all(answers[device] for device in asked) and passed >= LEAST_LOOK:
            break
        rclpy.spin_once(node, timeout_sec=LOOK_PERIOD)
    confirmed = {device for device in asked if answers[device]}
    return confirmed, (asked or set(DEVICES.values())) - confirmed


def _devices(node: Node, *, everywhere: bool) -> Iterator[tuple[str, str]]:
    """Yield the full names of the devices that must confirm, and of the topics where they do."""
    namespaces = {node.get_namespace().rstrip("/")}
    if everywhere:
        namespaces = {
            name.removesuffix(f"/{topic.name}")
            for name, _ in node.get_topic_names_and_types()
            for arm in DEVICES
            if name.endswith(f"/{(topic := arm.stopped).name}") and node.count_publishers(name)
        }
    for namespace in namespaces:
        for arm, device in DEVICES.items():
            if not _is_elsewhere(node, namespace, arm):
                yield f"{namespace}/{device}".removeprefix("/"), f"{namespace}/{arm.stopped.name}"


def _is_elsewhere(node: Node, namespace: str, arm: ArmTopics) -> bool:
    """Return whether an arm is on a peer host, so that the coupler says here where it is."""
    senders = node.get_publishers_info_by_topic(f"{namespace}/{arm.position.name}")
    return any(sender.node_name == "coupler" for sender in senders)


def _release(namespace: str) -> str:
    """Release the graph of a namespace; return a line that says who takes forces again."""
    from haptic_accel.cli.joining import CallError, connected

    for _ in range(ATTEMPTS):
        with connected(namespace) as node:
            answers = _answers(node)
            deadline = time.monotonic() + REASON_TIME
            while (refused := _refusals(answers)) and time.monotonic() < deadline:
                time.sleep(LOOK_PERIOD)
                answers = _answers(node)
        if refused:
            raise CallError(f"emergency stop is not released: {refused}")
        if all(answers.values()):
            break
    else:
        missing = " and ".join(name for name, answer in answers.items() if not answer)
        raise CallError(f"{missing} did not answer; is the graph running?")
    if EMERGENCY_STOP.name in answers:
        return str(answers[EMERGENCY_STOP.name].message)
    return f"released: {' and '.join(answers)} take forces again; the coupler does not answer"


def _refusals(answers: dict[str, Any]) -> str:
    refused = ((name, it.message) for name, it in answers.items() if it and not it.success)
    return "; ".join(f"{name}: {reason}" for name, reason in refused)


def _answers(node: Node) -> dict[str, Any]:
    """Ask the coupler for the release, or the devices if it does not answer; None for silence."""
    name = EMERGENCY_STOP.name
    if answer := _answer(node, name):
        return {name: answer}
    return {device: _answer(node, f"{device}/{name}") for device in DEVICES.values()}


def _answer(node: Node, service: str) -> Any:
    """Return a service's answer to the release, None if there is none in time."""
    import rclpy
    from std_srvs.srv import SetBool

    client = node.create_client(SetBool, service)
    try:
        if not client.wait_for_service(ANSWERING_TIME):
            return None
        asked = client.call_async(SetBool.Request(data=False))
        rclpy.spin_until_future_complete(node, asked, timeout_sec=ANSWERING_TIME)
        return asked.result() if asked.done() else None
    finally:
        node.destroy_client(client)

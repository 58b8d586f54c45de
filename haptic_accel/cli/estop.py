# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``haptic-accel estop``: the emergency stop from a terminal, and its release."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from haptic_accel.cli.ending import StoppedError
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
from haptic_accel.graph.namespaces import NamespaceArguments
from haptic_accel.graph.stop_signal import Signalled, age, own_domain, stop_senders

if TYPE_CHECKING:
    from rclpy.node import Node

    from haptic_accel.nodes.graph_requests import GraphClient

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
@click.pass_obj
def estop(signalled: Signalled | None, arguments: StopArguments) -> None:
    """Remove all forces from all devices at once; they refuse new ones until release:=true.

    Without a namespace every graph of the ROS domain is stopped. The release is that of one graph,
    and refused while somebody still asks for the stop.
    """
    if arguments.release:
        print(f"emergency stop {_release(arguments.namespace)}")
        return
    # By signals first: ROS takes a while to import, and to join the graph.
    done = signalled or Signalled(stop_senders(own_domain(), arguments.namespace))
    reached = "1 process" if done.processes == 1 else f"{done.processes} processes"
    quick = f"{reached} signalled after {done.after:.2f} s, "
    from haptic_accel.cli.joining import connected

    topic = EMERGENCY_STOP if arguments.namespace else COMMON_STOP
    for _ in range(ATTEMPTS):
        with connected(arguments.namespace) as client:
            confirmed, missing = asyncio.run(_stop(client, topic))
        if not missing:
            break
    else:
        names, seconds = " and ".join(missing), ATTEMPTS * PATIENCE
        raise StoppedError(f"{names} did not confirm within {seconds:g} s; is the graph running?")
    devices = {1: "the device is", 2: "both devices are"}.get(
        len(confirmed), f"all {len(confirmed)} devices are"
    )
    first = quick if done.processes else ""
    print(f"emergency stop: {devices} without force ({first}confirmed after {age():.2f} s)")


async def _stop(client: GraphClient, topic: Topic) -> tuple[set[str], set[str]]:
    """Publish the stop; return the full names of devices that confirmed, and that did not."""
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Bool

    node = client.node
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(Bool, topic.name, latched).publish(Bool(data=True))
    answers: dict[str, bool] = {}
    asked: set[str] = set()
    looked = time.monotonic() + LEAST_LOOK

    def is_confirmed() -> bool:
        # Anew each time: that an arm is elsewhere is known when its coupler has been found.
        devices = dict(_devices(node, everywhere=topic is COMMON_STOP))
        asked.clear()
        asked.update(devices)
        for device, name in devices.items():
            if device not in answers:
                answers[device] = False
                node.create_subscription(
                    Bool,
                    name,
                    lambda message, device=device: answers.update({device: message.data}),
                    latched,
                )
        return bool(asked) and all(map(answers.get, asked)) and time.monotonic() >= looked

    await client.until(is_confirmed, PATIENCE)
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
    """Return whether an arm is on a peer host, whose state the coupler reports here."""
    senders = node.get_publishers_info_by_topic(f"{namespace}/{arm.position.name}")
    return any(sender.node_name == "coupler" for sender in senders)


def _release(namespace: str) -> str:
    """Release the graph of a namespace; return a line on the devices that take forces again."""
    from haptic_accel.cli.joining import connected

    for _ in range(ATTEMPTS):
        with connected(namespace, ANSWERING_TIME, ANSWERING_TIME) as client:
            answers = asyncio.run(_answers(client))
        if all(answers.values()):
            break
    else:
        missing = " and ".join(name for name, answer in answers.items() if not answer)
        raise StoppedError(f"{missing} did not answer; is the graph running?")
    if EMERGENCY_STOP.name in answers:
        return str(answers[EMERGENCY_STOP.name].message)
    return f"released: {' and '.join(answers)} take forces again; the coupler does not answer"


async def _answers(client: GraphClient) -> dict[str, Any]:
    """Ask the coupler for the release, or the devices if it does not answer; None for silence."""
    from std_srvs.srv import SetBool

    from haptic_accel.nodes.graph_requests import RequestError, refusals

    async def answer(service: str) -> Any:
        with suppress(RequestError):
            return await client.call(SetBool, service, SetBool.Request(data=False))

    name, deadline = EMERGENCY_STOP.name, time.monotonic() + REASON_TIME
    while True:
        answers = {name: await answer(name)}
        if not answers[name]:
            answers = {each: await answer(f"{each}/{name}") for each in DEVICES.values()}
        if not (refused := refusals(answers)):
            return answers
        if time.monotonic() >= deadline:
            raise RequestError(f"emergency stop is not released: {'; '.join(refused)}")

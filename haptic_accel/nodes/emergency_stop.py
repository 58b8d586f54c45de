# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emergency stop in ROS: of a device, of the coupler, and on request of other processes."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.core.coupling.engagement import EmergencyStop
from haptic_accel.core.topics import COUPLER_STOPPED, DEVICES, EMERGENCY_STOP, STOPS, Topic
from haptic_accel.graph.stop_signal import PendingStop
from haptic_accel.nodes.service_client import Answers, RequestError, ServiceClient, Services

if TYPE_CHECKING:  # a stop command must not wait for imports of nodes
    from haptic_accel.core.coupling.engagement import Engagement
    from haptic_accel.nodes.graph_node import GraphNode

DEVICE_SERVICES = tuple(f"{device}/estop" for device in DEVICES)
"""Services that stop and release one device each."""

STOP_SERVICES = (EMERGENCY_STOP.name, *DEVICE_SERVICES)
"""Services of the emergency stop; first the coupler's, which forwards a release to devices."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Quality of service of the stop's topics for a node that only requests the stop."""

ANSWER_TIME = 1.0
"""Time-out for a device's answer to a release, s."""

SEARCH_TIME = 0.5
"""Duration of the search for graphs to stop, s."""

AGAIN = "stopped again meanwhile"
"""Reason for refusing a release that arrived before a stop took effect."""

Act = Callable[[], None]
Answer = Callable[[SetBool.Response], None]


class NodeStop:
    """Emergency stop of a node, with its topics, its service and its published state.

    Parameters
    ----------
    node : GraphNode
    stop : EmergencyStop
        Stop of the node, which other objects may set, too.
    state : Topic
        Topic of the state, true while stopped.
    service : str
        Service that stops and releases.
    """

    def __init__(self, node: GraphNode, stop: EmergencyStop, state: Topic, service: str) -> None:
        self._node, self._stop = node, stop
        # Without a namespace, the graph uses the topic of all graphs.
        found = {(node.resolve_topic_name(it.name), it.latched): it for it in STOPS}
        self._inboxes = [node.inbox(topic) for topic in found.values()]
        self._names = {name for name, _ in found}
        self._publish = node.publisher(state).publish
        self._requests = node.requests(SetBool, service)
        self._followed = False

    def report_state(self) -> None:
        """Publish whether the node is stopped; call it at least once a second."""
        self._publish(Bool(data=self._stop.stopped))

    def follow(self) -> bool:
        """Process messages and requests; return whether the stop has changed."""
        now = time.monotonic()
        messages = [each for inbox in self._inboxes for each in inbox.drain_states()]
        for message in messages:
            self._stop.receive(message, now)
        requests = list(self._requests.drain())
        requested = any(request.data for request, _ in requests)
        if requested:
            self._stop.stop()
        new = self._stop.stopped and not self._followed
        if new or requested or any(messages):
            self._obey()
        for request, answer in requests:
            if request.data:
                answer(SetBool.Response(success=True, message="stopped"))
            elif new or requested:  # the release may have been requested before this stop
                answer(SetBool.Response(success=False, message=AGAIN))
            elif refusal := self._stop.release(now, self._node.publishers(*self._names)):
                answer(SetBool.Response(success=False, message=refusal))
            else:
                self._release(answer, now)
        changed = self._stop.stopped != self._followed
        self._followed = self._stop.stopped
        return changed

    @abstractmethod
    def _obey(self) -> None:
        """Execute a stop, new or repeated."""

    @abstractmethod
    def _release(self, answer: Answer, now: float) -> None:
        """Execute the release of the node's own stop, and answer the request."""


class DeviceStop(NodeStop):
    """Emergency stop of a device, which follows the coupler but is released separately.

    Parameters
    ----------
    node : GraphNode
    state : Topic
        As for `NodeStop`.
    take_off : callable
        Removes all forces and publishes the state; called for every stop, new or repeated.
    released : callable
        Called after each release.
    """

    def __init__(self, node: GraphNode, state: Topic, take_off: Act, released: Act) -> None:
        super().__init__(node, EmergencyStop(time.monotonic()), state, "~/estop")
        self._take_off, self._released = take_off, released
        self._coupler = node.inbox(COUPLER_STOPPED)
        domain, namespace = node.context.get_domain_id(), node.get_namespace().rstrip("/")
        self._pending = PendingStop(domain, namespace)

    def settles(self) -> bool:
        """Return True once every stop from before the node's start has been received."""
        settled = self._stop.is_settled(time.monotonic())
        if settled:
            self.poll_pending()
        return settled

    def poll_pending(self) -> None:
        """Stop if a pending stop exists, as for graphs that were not running or reachable."""
        if self._pending.is_new() and not self._stop.stopped:
            self._node.get_logger().warning(
                "emergency stop of haptic-accel estop is pending: release it by"
                f" {release_command(self._node.get_namespace())}"
            )
            self.stop()

    def stop(self) -> None:
        """Stop at once."""
        self._stop.stop()
        self._take_off()

    def follow(self) -> bool:
        """Process the state of the coupler, too."""
        for stopped in self._node.states(self._coupler):
            self._stop.receive_coupler(stopped, time.monotonic())
        return super().follow()

    def _obey(self) -> None:
        self._take_off()

    def _release(self, answer: Answer, now: float) -> None:
        with suppress(OSError):  # another user's stop stays, for later graphs
            self._pending.withdraw()
        self._pending.is_new()  # a stop that stays is released for this node
        self._released()
        answer(SetBool.Response(success=True, message="released"))


@dataclass(frozen=True)
class _Release:
    """Release requested from the devices, and the function that answers the requester."""

    answer: Answer
    devices: Answers
    deadline: float


class CouplerStop(NodeStop):
    """Emergency stop of the coupler, which follows devices and forwards releases to them.

    The service `estop` stops at once. A release is forwarded to the devices, and answered after
    all devices answer: either all devices are released, or none is.

    Parameters
    ----------
    node : GraphNode
        As for `NodeStop`.
    engagement : Engagement
        Engagement of this host's arms, with the stop.
    """

    def __init__(self, node: GraphNode, engagement: Engagement) -> None:
        super().__init__(node, engagement.stop, COUPLER_STOPPED, EMERGENCY_STOP.name)
        self._engagement = engagement
        self._arms = {arm: node.inbox(DEVICES[f"{arm}_device"].stopped) for arm in engagement.arms}
        self._services = Services(node)
        self._services.find(SetBool, DEVICE_SERVICES)
        self._releases: list[_Release] = []

    def follow(self) -> bool:
        """Process the states of devices, and their answers to a release, too."""
        for arm, inbox in self._arms.items():
            for stopped in self._node.states(inbox):
                self._engagement.arm_stopped(arm, stopped)
        now = time.monotonic()
        self._releases = [each for each in self._releases if not self._is_answered(each, now)]
        return super().follow()

    def _obey(self) -> None:
        self.report_state()

    def _release(self, answer: Answer, now: float) -> None:
        self.report_state()  # first: devices refuse a release while the coupler is stopped
        devices = self._services.ask(SetBool, DEVICE_SERVICES, SetBool.Request(data=False))
        self._releases.append(_Release(answer, devices, now + ANSWER_TIME))

    def _is_answered(self, release: _Release, now: float) -> bool:
        """Answer after all devices or at the time-out; stop all devices if one refuses."""
        refused, silent = release.devices.refusals, release.devices.silent
        if now >= release.deadline:
            refused += [f"{name}: no answer within {ANSWER_TIME:g} s" for name in silent]
        if self._stop.stopped:
            refused = refused or [AGAIN]
        if silent and not refused:
            return False
        if refused:
            self._stop.follow()  # not a new stop: a released peer stays released
        devices = release.devices.futures
        released = f"{' and '.join(devices)} take forces again" if devices else "no device"
        message = "; ".join(refused) or f"released: {released}"
        release.answer(SetBool.Response(success=not refused, message=message))
        return True


def release_command(namespace: str) -> str:
    """Return the command that releases the graph of a namespace."""
    argument = f" namespace:={namespace.strip('/')}" if namespace.strip("/") else ""
    return f"haptic-accel estop release:=true{argument}"


async def stop_devices(client: ServiceClient, timeout: float) -> tuple[str, set[str]]:
    """Publish the stop.

    Parameters
    ----------
    client : ServiceClient
        In the graph's namespace; without a namespace to stop all graphs.
    timeout : float
        Time-out for the devices to be found and to confirm, s.

    Returns
    -------
    tuple
        A line on the devices that confirmed, and the full names of the others.
    """
    node = client.node
    node.create_publisher(Bool, EMERGENCY_STOP.name, LATCHED).publish(Bool(data=True))
    answers: dict[str, bool] = {}
    found: set[str] = set()
    searched = time.monotonic() + SEARCH_TIME

    def take(device: str, message: Bool) -> None:
        answers[device] = message.data

    def is_confirmed() -> bool:
        # Repeated, because a coupler that was found may reveal an arm on a peer host.
        devices = dict(_devices(node))
        found.clear()
        found.update(devices)
        for device, name in devices.items():
            if device not in answers:
                answers[device] = False
                node.create_subscription(Bool, name, partial(take, device), LATCHED)
        return bool(found) and all(map(answers.get, found)) and time.monotonic() >= searched

    await client.until(is_confirmed, timeout)
    confirmed = {device for device in found if answers[device]}
    count = {1: "the device is", 2: "both devices are"}
    line = count.get(len(confirmed), f"all {len(confirmed)} devices are") + " without force"
    return line, (found or set(DEVICES)) - confirmed


def _devices(node: Node) -> Iterator[tuple[str, str]]:
    """Yield full names of the devices that must confirm, and of their confirmation topics."""
    namespaces = {node.get_namespace().rstrip("/")}
    if namespaces == {""}:
        states = [f"/{arm.stopped.name}" for arm in DEVICES.values()]
        names = [name for name, _ in node.get_topic_names_and_types()]
        found = {(name, state) for name in names for state in states if name.endswith(state)}
        namespaces = {n.removesuffix(state) for n, state in found if node.count_publishers(n)}
    for namespace in namespaces:
        for device, arm in DEVICES.items():
            senders = node.get_publishers_info_by_topic(f"{namespace}/{arm.position.name}")
            # On this topic, the coupler reports the state of an arm on a peer host.
            if all(sender.node_name != "coupler" for sender in senders):
                yield f"{namespace}/{device}".removeprefix("/"), f"{namespace}/{arm.stopped.name}"


async def release(client: ServiceClient, timeout: float = 0.0) -> tuple[str, set[str]]:
    """Request the release from the coupler or, without an answer, from the devices.

    Parameters
    ----------
    client : ServiceClient
    timeout : float
        Time for which a refused release is repeated, s, as the reason may disappear.

    Returns
    -------
    tuple
        A line on the devices that accept forces again, and the devices without an answer.

    Raises
    ------
    RequestError
        The release is refused.
    """
    deadline = time.monotonic() + timeout
    while True:
        for services in (STOP_SERVICES[:1], DEVICE_SERVICES):
            answers = await client.answers(SetBool, services, SetBool.Request(data=False))
            if received := answers.received:
                break
        if not answers.refusals:
            break
        if time.monotonic() >= deadline:
            raise RequestError(f"emergency stop is not released: {'; '.join(answers.refusals)}")
    if EMERGENCY_STOP.name in received:
        return received[EMERGENCY_STOP.name].message, set()
    line = f"released: {' and '.join(received)} take forces again; the coupler does not answer"
    return line, DEVICES.keys() - received

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated slave, commanded by a client of CRTK with its quality of service."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty

from haptic_accel.core.coupling import engagement
from haptic_accel.devices.rclpy_internals import EventsExecutor
from haptic_accel.nodes.crtk import Managed
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.scheduling import StopPoll
from haptic_accel.nodes.slave_device import build_slave_device
from observing import Observer
from running import PATIENCE, Start, wait_until

GOAL = (0.02, 0.0, 0.015)
"""A position above the surface, m; the tip begins at (0, 0, 0.01)."""

CLOSE = 1e-3
"""Distance from the goal within which dry friction may leave the tip, m: 0.1 N / 250 N/m, and
the resolution of the encoders."""


class Client:
    """A slave device, and a node that asks and commands it."""

    def __init__(self) -> None:
        self.arm = build_slave_device()
        self.loop = join([self.arm])
        self.loop.begin()
        self.stop_poll = StopPoll([self.loop])
        self.node = rclpy.create_node("client")
        self.executor = SingleThreadedExecutor()
        for node in (self.arm, self.node):
            self.executor.add_node(node)
        self._newest: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}

    def until(self, condition: Callable[[], bool], meanwhile: Callable[[], None] = int) -> None:
        """Let both nodes run until a condition holds; do something every millisecond."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self._newest
            meanwhile()
            while self.stop_poll.after_work(self.loop.work()) <= time.monotonic():
                pass
            self.executor.spin_once(timeout_sec=0.001)

    def ask(self, kind: Any, name: str) -> Any:
        """Return the next message of a query."""
        topic = f"slave/{name}"
        if topic not in self._newest:
            keep = self._newest.__setitem__
            self.node.create_subscription(kind, topic, lambda sent: keep(topic, sent), 10)
        self._newest[topic] = None
        self.until(lambda: self._newest[topic] is not None)
        return self._newest[topic]

    def send(self, message: Any, name: str) -> None:
        """Publish a command."""
        topic = f"slave/{name}"
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(type(message), topic, 10)
            self.until(lambda: self._publishers[topic].get_subscription_count() > 0)
        self._publishers[topic].publish(message)

    def move(self, goal: tuple[float, float, float] = GOAL) -> None:
        """Send a position without a stamp."""
        message = PoseStamped()
        message.pose.position.x, message.pose.position.y, message.pose.position.z = goal
        self.send(message, "servo_cp")

    def push(self, force: float) -> None:
        """Send a force along x without a stamp."""
        message = WrenchStamped()
        message.wrench.force.x = force
        self.send(message, "servo_cf")

    @property
    def position(self) -> tuple[float, float, float]:
        point = self.ask(PoseStamped, "measured_cp").pose.position
        return point.x, point.y, point.z

    @property
    def force(self) -> tuple[float, float, float]:
        """Force that acts, N."""
        force = self.ask(WrenchStamped, "measured_cf").wrench.force
        return force.x, force.y, force.z

    @property
    def set_point(self) -> tuple[float, float, float]:
        point = self.ask(PoseStamped, "setpoint_cp").pose.position
        return point.x, point.y, point.z

    @property
    def is_held(self) -> bool:
        """The set-point is valid."""
        return any(stamp_of(self.ask(PoseStamped, "setpoint_cp")))

    def is_there(self) -> bool:
        """Return whether the arm is at the goal."""
        return self.position == pytest.approx(GOAL, abs=CLOSE)

    def close(self) -> None:
        self.executor.shutdown()
        for node in (self.arm, self.node):
            node.destroy_node()


def stamp_of(message: Any) -> tuple[int, int]:
    stamp = message.header.stamp
    return stamp.sec, stamp.nanosec


@pytest.fixture
def client(
    domain: int, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Iterator[Client]:
    """Give a client of an arm past its first moments, with parameters name:=value."""
    monkeypatch.setattr(engagement, "LATCHED_SETTLING", 0.0)
    given = [word for value in getattr(request, "param", ()) for word in ("-p", value)]
    rclpy.init(args=["--ros-args", *given] if given else None)
    client = Client()
    yield client
    client.close()
    rclpy.shutdown()


def test_queries_describe_the_arm_while_it_is_free(client: Client) -> None:
    joints = client.ask(JointState, "measured_js")
    assert joints.header.frame_id == "slave_base"
    assert any(stamp_of(joints))
    assert joints.name == ["slave_x", "slave_y", "slave_z"]
    assert tuple(joints.position) == client.position
    assert list(joints.velocity) == list(joints.effort) == [0.0] * 3
    assert client.force == (0.0, 0.0, 0.0)
    assert not client.is_held
    assert client.set_point == client.position
    assert client.ask(Bool, "is_homed").data is True
    assert client.ask(Bool, "is_busy").data is False


def test_an_arm_goes_where_it_is_sent_and_stays_there(client: Client) -> None:
    client.until(client.is_there, client.move)
    assert client.is_held
    assert client.set_point == GOAL
    assert stamp_of(client.ask(WrenchStamped, "setpoint_cf")) == (0, 0), "not valid"
    # Longer than a force without a sender lasts, and than a rig waits that is without force.
    over = time.monotonic() + 0.5
    client.until(lambda: time.monotonic() > over)
    client.until(client.is_there)


def test_an_arm_is_held_where_it_is_until_it_is_freed(client: Client) -> None:
    client.until(client.is_there, client.move)
    before = client.set_point
    client.send(Empty(), "hold")
    client.until(lambda: client.set_point != before)
    assert client.is_held
    client.until(lambda: client.position == pytest.approx(client.set_point, abs=CLOSE))
    client.send(Empty(), "free")
    client.until(lambda: not client.is_held)
    client.until(lambda: client.force == (0.0, 0.0, 0.0))


def test_the_newest_command_wins(client: Client) -> None:
    client.until(client.is_there, client.move)
    client.until(lambda: client.force == (-0.2, 0.0, 0.0), lambda: client.push(-0.2))
    assert not client.is_held
    commanded = client.ask(WrenchStamped, "setpoint_cf")
    assert any(stamp_of(commanded))
    client.until(lambda: client.is_held, client.move)


def test_an_emergency_stop_ends_the_hold_for_good(client: Client) -> None:
    client.until(client.is_there, client.move)
    client.arm.stop_forces()
    client.until(lambda: not client.is_held)
    assert client.force == (0.0, 0.0, 0.0)


def test_an_arm_obeys_one_node(client: Client) -> None:
    client.until(client.is_there, client.move)
    other = rclpy.create_node("other")
    other.create_publisher(WrenchStamped, "slave/servo_cf", 10)

    def refused() -> bool:
        return "no force while it is sent by /client and /other" in client.arm.diagnostics()[0]

    client.until(refused)
    client.until(lambda: client.force == (0.0, 0.0, 0.0), client.move)
    other.destroy_node()
    client.until(lambda: client.is_held and client.is_there(), client.move)


@pytest.mark.parametrize("client", [["safety.arm.zero_stamp:=false"]], indirect=True)
def test_commands_without_a_stamp_can_be_refused(client: Client) -> None:
    def refused() -> bool:
        values = client.arm.diagnostics()[1]
        counts = values["positions refused"], values["arm force outdated"]
        return all(int(count) > 0 for count in counts)

    def both() -> None:
        client.move()
        client.push(0.3)

    client.until(refused, both)
    assert client.force == (0.0, 0.0, 0.0)
    assert not client.is_held


def test_a_position_that_is_not_finite_is_refused(client: Client) -> None:
    def refused() -> int:
        return int(client.arm.diagnostics()[1]["positions refused"])

    for value in (math.nan, math.inf):
        before, goal = refused(), (value, 0.0, 0.0)
        client.until(lambda n=before: refused() > n, lambda goal=goal: client.move(goal))
        assert not client.is_held


def test_an_arm_is_enabled_paused_and_homed_by_its_commands(client: Client) -> None:
    messages = pytest.importorskip("crtk_msgs.msg")

    def leads_to(command: str, *expected: Any) -> bool:
        client.send(messages.StringStamped(string=command), "state_command")

        def reached() -> bool:
            told = client.ask(messages.OperatingState, "operating_state")
            return (told.state, told.is_homed, told.is_busy) == expected

        client.until(reached)
        return True

    assert leads_to("enable", "ENABLED", True, False)
    played = messages.StringStamped(string="disable")
    played.header.stamp.sec = int(time.time()) - 60
    client.send(played, "state_command")  # not obeyed: a disabled arm could not pause
    assert leads_to("pause", "PAUSED", True, False)
    assert leads_to("enable", "PAUSED", True, False), "invalid"
    assert leads_to("resume", "ENABLED", True, False)
    assert leads_to("disable", "DISABLED", True, False)
    assert leads_to("unhome", "DISABLED", False, False)
    assert leads_to("home", "DISABLED", True, False)
    assert leads_to("enable", "ENABLED", True, False)
    client.arm.stop_forces()
    assert leads_to("resume", "PAUSED", True, False), "the emergency stop is not released"


MANY = 400
"""Requests at once."""

DESTROYED = """
import os
import rclpy
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.slave_device import build_slave_device

def threads_after(build):
    node = build()
    running = len(os.listdir("/proc/self/task"))
    node.destroy_node()
    return running, len(os.listdir("/proc/self/task"))

rclpy.init()
running, left = threads_after(lambda: GraphNode("coupler"))
assert left < running, (running, left)
print("left", left, threads_after(build_slave_device)[1])
"""


def test_no_thread_of_the_middleware_outlives_a_managed_node(
    start: Start,
) -> None:
    command = start("-c", DESTROYED)
    assert command.end() == 0, command.text
    _, plain, managed = command.lines[-1].split()
    assert managed == plain


class Idle(Managed, GraphNode):
    """A managed node that does nothing."""

    task = "nothing"

    def __init__(self) -> None:
        GraphNode.__init__(self, "slave_device")
        self.begin_lifecycle()


@pytest.fixture
def executor(domain: int) -> Iterator[EventsExecutor]:
    """Give the executor of a managed node, not spinning yet."""
    rclpy.init()
    node = Idle()
    executor = EventsExecutor()
    executor.add_node(node)
    yield executor
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


def test_every_request_that_comes_at_once_is_answered(
    executor: EventsExecutor, observer: Observer
) -> None:
    events: list[tuple[str, str]] = []

    def keep(event: TransitionEvent) -> None:
        events.append((event.start_state.label, event.goal_state.label))

    topic = "/slave_device/transition_event"
    heard = observer.node.create_subscription(TransitionEvent, topic, keep, 10)
    wait_until(lambda: heard.get_publisher_count() == 1, "the publisher of changes")

    def answered(kind: type, name: str, request: object) -> list[Any]:
        """Send a request many times at once; return the responses."""
        quality = QoSProfile(depth=MANY)
        client = observer.node.create_client(kind, f"/slave_device/{name}", qos_profile=quality)
        assert client.wait_for_service()
        answers = [client.call_async(request) for _ in range(MANY)]

        def complete() -> bool:
            for _ in range(MANY):
                executor.spin_once(timeout_sec=0.0)
                observer.executor.spin_once(timeout_sec=0.0)
            return all(answer.done() for answer in answers)

        wait_until(complete, f"all of {name} are answered")
        return [answer.result() for answer in answers]

    request = ChangeState.Request()
    request.transition.label = "configure"
    outcomes = answered(ChangeState, "change_state", request)
    assert sum(each.success for each in outcomes) == 1, "only the first is from its state"
    for state in answered(GetState, "get_state", GetState.Request()):
        assert state.current_state.label == "inactive"
    request = GetAvailableTransitions.Request()
    for found in answered(GetAvailableTransitions, "get_available_transitions", request):
        labels = [each.transition.label for each in found.available_transitions]
        assert labels == ["cleanup", "activate", "shutdown"]
    assert events == [("unconfigured", "configuring"), ("configuring", "inactive")]

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

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rclpy.qos import QoSProfile

from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.managed import Managed
from haptic_accel.nodes.scheduling import EventsExecutor
from observing import Observer
from running import Command, wait_until

MANY = 400
"""Requests at once."""

DESTROYED = """
import os
import rclpy
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.slave_device import slave_device

def threads_after(build):
    node = build()
    running = len(os.listdir("/proc/self/task"))
    node.destroy_node()
    return running, len(os.listdir("/proc/self/task"))

rclpy.init()
running, left = threads_after(lambda: GraphNode("coupler"))
assert left < running, (running, left)
print("left", left, threads_after(slave_device)[1])
"""


def test_no_thread_of_the_middleware_outlives_a_managed_node(
    start: Callable[..., Command],
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
    heard = observer.node.create_subscription(
        TransitionEvent,
        "/slave_device/transition_event",
        lambda event: events.append((event.start_state.label, event.goal_state.label)),
        10,
    )
    wait_until(lambda: heard.handle.get_publisher_count() == 1, "the publisher of changes")

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

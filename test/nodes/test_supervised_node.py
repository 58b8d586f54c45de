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
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from haptic_accel.nodes.crtk import Managed
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.scheduling import EventsExecutor
from haptic_accel.nodes.supervised_node import Wire, Wires
from observing import Observer
from running import wait_until

WRONG = "wrong\nin two lines"


def fail(*taken: Any) -> Any:
    """Be the callback of somebody who made a mistake."""
    raise KeyError(WRONG)


def unsendable(request: Any, response: Any) -> Any:
    """Return what ROS cannot convert."""
    response.message = "\ud800"
    return response


class Faulty(Managed, GraphNode):
    """A node all of whose callbacks fail."""

    task = "failing"

    def __init__(self) -> None:
        GraphNode.__init__(self, "slave_device")
        self.begin_lifecycle()
        self.create_service(Trigger, "~/fail", fail)
        self.create_service(SetBool, "~/answer", unsendable)
        self.create_subscription(Bool, "fails", fail, 10)
        self.create_timer(0.05, fail)
        events = SubscriptionEventCallbacks(matched=fail)
        self.create_subscription(Bool, "fails", lambda message: None, 10, event_callbacks=events)
        self.polled = self.requests(Trigger, "~/polled")

    def on_configure(self, state: Any) -> Outcome:
        """Fail, too."""
        return fail()


class Served:
    """A node in this process, served by the executor of all nodes."""

    def __init__(self, node: GraphNode, observer: Observer) -> None:
        self.node, self.observer = node, observer
        self.executor = EventsExecutor()
        self.executor.add_node(node)

    def turn(self) -> None:
        """Serve for a moment; whatever is raised here would end a node."""
        self.executor.spin_once(timeout_sec=0.0)
        self.observer.executor.spin_once(timeout_sec=0.005)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Serve until a condition holds."""

        def met() -> bool:
            self.turn()
            return condition()

        wait_until(met, what)

    def answer(self, kind: Any, name: str) -> Any:
        """Return the response of a service."""
        client = self.observer.node.create_client(kind, f"slave_device/{name}")
        self.until(client.service_is_ready, name)
        future = client.call_async(kind.Request())
        self.until(future.done, name)
        return future.result()


@pytest.fixture
def served(domain: int, observer: Observer) -> Iterator[Served]:
    """Serve a node whose callbacks fail."""
    rclpy.init()
    served = Served(Faulty(), observer)
    yield served
    served.executor.shutdown()
    served.node.destroy_node()
    rclpy.shutdown()


def failures(node: GraphNode) -> int:
    """Return the number of failures that diagnostics show."""
    return int(node._refusals()["callbacks failed"])


def test_whatever_callbacks_raise_the_node_goes_on_counts_and_answers(
    served: Served, capfd: pytest.CaptureFixture[str]
) -> None:
    failed = served.node._guard.failed
    for _ in range(2):
        answer = served.answer(Trigger, "fail")
        assert (answer.success, answer.message) == (False, r"KeyError: 'wrong\nin two lines'")
        answer = served.answer(SetBool, "answer")
        assert not answer.success
        assert answer.message.startswith("UnicodeEncodeError: ")
    publisher = served.observer.node.create_publisher(Bool, "fails", 10)
    served.until(lambda: publisher.get_subscription_count() == 2, "its subscribers")
    publisher.publish(Bool())
    kinds = ("/slave_device/fail", "/slave_device/answer", "/fails", "timer of 0.05 s")
    kinds = (*kinds, "event of a topic")
    served.until(lambda: all(failed[kind] for kind in kinds), f"all of {kinds}: {failed}")
    served.until(lambda: failed["timer of 0.05 s"] > 3, "a timer that goes on")
    assert failures(served.node) == failed.total()
    lines = [line for line in capfd.readouterr().err.splitlines() if "failed: " in line]
    assert len(lines) == len(kinds), lines


def test_a_polled_service_answers_though_its_response_cannot_be_sent(served: Served) -> None:
    client = served.observer.node.create_client(Trigger, "slave_device/polled")
    served.until(client.service_is_ready, "the service")
    future = client.call_async(Trigger.Request())

    def answered() -> bool:
        for _, answer in served.node.polled.drain():
            answer(Trigger.Response(success=True, message="\ud800"))
        return future.done()

    served.until(answered, "its answer")
    assert not future.result().success


def test_each_receiver_is_told_whoever_was_there_first() -> None:
    wire = Wire()
    before: list[bool] = []
    after: list[bool] = []
    wire.join(before.append)
    wire.offer()
    wire.join(after.append)
    assert (before, after) == ([False, True], [True])
    assert wire.listeners == 2


def test_a_signal_left_to_others_comes_as_messages_and_who_has_left_is_told_nothing() -> None:
    wire = Wire()
    told: list[bool] = []
    take = told.append
    wire.join(take)
    wire.offer()
    wire.offer(False)
    assert (told, wire.listeners) == ([False, True, False], 0)
    wire.offer()
    wire.leave(take)
    wire.offer(False)
    assert (told[3:], wire.listeners) == ([True], 0)


def test_only_nodes_that_are_to_share_a_process_share_wires() -> None:
    wires = Wires()
    alone = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is not alone
    wires.joined = True
    shared = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is shared
    assert wires.of("/left/master/measured_cp") is not shared

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

"""The emergency stop, from a terminal and by whoever else publishes it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.emergency_stop import SETTLING
from haptic_accel.core.topics import (
    ACTUATOR_FORCE,
    COMMON_STOP,
    COUPLER_STOPPED,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    MASTER_ARM_FORCE,
    MASTER_STOPPED,
    SLAVE_STOPPED,
    Topic,
)
from haptic_accel.graph.stop_signal import PendingStop
from haptic_accel.nodes.topic_node import quality
from observing import Observer
from running import BAG_PLAYER, Command, wait_until
from verbs import refusal

Start = Callable[..., Command]
Ask = Callable[..., tuple[int, str]]

STOPPED = (COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED)

APPLIED = ("arm force count", "actuator force count")
"""Counts of the forces that the master device applied."""


def applied(observer: Observer) -> list[int]:
    """Return how many forces a stopped master device has applied.

    Diagnostics are read only once they say that it is stopped: a report is sent up to a third of
    a second after it was gathered.
    """
    values = observer.status("master_device", "emergency stop")
    return [int(values[name]) for name in APPLIED]


def test_a_stop_from_a_terminal_lets_no_force_through_until_it_is_released(
    haptic_accel: Start, observer: Observer, ask: Ask
) -> None:
    graph = haptic_accel("teleop", "record:=false", "controller:=constant", "surface:=text")
    graph.wait_for("engaged")
    observer.collect((ACTUATOR_FORCE,), 100)
    stop = haptic_accel("estop")
    assert stop.end() == 0, stop.text
    assert stop.lines[-1].startswith("emergency stop: both devices are without force (1 process ")
    for topic in STOPPED:
        observer.wait_for_state(topic, True)
    graph.wait_for("let go: emergency stop")
    before = applied(observer)
    # The compensator goes on: what it sends meanwhile is refused.
    observer.collect((ACTUATOR_FORCE,), 100)
    assert applied(observer) == before
    refused = "haptic-accel: coupler: emergency stop: release it first"
    assert ask("control", "engage:=true") == (1, refused)
    so_far = len(graph.lines)
    released = "emergency stop released: slave_device and master_device take forces again"
    status, said = ask("estop", "release:=true")
    assert (status, said) == (0, released)
    graph.wait_for("engaged", after=so_far)
    for topic in STOPPED:
        observer.wait_for_state(topic, False)
    # Forces flow again.
    more = {name: count + 100 for name, count in zip(APPLIED, before, strict=True)}
    observer.status("master_device", least=more)
    assert graph.end(signal.SIGINT) == 0, graph.text
    assert graph.text.count("emergency stop: no force until it is released") == 2, graph.text


def released_and_engaged(graph: Command, ask: Ask, domain: int) -> None:
    """Release a graph that has not engaged so far, and wait until it has."""
    assert not any(line.endswith("engaged") for line in graph.lines), graph.text
    status, said = ask("estop", "release:=true")
    assert (status, "take forces again" in said) == (0, True), said
    graph.wait_for("engaged")
    assert not PendingStop(domain, "").is_new()


def test_a_stop_while_a_graph_starts_holds_for_it_until_it_is_released(
    haptic_accel: Start, observer: Observer, ask: Ask, domain: int
) -> None:
    graph = haptic_accel("teleop", "record:=false", "rate:=200")
    stop = haptic_accel("estop")
    graph.wait_for(r"\[slave_device\]: emergency stop: no force until it is released")
    graph.wait_for(r"\[master_device\]: emergency stop: no force until it is released")
    if stop.end():  # on a busy machine the graph may come later than the command waits for it
        assert "; the stop is pending: no graph of ROS domain" in stop.lines[-1]
    for topic in STOPPED:
        observer.wait_for_state(topic, True)
    released_and_engaged(graph, ask, domain)
    assert graph.end(signal.SIGINT) == 0, graph.text


def test_a_stop_that_nobody_confirmed_is_pending_for_the_next_graph(
    haptic_accel: Start, observer: Observer, ask: Ask, domain: int
) -> None:
    status, said = ask("estop", "namespace:=left")
    assert status == 1
    assert said.endswith(
        f"; the stop is pending: no graph of ROS domain {domain} on this machine takes forces"
        " until haptic-accel estop release:=true namespace:=left"
    )
    graph = haptic_accel("teleop", "record:=false", "rate:=200")
    graph.wait_for("engaged")
    assert graph.end(signal.SIGINT) == 0, graph.text
    assert ask("estop", "release:=true", "namespace:=left") == (
        0,
        "emergency stop released for graphs that start; none answers",
    )
    assert ask("estop")[0] == 1
    graph = haptic_accel("teleop", "record:=false", "rate:=200", "composed:=false")
    for topic in STOPPED:
        observer.wait_for_state(topic, True)
    graph.wait_for("pending: release it by haptic-accel estop release:=true")
    wait_until(lambda: released(observer)[0], "released by another way")
    graph.wait_for("engaged")
    assert not PendingStop(domain, "").is_new()
    assert graph.end(signal.SIGINT) == 0, graph.text


def test_whoever_publishes_a_stop_is_heard(haptic_accel: Start, observer: Observer) -> None:
    graph = haptic_accel("teleop", "record:=false", "rate:=200")
    seen = 0
    for reliable in (True, False):
        graph.wait_for("engaged", after=seen)
        # As `ros2 topic pub --once` does: nothing latched, gone soon after.
        volatile = replace(EMERGENCY_STOP, reliable=reliable, latched=False)
        publisher = observer.node.create_publisher(Bool, volatile.name, quality(volatile))
        wait_until(lambda found=publisher: found.get_subscription_count() >= 3, "all found")
        publisher.publish(Bool(data=True))
        graph.wait_for("let go: emergency stop", after=seen)
        for topic in (MASTER_STOPPED, SLAVE_STOPPED):
            observer.wait_for_state(topic, True)
        observer.node.destroy_publisher(publisher)
        seen = len(graph.lines)
        wait_until(lambda: released(observer)[0], "released")
    assert graph.end(signal.SIGINT) == 0, graph.text


@pytest.fixture
def coupled(start: Start) -> dict[str, Command]:
    """Start both devices and a coupler, which engages."""
    nodes = {
        name: start("-m", f"haptic_accel.nodes.{name}")
        for name in ("slave_device", "master_device", "coupler")
    }
    nodes["coupler"].wait_for("engaged")
    return nodes


def released(observer: Observer) -> tuple[bool, str]:
    """Ask the coupler for the release; return whether it is granted, and its message."""
    answer = observer.call(SetBool, EMERGENCY_STOP.name, SetBool.Request(data=False))
    return answer.success, answer.message


def test_all_are_released_or_none_and_a_coupler_that_starts_anew_is_told(
    coupled: dict[str, Command], start: Start, observer: Observer
) -> None:
    observer.call(SetBool, EMERGENCY_STOP.name, SetBool.Request(data=True))
    for topic in STOPPED:
        observer.wait_for_state(topic, True)
    coupled["slave_device"].process.send_signal(signal.SIGSTOP)
    assert released(observer) == (False, "slave_device: no answer within 1 s")
    coupled["slave_device"].process.send_signal(signal.SIGCONT)
    for topic in STOPPED:
        observer.wait_for_state(topic, True)
    os.kill(coupled["coupler"].process.pid, signal.SIGKILL)
    coupled["coupler"].end()
    anew = start("-m", "haptic_accel.nodes.coupler")
    anew.wait_for("only (slave and master|master and slave) stopped; all are stopped again")
    observer.wait_for_state(COUPLER_STOPPED, True)
    wait_until(lambda: released(observer)[0], "released, once the coupler is old enough")
    anew.wait_for("engaged")


def engaged_on_both_sides(start: Start) -> dict[str, list[Topic]]:
    """Start a graph in each of two namespaces; return the topics of their stopped devices."""
    for side in ("left", "right"):
        for name in ("slave_device", "master_device", "coupler"):
            node = start("-m", f"haptic_accel.nodes.{name}", "--ros-args", "-r", f"__ns:=/{side}")
        node.wait_for("engaged")
    return {
        side: [replace(topic, name=f"{side}/{topic.name}") for topic in STOPPED]
        for side in ("left", "right")
    }


def test_a_topic_stops_the_graphs_of_all_namespaces_and_releases_none(
    start: Start, observer: Observer
) -> None:
    states = engaged_on_both_sides(start)
    # As `ros2 topic pub --once /estop` does: reliable, nothing latched.
    publisher = observer.node.create_publisher(Bool, COMMON_STOP.name, 1)
    wait_until(lambda: publisher.get_subscription_count() >= 6, "all nodes found")

    def wait_for_states(side: str, stopped: bool) -> None:
        for topic in states[side]:
            observer.wait_for_state(topic, stopped)

    def release(side: str) -> SetBool.Response:
        name = f"{side}/{EMERGENCY_STOP.name}"
        return observer.call(SetBool, name, SetBool.Request(data=False))

    publisher.publish(Bool(data=True))
    for side in states:
        wait_for_states(side, True)
    publisher.publish(Bool(data=False))
    time.sleep(2 * SETTLING)
    for side in states:
        wait_for_states(side, True)
    wait_until(lambda: release("left").success, "left is released")
    wait_for_states("left", False)
    wait_for_states("right", True)


def test_devices_stop_without_a_coupler_and_learn_of_a_stop_they_missed(
    start: Start, observer: Observer, ask: Ask
) -> None:
    nodes = {
        name: start("-m", f"haptic_accel.nodes.{name}", *words)
        for name, words in {
            "slave_device": [],
            "master_device": [],
            "compensator": ["--ros-args", "-p", "controller:=constant"],
            "coupler": ["--ros-args", "-p", "compensated:=true"],
        }.items()
    }
    nodes["coupler"].wait_for("engaged")
    # Forces flow; then the one who sends them dies.
    observer.collect((ACTUATOR_FORCE,), 100)
    with observer.watching(DIAGNOSTICS) as reported:
        # Found before that dies, as it is reported once.
        reported(lambda array: array.status[0].name.startswith("master_device"))
        os.kill(nodes["compensator"].process.pid, signal.SIGKILL)
        timed_out = "actuator force timed out"
        reported(lambda array: any(timed_out in one.message for one in array.status))
    # Anybody may stop by the topic alone, and be gone.
    anybody = observer.node.create_publisher(
        Bool, EMERGENCY_STOP.name, quality(EMERGENCY_STOP, depth=1)
    )
    anybody.publish(Bool(data=True))
    for topic in (MASTER_STOPPED, SLAVE_STOPPED):
        observer.wait_for_state(topic, True)
    nodes["coupler"].wait_for("let go: emergency stop")
    observer.node.destroy_publisher(anybody)
    os.kill(nodes["slave_device"].process.pid, signal.SIGKILL)
    nodes["slave_device"].end()
    late = start("-m", "haptic_accel.nodes.slave_device")
    late.wait_for("emergency stop: no force until it is released")
    os.kill(nodes["coupler"].process.pid, signal.SIGKILL)
    status, said = ask("estop", "release:=true")
    assert (status, "take forces again" in said) == (0, True)
    assert said.endswith("; the coupler does not answer")
    os.kill(late.process.pid, signal.SIGKILL)
    late.end()
    status, said = ask("estop")
    assert (status, len(said.splitlines())) == (1, 1), said
    assert "not confirmed: slave_device did not answer in 3 attempts; the stop is" in said
    observer.wait_for_state(MASTER_STOPPED, True)
    assert nodes["master_device"].end(signal.SIGINT) == 0, nodes["master_device"].text


def test_a_bag_of_a_stop_and_its_release_can_be_played_and_does_not_more_than_stop(
    haptic_accel: Start, start: Start, observer: Observer, tmp_path: Path
) -> None:
    def stop(graph: Command) -> None:
        observer.call(SetBool, EMERGENCY_STOP.name, SetBool.Request(data=True))
        graph.wait_for("let go: emergency stop")

    def engage(graph: Command) -> None:
        so_far = len(graph.lines)
        wait_until(lambda: released(observer)[0], "released")
        graph.wait_for("engaged", after=so_far)

    graph = haptic_accel("teleop", "rate:=200", "bag:=bag")
    graph.wait_for("engaged")
    observer.collect((ACTUATOR_FORCE,), 100)
    button = observer.node.create_publisher(
        Bool, EMERGENCY_STOP.name, quality(EMERGENCY_STOP, depth=1)
    )
    button.publish(Bool(data=True))
    graph.wait_for("let go: emergency stop")
    refused = "/observer published true on the topic, or may have: let it publish false, or end it"
    assert released(observer) == (False, refused)
    button.publish(Bool(data=False))
    engage(graph)
    observer.node.destroy_publisher(button)
    observer.collect((ACTUATOR_FORCE,), 100)
    assert graph.end(signal.SIGINT) == 0, graph.text
    counts = read_bag(tmp_path / "bag").counts
    assert all(counts[f"/{topic.name}"] for topic in (EMERGENCY_STOP, *STOPPED))

    graph = haptic_accel("teleop", "rate:=200", "record:=false")
    graph.wait_for("engaged")
    observer.collect((MASTER_ARM_FORCE,), 100)  # the device counts anew at the arm's first force
    stop(graph)
    so_far, before = len(graph.lines), applied(observer)
    player = start(BAG_PLAYER, tmp_path / "bag", "all")
    assert player.end() == 0, player.text
    for topic in STOPPED:
        observer.wait_for_state(topic, True)
    assert applied(observer) == before
    assert not any("engaged" in line or "stop released" in line for line in graph.lines[so_far:])
    engage(graph)
    so_far = len(graph.lines)
    start(BAG_PLAYER, tmp_path / "bag", "all")
    # Beside two senders of everything the arms are let go at once, and stopped all the same.
    graph.wait_for("slave_device]: emergency stop: no force", after=so_far)
    assert graph.end(signal.SIGINT) == 0, graph.text


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ("release:=perhaps", "release = 'perhaps': must be true or false"),
        ("relase:=true", "relase: no such argument"),
        ("namespace:=a-b", "namespace = 'a-b': must be letters, digits and _"),
    ],
)
def test_wrong_words_are_refused_in_one_line(word: str, named: str) -> None:
    assert refusal("estop", word).startswith(named)

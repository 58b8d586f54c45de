# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The emergency stop, from a terminal and by whoever else publishes it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.graph.stop_signal import PendingStop
from haptic_accel.nodes.supervised_node import quality
from observing import Observer
from running import BAG_PLAYER, Command, Start, wait_until

Ask = Callable[..., tuple[int, str]]

STOPPED = (topics.COUPLER_STOPPED, topics.MASTER_STOPPED, topics.SLAVE_STOPPED)

APPLIED = ("arm force count", "actuator force count")
"""Counts of the forces that the master device applied."""


def all_are(observer: Observer, stopped: bool) -> None:
    """Wait until devices and coupler tell that they are stopped, or are not."""
    for topic in STOPPED:
        observer.wait_for_state(topic, stopped)


def stop_publisher(observer: Observer) -> Any:
    topic = topics.EMERGENCY_STOP
    return observer.node.create_publisher(Bool, topic.name, quality(topic, depth=1))


def applied(observer: Observer) -> list[int]:
    """Return how many forces a stopped master device has applied.

    Diagnostics are read only once they say that it is stopped: a report is sent up to a third of
    a second after it was gathered.
    """
    values = observer.status("master_device", "emergency stop")
    return [int(values[name]) for name in APPLIED]


def stop_from_a_terminal(
    graph: Command, haptic_accel: Start, observer: Observer, ask: Ask
) -> None:
    """Stop a graph by the command, check that it applies no force, and release it."""
    observer.collect((topics.ACTUATOR_FORCE,), 100)
    seen = len(graph.lines)
    stop = haptic_accel("estop")
    assert stop.end() == 0, stop.text
    assert stop.lines[-1].startswith("emergency stop: both devices are without force (1 process ")
    all_are(observer, True)
    graph.wait_for("uncoupled: emergency stop", after=seen)
    before = applied(observer)
    # The compensator goes on: what it sends meanwhile is refused.
    observer.collect((topics.ACTUATOR_FORCE,), 100)
    assert applied(observer) == before
    refused = "haptic-accel: coupler: emergency stop: release it first"
    assert ask("control", "engage:=true") == (1, refused)
    lines = [line for line in graph.lines[seen:] if "no force until it is released" in line]
    assert len(lines) == 2, lines
    seen = len(graph.lines)
    said = "emergency stop released: slave_device and master_device take forces again"
    assert ask("estop", "release:=true") == (0, said)
    graph.wait_for("engaged", after=seen)
    all_are(observer, False)
    # Forces flow again.
    more = {name: count + 100 for name, count in zip(APPLIED, before, strict=True)}
    observer.status("master_device", least=more)


def stop_by_whoever_publishes(graph: Command, observer: Observer) -> None:
    """Stop a graph by the topic, reliably or not, and release it."""
    for reliable in (True, False):
        # As `ros2 topic pub --once` does: nothing latched, gone soon after.
        volatile = replace(topics.EMERGENCY_STOP, reliable=reliable, latched=False)
        publisher = observer.node.create_publisher(Bool, volatile.name, quality(volatile))
        wait_until(lambda found=publisher: found.get_subscription_count() >= 3, "all found")
        seen = len(graph.lines)
        publisher.publish(Bool(data=True))
        graph.wait_for("uncoupled: emergency stop", after=seen)
        for topic in (topics.MASTER_STOPPED, topics.SLAVE_STOPPED):
            observer.wait_for_state(topic, True)
        observer.node.destroy_publisher(publisher)
        engage(graph, observer)


def engage(graph: Command, observer: Observer) -> None:
    """Release a graph by the coupler's service, and wait until its arms are engaged."""
    seen = len(graph.lines)
    wait_until(lambda: released(observer)[0], "released")
    graph.wait_for("engaged", after=seen)


def released(observer: Observer) -> tuple[bool, str]:
    """Ask the coupler for the release; return whether it is granted, and its message."""
    answer = observer.call(SetBool, topics.EMERGENCY_STOP.name, SetBool.Request(data=False))
    return answer.success, answer.message


@pytest.fixture
def unconfirmed(monkeypatch: pytest.MonkeyPatch, ask: Ask) -> Ask:
    """Run the verb where nobody answers, in one short attempt instead of three."""

    def asked(*words: str) -> tuple[int, str]:
        with monkeypatch.context() as once:
            for name, value in (("ATTEMPTS", 1), ("TIMEOUT", 0.5), ("REASON_TIME", 0.5)):
                once.setattr(f"haptic_accel.cli.estop.{name}", value)
            return ask("estop", *words)

    return asked


def test_a_stop_holds_from_the_start_of_a_graph_and_while_it_runs_until_it_is_released(
    haptic_accel: Start, observer: Observer, ask: Ask, unconfirmed: Ask, domain: int
) -> None:
    status, said = unconfirmed("namespace:=left")
    assert status == 1
    assert said.endswith(
        f"; the stop is pending: no graph of ROS domain {domain} on this machine takes forces"
        " until haptic-accel estop release:=true namespace:=left"
    )
    graph = haptic_accel("teleop", "record:=false", "controller:=constant", "surface:=text")
    stop = haptic_accel("estop")
    graph.wait_for(r"\[slave_device\]: emergency stop: no force until it is released")
    graph.wait_for(r"\[master_device\]: emergency stop: no force until it is released")
    if stop.end():  # on a busy machine the graph may come later than the command waits for it
        assert "; the stop is pending: no graph of ROS domain" in stop.lines[-1]
    all_are(observer, True)
    assert not any(line.endswith("engaged") for line in graph.lines), graph.text
    status, said = ask("estop", "release:=true")
    assert (status, "take forces again" in said) == (0, True), said
    graph.wait_for("engaged")  # beside the stop that is pending for another namespace
    assert not PendingStop(domain, "").is_new()
    nobody = "emergency stop released for graphs that start; none answers"
    assert unconfirmed("release:=true", "namespace:=left") == (0, nobody)
    stop_from_a_terminal(graph, haptic_accel, observer, ask)
    stop_by_whoever_publishes(graph, observer)
    assert graph.end(signal.SIGINT) == 0, graph.text


def test_a_stop_that_cannot_be_confirmed_says_what_is_done(
    unconfirmed: Ask, monkeypatch: pytest.MonkeyPatch, domain: int
) -> None:
    monkeypatch.setattr("rclpy.init", None)
    status, said = unconfirmed()
    assert status == 1
    assert "not confirmed: 'NoneType' object is not callable; the stop is pending: no" in said
    monkeypatch.setattr("haptic_accel.cli.estop.has_ros", lambda: False)
    released = "emergency stop released for graphs that start; none answers"
    assert unconfirmed("release:=true") == (0, released)
    assert unconfirmed("release:=true")[1].startswith("haptic-accel: estop needs ROS 2")


def test_a_bag_of_a_stop_and_its_release_can_be_played_and_does_not_more_than_stop(
    haptic_accel: Start, start: Start, observer: Observer, tmp_path: Path
) -> None:
    graph = haptic_accel("teleop", "rate:=200", "bag:=bag")
    graph.wait_for("engaged")
    observer.collect((topics.ACTUATOR_FORCE,), 100)
    button = stop_publisher(observer)
    seen = len(graph.lines)
    button.publish(Bool(data=True))
    graph.wait_for("uncoupled: emergency stop", after=seen)
    refused = "/observer published true on the topic, or may have: let it publish false, or end it"
    assert released(observer) == (False, refused)
    button.publish(Bool(data=False))
    engage(graph, observer)
    observer.node.destroy_publisher(button)
    observer.collect((topics.ACTUATOR_FORCE,), 100)
    assert graph.end(signal.SIGINT) == 0, graph.text
    counts = read_bag(tmp_path / "bag").counts
    assert all(counts[f"/{topic.name}"] for topic in (topics.EMERGENCY_STOP, *STOPPED))

    graph = haptic_accel("teleop", "rate:=200", "record:=false")
    graph.wait_for("engaged")
    # The device counts again at the arm's first force.
    observer.collect((topics.MASTER_ARM_FORCE,), 100)
    observer.call(SetBool, topics.EMERGENCY_STOP.name, SetBool.Request(data=True))
    graph.wait_for("uncoupled: emergency stop")
    so_far, before = len(graph.lines), applied(observer)
    player = start(BAG_PLAYER, tmp_path / "bag", "all")
    assert player.end() == 0, player.text
    all_are(observer, True)
    assert applied(observer) == before
    assert not any("engaged" in line or "stop released" in line for line in graph.lines[so_far:])
    engage(graph, observer)
    so_far = len(graph.lines)
    start(BAG_PLAYER, tmp_path / "bag", "all")
    # Beside two senders of everything the arms are let go at once, and stopped all the same.
    graph.wait_for("slave_device]: emergency stop: no force", after=so_far)
    assert graph.end(signal.SIGINT) == 0, graph.text


def test_a_stop_outlasts_who_gave_it_and_the_coupler_and_all_are_released_or_none(
    start: Start,
    observer: Observer,
    ask: Ask,
    unconfirmed: Ask,
    domain: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words = {
        "slave_device": [],
        "master_device": [],
        "compensator": ["--ros-args", "-p", "controller:=constant"],
        "coupler": ["--ros-args", "-p", "compensated:=true"],
    }

    def begin(name: str) -> Command:
        return start("-m", f"haptic_accel.nodes.{name}", *words[name])

    def kill(node: Command) -> None:
        os.kill(node.process.pid, signal.SIGKILL)
        node.end()

    # A stop that nobody confirmed is pending for the graph that comes.
    assert unconfirmed()[0] == 1
    nodes = {name: begin(name) for name in words}
    all_are(observer, True)
    told = "pending: release it by haptic-accel estop release:=true"
    wait_until(lambda: any(told in node.text for node in nodes.values()), "the first to stop says")
    engage(nodes["coupler"], observer)
    assert not PendingStop(domain, "").is_new()
    observer.call(SetBool, topics.EMERGENCY_STOP.name, SetBool.Request(data=True))
    all_are(observer, True)
    nodes["slave_device"].process.send_signal(signal.SIGSTOP)
    assert released(observer) == (False, "slave_device: no answer within 1 s")
    nodes["slave_device"].process.send_signal(signal.SIGCONT)
    all_are(observer, True)
    # A coupler that starts again is told of the stop.
    kill(nodes["coupler"])
    nodes["coupler"] = begin("coupler")
    nodes["coupler"].wait_for(
        "only (slave and master|master and slave) stopped; all are stopped again"
    )
    observer.wait_for_state(topics.COUPLER_STOPPED, True)
    wait_until(lambda: released(observer)[0], "released, once the coupler is old enough")
    nodes["coupler"].wait_for("engaged")

    # Forces flow; then the one who sends them dies.
    observer.collect((topics.ACTUATOR_FORCE,), 100)
    with observer.watching(topics.DIAGNOSTICS) as reported:
        # Found before that dies, as it is reported once.
        reported(lambda array: array.status[0].name.startswith("master_device"))
        os.kill(nodes["compensator"].process.pid, signal.SIGKILL)
        timed_out = "actuator force timed out"
        reported(lambda array: any(timed_out in one.message for one in array.status))
    # Anybody may stop by the topic alone, and be gone.
    anybody = stop_publisher(observer)
    anybody.publish(Bool(data=True))
    for topic in (topics.MASTER_STOPPED, topics.SLAVE_STOPPED):
        observer.wait_for_state(topic, True)
    nodes["coupler"].wait_for("uncoupled: emergency stop")
    observer.node.destroy_publisher(anybody)
    kill(nodes["slave_device"])
    late = begin("slave_device")
    late.wait_for("emergency stop: no force until it is released")
    os.kill(nodes["coupler"].process.pid, signal.SIGKILL)
    status, said = ask("estop", "release:=true")
    assert (status, "take forces again" in said) == (0, True)
    assert said.endswith("; the coupler does not answer")
    kill(late)
    monkeypatch.setattr("haptic_accel.cli.estop.TIMEOUT", 1.0)
    status, said = ask("estop")
    assert (status, len(said.splitlines())) == (1, 1), said
    assert "not confirmed: slave_device did not answer in 3 attempts; the stop is" in said
    observer.wait_for_state(topics.MASTER_STOPPED, True)
    assert nodes["master_device"].end(signal.SIGINT) == 0, nodes["master_device"].text

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The compensator in a graph that runs, with samples of a foreign sender."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import ACTUATOR_FORCE, TOOL_ACCELERATION
from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.interface import GraphNode, message_type, quality
from observing import Observer
from running import PATIENCE, Command

HOUR = 3600 * 10**9


def test_samples_stamped_an_hour_off_are_refused_and_the_compensator_goes_on(
    haptic_accel: Callable[..., Command], observer: Observer
) -> None:
    graph = haptic_accel("teleop", "record:=false")
    graph.wait_for("engaged")
    kind = message_type(TOOL_ACCELERATION)
    sent = observer.node.create_publisher(kind, TOOL_ACCELERATION.name, quality(TOOL_ACCELERATION))
    while not sent.get_subscription_count():
        observer.executor.spin_once(timeout_sec=0.01)
    before = int(observer.status("compensator")["samples out of date"])
    for off in (HOUR, -HOUR):
        stamp = time.time_ns() + off
        sent.handle.publish_raw(StampedVector(TOOL_ACCELERATION).pack(stamp, (0.0, 0.0, 1.0)))
    least = {"samples out of date": before + 2}
    observer.status("compensator", "samples out of date", least)
    now = time.time_ns() / 1e9
    for message in observer.collect((ACTUATOR_FORCE,), 100)[ACTUATOR_FORCE.name]:
        stamp = message.header.stamp
        assert abs(stamp.sec - now) < HOUR / 1e9 / 2
    assert graph.end(signal.SIGINT) == 0, graph.text


def test_a_clock_that_is_set_back_is_logged_once_and_the_compensator_goes_on(
    domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    rclpy.init()
    node, other = Compensator(), GraphNode("coupler")
    executor = SingleThreadedExecutor()
    executor.add_node(other)
    tool = other.sender(TOOL_ACCELERATION)
    caused: list[int] = []
    other.listen(ACTUATOR_FORCE, lambda stamp, _: caused.append(stamp))

    def run(ahead: int, reached: Callable[[], bool]) -> None:
        """Send samples with stamps ahead of now, in ns, until something is reached."""
        deadline = time.monotonic() + PATIENCE
        while not reached():
            assert time.monotonic() < deadline
            tool.send(time.time_ns() + ahead, (0.0, 0.0, 1.0))
            node.work()
            executor.spin_once(timeout_sec=0.001)

    run(80_000_000, lambda: len(caused) > 20)
    newest = time.time_ns() + 80_000_000
    run(0, lambda: caused[-1] > newest)
    assert capfd.readouterr().err.count("a clock was set by -0.0") == 1
    executor.shutdown()
    for each in (node, other):
        each.destroy_node()
    rclpy.shutdown()

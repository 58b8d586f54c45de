# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""All nodes of one process in a loop."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from time import sleep
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from haptic_accel.core import topics
from haptic_accel.core.model import Vector
from haptic_accel.core.tick import ARM
from haptic_accel.devices import SLAVES, DeviceError, Sample
from haptic_accel.devices.simulated import SimulatedSlave
from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.coupler import Coupler
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.master_device import build_master_device
from haptic_accel.nodes.scheduling import StopPoll
from haptic_accel.nodes.slave_device import build_slave_device
from haptic_accel.nodes.supervised_node import WIRES
from running import PATIENCE


class Fragile(SimulatedSlave):
    """A simulated slave that fails when told to."""

    broken, slow = False, 0.0

    def read(self, time: float) -> Sample:
        """Give a sample unless it is broken."""
        if self.broken:
            raise DeviceError("unplugged")
        sleep(self.slow)
        return super().read(time)


class Process:
    """The nodes that share a process by default, and their loop."""

    def __init__(self) -> None:
        self.master, self.slave = build_master_device(), build_slave_device()
        self.coupler, self.compensator = Coupler(), Compensator()
        self.nodes: list[GraphNode] = [self.master, self.slave, self.coupler, self.compensator]
        self.loop = join(self.nodes)
        self.loop.begin()
        self.stop_poll = StopPoll([self.loop])
        self.executor = SingleThreadedExecutor()
        for node in self.nodes:
            self.executor.add_node(node)

    def until(self, condition: Callable[[], bool]) -> None:
        """Let the loop run until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline
            while self.stop_poll.after_work(self.loop.work()) <= time.monotonic():
                pass
            self.executor.spin_once(timeout_sec=0.0005)

    @property
    def engaged(self) -> bool:
        """The arms are coupled."""
        return self.coupler.engagement.engaged

    def close(self) -> None:
        """End all nodes."""
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()


@pytest.fixture
def process(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Process]:
    monkeypatch.setattr(WIRES, "joined", True)
    monkeypatch.setitem(SLAVES, "simulated", Fragile)
    rclpy.init()
    process = Process()
    yield process
    process.close()
    rclpy.shutdown()


def test_arms_are_coupled_without_a_message_and_show_what_they_do(process: Process) -> None:
    process.until(lambda: process.engaged)
    names = {f"/{topic.name}" for topic in topics.SIGNALS}
    for node in process.nodes:
        found = node.get_subscriber_names_and_types_by_node(node.get_name(), "/")
        assert not names.intersection(name for name, _ in found), node.get_name()
    received: dict[str, dict[int, Vector]] = {}
    observer: Any = GraphNode("recorder")
    process.nodes.append(observer)
    process.executor.add_node(observer)
    for topic in topics.SIGNALS:
        values = received.setdefault(topic.name, {})
        observer.listen(topic, values.__setitem__)
    process.until(lambda: all(len(values) > 50 for values in received.values()))
    # What belongs to a tick has its stamp.
    stamps = [set(values) for values in received.values()]
    assert len(set.intersection(*stamps)) > 20


def test_a_loop_that_is_too_slow_names_the_rate_that_is_held(
    process: Process, capfd: pytest.CaptureFixture[str]
) -> None:
    device = process.slave.device
    assert isinstance(device, Fragile)
    device.slow = 1e-3
    for _ in range(1500):
        process.loop.work()
    process.slave.report()
    said = r"1000 Hz is not held: \d+% of the ticks are late; a tick takes \d{4} us of 1000 us; .*"
    assert re.search(said, capfd.readouterr().err)


def test_late_forces_are_named_where_the_ticks_are_in_time(
    process: Process, capfd: pytest.CaptureFixture[str]
) -> None:
    forces = process.slave.side.forces[ARM]
    forces.due, forces.missed = 1000, 50
    forces.age.add(2.2e-3)
    process.slave.rate_keeper.work.add(100e-6)
    process.slave.report()
    said = (
        r"1000 Hz is not held: 50 of 1000 forces \(arm force\) are late; .*; rate:=500 would hold"
    )
    assert re.search(said, capfd.readouterr().err)


def test_a_device_that_fails_leaves_the_others_running_and_the_arms_free(process: Process) -> None:
    process.until(lambda: process.engaged)
    device = process.slave.device
    assert isinstance(device, Fragile)
    device.broken = True
    process.until(lambda: not process.engaged)
    ticks = process.master.rate_keeper.ticks
    process.until(lambda: process.master.rate_keeper.ticks > ticks + 20)
    assert process.master.side.sampling
    assert process.slave.state == "unconfigured"
    assert process.coupler.missing() == "waiting for the position of slave"

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forces of a second publisher that reach a device: ``python benchmarks/rival_bursts.py``.

`master_device` and the sender of its forces run in a process each. The benchmark is a third
process. In each burst it begins to publish a force, sends a few messages and stops publishing.
The device itself counts what it receives; the sender's forces and the rival's have different
signs.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle, islice, product
from pathlib import Path
from typing import Any

import click
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from haptic_accel import Vector
from haptic_accel.commands import json_option, save
from haptic_accel.core import topics
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import Topic
from haptic_accel.devices import MASTERS, SimulatedMaster
from haptic_accel.graph.domain import middleware_defaults
from haptic_accel.nodes import master_device
from haptic_accel.nodes.supervised_node import message_type, offered_quality

DEVICE, SENDER = "device", "sender"
"""Roles of the benchmark's other processes."""

FORCES = topics.MASTER_ARM_FORCE, topics.ACTUATOR_FORCE

COMMANDS = *FORCES, topics.MASTER.topic("servo_cp", topics.MASTER_POSITION.type)
"""Commands of the rival: forces, and positions of the arm."""

GENUINE: Vector = (0.0, 0.0, 0.1)
"""Force of the sender, N."""

RIVAL: Vector = (0.0, 0.0, -3.0)
"""Force of the rival, N, or position of the arm, m, which would cause a force of the same sign."""

MESSAGES = 3
"""Messages of the rival in a burst."""

SEEN = 5
"""Ticks that a known rival is silent before its messages."""

BETWEEN = 2
"""Ticks from a burst to the next, in which the sender's forces are applied again."""

PATIENCE = 30.0
"""Longest time for an event, s."""


def trace_device(path: Path) -> None:
    """Run a device node whose device notes the sign of each force that it receives."""
    trace = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    class Traced(SimulatedMaster):
        def write(self, time: float, **forces: Any) -> None:
            components = [each for force in forces.values() if force for each in force]
            if any(components):
                os.write(trace, b"-" if min(components) < 0 else b"+")
            super().write(time, **forces)

    MASTERS["simulated"] = Traced
    master_device.main()


def send_forces(rate: float) -> None:
    """Send both forces at a rate, Hz, until the process is ended."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("sender")
    sends = [sender_of(node, topic, GENUINE) for topic in FORCES]
    while True:
        tick = int(time.monotonic() * rate) + 1
        time.sleep(max(0.0, tick / rate - time.monotonic()))
        for _, send in sends:
            send()


def sender_of(node: Node, topic: Topic, force: Vector) -> tuple[Any, Any]:
    """Return a publisher, and a function that sends a force with the present time."""
    publisher = node.create_publisher(message_type(topic), topic.name, offered_quality(topic))
    pack = StampedVector(topic).pack
    return publisher, lambda: publisher.handle.publish_raw(pack(time.time_ns(), force))


@contextmanager
def process(*words: str) -> Iterator[None]:
    """Run this script in another role, and end it."""
    running = subprocess.Popen([sys.executable, __file__, *words], start_new_session=True)
    try:
        yield
    finally:
        running.terminate()
        running.wait()


def measure(rate: float, bursts: int, domain: int) -> dict[str, float]:
    """Return the numbers of forces that the device received.

    Parameters
    ----------
    rate : float
        Samples per second.
    bursts : int
        Number of bursts. They alternate between `COMMANDS`, and between a rival that sends as
        soon as it is connected and one that the device has refused for `SEEN` ticks.
    domain : int
        ROS domain.
    """
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    os.environ.update(middleware_defaults(os.environ))
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder) / "trace"
        parameters = "--ros-args", "-p", f"rate:={rate}"
        with process(DEVICE, str(trace), *parameters), process(SENDER, str(rate)):
            rclpy.init()
            node = rclpy.create_node("rival")
            _wait_for(
                lambda: trace.exists() and trace.stat().st_size > rate, "no force is applied"
            )
            begun = time.monotonic()
            sent = 0
            for topic, seen in islice(cycle(product(COMMANDS, (False, True))), bursts):
                sent += _burst(node, topic, rate, seen=seen)
                time.sleep(BETWEEN / rate)
            seconds = time.monotonic() - begun
            rclpy.shutdown()
        received = Counter(trace.read_bytes())
    return {
        "rate_hz": rate,
        "bursts": bursts,
        "seconds": round(seconds, 1),
        "sent_by_rival": sent,
        "applied_of_sender": received[ord("+")],
        "applied_of_rival": received[ord("-")],
    }


def _burst(node: Node, topic: Topic, rate: float, *, seen: bool) -> int:
    """Publish a few messages from a new publisher; return their number."""
    publisher, send = sender_of(node, topic, RIVAL)
    _wait_for(publisher.get_subscription_count, "the device does not subscribe")
    if seen:
        time.sleep(SEEN / rate)
    for _ in range(MESSAGES):
        send()
    node.destroy_publisher(publisher)
    return MESSAGES


def _wait_for(condition: Any, otherwise: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise click.ClickException(f"{otherwise} within {PATIENCE:g} s")
        time.sleep(1e-4)


@click.command()
@click.option("--rate", type=click.FloatRange(50.0, 5000.0), default=200.0, help="Samples per s.")
@click.option("--bursts", type=click.IntRange(1), default=1000, help="Number of bursts.")
@click.option("--domain", type=click.IntRange(0, 100), default=100, help="ROS domain.")
@json_option
def rival_bursts(*, rate: float, bursts: int, domain: int, json_file: Path | None) -> None:
    """Print how many forces of a second publisher reach a device."""
    found = measure(rate, bursts, domain)
    save(found, json_file)
    click.echo(json.dumps(found, indent=2))


if __name__ == "__main__":
    role, *words = sys.argv[1:] or [""]
    if role == DEVICE:
        trace_path, *sys.argv[1:] = words
        trace_device(Path(trace_path))
    elif role == SENDER:
        send_forces(float(words[0]))
    else:
        rival_bursts()

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from collections.abc import Callable

from running import Command

DESTROYED = """
import os
import rclpy
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.slave_device import SlaveDevice

def threads_after(build):
    node = build()
    running = len(os.listdir("/proc/self/task"))
    node.destroy_node()
    return running, len(os.listdir("/proc/self/task"))

rclpy.init()
running, left = threads_after(lambda: GraphNode("coupler"))
assert left < running, (running, left)
print("left", left, threads_after(SlaveDevice)[1])
"""


def test_no_thread_of_the_middleware_outlives_a_managed_node(
    start: Callable[..., Command],
) -> None:
    command = start("-c", DESTROYED)
    assert command.end() == 0, command.text
    _, plain, managed = command.lines[-1].split()
    assert managed == plain

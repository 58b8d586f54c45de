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

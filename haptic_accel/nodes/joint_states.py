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

"""Joint states of the arms for displays: positions as the joints of their description."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState

from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import JOINT_STATE_RATE, JOINT_STATES, Topic
from haptic_accel.nodes.graph_node import GraphNode


def joint_state(stamp: int, frame: str = "", **fields: Any) -> JointState:
    """Return a message with a stamp, system time in ns, a frame, and fields by name."""
    message = JointState(**fields)
    sec, nanosec = divmod(stamp, NANOSECONDS)
    message.header.stamp, message.header.frame_id = Time(sec=sec, nanosec=nanosec), frame
    return message


class JointStates:
    """Publishes an arm's position at a low rate while it has subscribers.

    Parameters
    ----------
    node : GraphNode
    position : Topic
        The arm's position.
    rate : float
        Samples per second.
    """

    def __init__(self, node: GraphNode, position: Topic, rate: float) -> None:
        self._publisher = node.publisher(JOINT_STATES)
        self._names = [f"{position.source}_{axis}" for axis in "xyz"]
        self._every = max(1, round(rate / JOINT_STATE_RATE))
        self._passed = 0

    def add(self, stamp: int, position: Vector) -> None:
        """Publish a sample, system time in ns and m, unless it follows too soon."""
        self._passed += 1
        if self._passed < self._every:
            return
        self._passed = 0
        if self._publisher.get_subscription_count() == 0:
            return
        self._publisher.publish(joint_state(stamp, name=self._names, position=position))

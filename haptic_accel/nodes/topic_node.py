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

"""Message classes and qualities of service of the topics."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from haptic_accel.core.topics import Topic

DEPTH = 1000
"""Number of messages kept for a subscriber: what comes in `CATCH_UP` at the highest rates."""

SENT = 10
"""Number of messages kept by a publisher."""


def message_type(topic: Topic) -> Any:
    """Import a topic's message class."""
    package, _, name = topic.type.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def quality(topic: Topic, depth: int = DEPTH) -> QoSProfile:
    """Return a subscriber's quality of service: signals as sensor data, events reliable."""
    reliability = ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT
    latched, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=depth, reliability=reliability, durability=latched if topic.latched else volatile
    )


def offered_quality(topic: Topic, depth: int = SENT) -> QoSProfile:
    """Return a publisher's quality of service: reliable, which suits all subscribers."""
    return quality(replace(topic, reliable=True), 1 if topic.latched else depth)

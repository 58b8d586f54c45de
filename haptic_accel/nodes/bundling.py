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

"""Bundles of signals: one publisher for all nodes of a process."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from haptic_accel.core.bundles import BUNDLE_PERIOD, Bundle
from haptic_accel.core.model import Quaternion, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import BUNDLES

BUNDLES_KEPT = 100
"""Number of bundles kept by a publisher: those of two seconds, to be sent again if one is lost."""

FLUSH_PERIOD = 0.1
"""Interval at which a bundle is sent when no sample follows its last, s."""

_PERIOD = round(BUNDLE_PERIOD * NANOSECONDS)

_shared: dict[tuple[Any, str], BundleSender] = {}


def participant(endpoint: Any) -> bytes:
    """Return the globally unique identifier of an endpoint's process."""
    return bytes(endpoint.endpoint_gid)[:12]


def owner(endpoint: Any) -> tuple[bytes, str]:
    """Return an endpoint's process and the full name of its node."""
    return participant(endpoint), f"{endpoint.node_namespace}/{endpoint.node_name}"


def join(node: Node, offer: Callable[[], Publisher]) -> BundleSender:
    """Return the bundles that all nodes of a process and namespace share.

    Parameters
    ----------
    node : Node
    offer : callable
        Creates the publisher of the bundles for their first node.
    """
    key = _key(node)
    if key not in _shared:
        _shared[key] = BundleSender(node, offer())
    return _shared[key]


def _key(node: Node) -> tuple[Any, str]:
    return node.context, node.resolve_topic_name(BUNDLES.name)


class BundleSender:
    """Collects the samples of a process's signals, and publishes them in bundles.

    Parameters
    ----------
    node : Node
        Node that publishes the bundles; once it is destroyed, bundling stops.
    publisher : Publisher

    Attributes
    ----------
    listening : callable
        Returns the number of subscribers found.
    period : int
        Number of bundles due so far, with samples or without. Subscribers are counted once in each
        period: counting them for each sample would take longer than all else.
    """

    def __init__(self, node: Node, publisher: Publisher) -> None:
        self._node = node
        self._bundle = Bundle()
        self._listened = self._since = 0
        self.period = 1
        self.index, self._add = self._bundle.index, self._bundle.put
        self._name = publisher.topic_name
        self._publish: Any = publisher.handle.publish_raw
        self.listening: Callable[[], int] = publisher.handle.get_subscription_count
        node.create_timer(FLUSH_PERIOD, self.flush)

    def listeners(self, node: Node) -> set[tuple[bytes, str]]:
        """Return the `owner` of each subscriber."""
        return set(map(owner, node.get_subscriptions_info_by_topic(self._name)))

    def put(self, index: int, stamp: int, vector: Vector, orientation: Quaternion) -> None:
        """Add a sample of a topic, sent now."""
        now = time.time_ns()
        is_full = self._listened and self._add(now, index, stamp, *vector, *orientation)
        # A clock that is set back must not delay samples.
        if is_full or not 0 <= now - self._since < _PERIOD:
            self.flush()

    def flush(self) -> None:
        """Publish collected samples, and count the subscribers anew."""
        if data := self._bundle.flush():
            self._publish(data)
        self._since, self._listened = time.time_ns(), self.listening()
        self.period += 1

    def leave(self, node: Node) -> None:
        """Publish collected samples before a node is destroyed."""
        if node is self._node:
            self.listening = int
            del _shared[_key(node)]
        self.flush()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorder of all visible topics that knows nothing of this package, as `ros2 bag record -a`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from bag_maker import Message, write_messages
from observing import Observer
from reading import with_types

DISCOVERY_PERIOD = 0.5
"""Interval between searches for topics, s."""

QUIET = 1.0
"""Time without a message after which all are received, s."""


class OtherRecorder:
    """Subscribes to each visible topic by the quality that its publishers offer.

    Parameters
    ----------
    observer : Observer
        Node that records.

    Attributes
    ----------
    messages : list of Message
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._known: set[str] = set()
        self.messages: list[Message] = []

    @property
    def seconds(self) -> float:
        """Time from the first message to the last, s."""
        if not self.messages:
            return 0.0
        return (self.messages[-1].received - self.messages[0].received) * 1e-9

    def record_until(self, ended: Callable[[], bool], quiet: float = QUIET) -> None:
        """Record until something has happened, and then until no message came for a time in s."""
        looked = last = 0.0
        while not ended() or time.monotonic() - last < quiet:
            if time.monotonic() - looked > DISCOVERY_PERIOD:
                self._discover()
                looked = time.monotonic()
            count = len(self.messages)
            self._observer.executor.spin_once(timeout_sec=0.1)
            last = time.monotonic() if len(self.messages) > count else last

    def write(self, bag: Path) -> Path:
        """Write the messages as a bag without custom data."""
        return write_messages(bag, sorted(self.messages, key=lambda each: each.received))

    def _discover(self) -> None:
        node = self._observer.node
        for topic, kinds in node.get_topic_names_and_types():
            offered = [each.qos_profile for each in node.get_publishers_info_by_topic(topic)]
            if offered and topic not in self._known and not topic.startswith("/_"):
                self._known.add(topic)
                self._subscribe(topic, kinds[0], offered)

    def _subscribe(self, topic: str, kind: str, offered: Sequence[QoSProfile]) -> None:
        reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in offered)
        latched = all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offered)
        profile = QoSProfile(
            depth=10_000,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        package, _, name = kind.split("/")
        message: Any = getattr(import_module(f"{package}.msg"), name)

        def keep(data: bytes) -> None:
            self.messages.append(Message(topic, kind, time.time_ns(), data))

        self._observer.node.create_subscription(message, topic, keep, profile, raw=True)


def converted(bag: Path, copy: Path) -> Path:
    """Copy a bag's messages alone, as `ros2 bag convert` does."""
    return write_messages(copy, [Message(*row) for row in with_types(bag)])

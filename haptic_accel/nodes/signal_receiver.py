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

"""Reception of signals for a recording: in bundles, or by topic from unbundled senders."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping

from haptic_accel.core.bundles import DUPLICATE_MEMORY, BothWays, believed, unpack_bundle
from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.topics import BUNDLES, Topic
from haptic_accel.nodes.bundling import participant
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.signals import Inbox

DISCOVERY_PERIOD = 0.1
"""Interval between looks for new publishers, s."""

FULL_LOOK_PERIOD = 1.0
"""Interval between looks for who they are if their numbers stay the same, s."""


class _Signal:
    """Signal received in bundles and, while necessary, by its own topic.

    Parameters
    ----------
    name : str
        Full name.
    topic : Topic

    Attributes
    ----------
    join : callable
        Makes a message from a sample of a bundle.
    inbox : Inbox or None
        Inbox of the signal's own topic; None while all come in bundles.
    senders : list of bytes
        Process of each publisher.
    bundled : bool
        Messages from the present publishers have come in bundles.
    both_ways : BothWays or None
        Received messages, while some may come both ways.
    """

    def __init__(self, name: str, topic: Topic) -> None:
        self.name, self.topic = name, topic
        self.join = StampedVector(topic).join
        self.inbox: Inbox | None = None
        self.senders: list[bytes] = []
        self.bundled = False
        self.both_ways: BothWays | None = None
        self._until = math.inf

    def subscribe(self, node: GraphNode) -> None:
        """Subscribe to the signal's own topic."""
        self.inbox = node.inbox(self.topic)
        self.both_ways = self.both_ways or BothWays()
        self._until = math.inf

    def leave(self, now: float) -> None:
        """Receive messages in bundles only, from a steady time in s on."""
        if self.inbox:
            self.inbox.leave()
            self.inbox = None
            self._until = now + DUPLICATE_MEMORY

    def forget(self, now: float) -> None:
        """Stop comparing once all separate messages have come in bundles, too."""
        if now >= self._until:
            self.both_ways = None

    def repeats(self, message: bytes, *, bundled: bool, now: float) -> bool:
        """Return whether a message came the other way."""
        return bool(self.both_ways and self.both_ways.repeats(message, bundled=bundled, now=now))


class SignalReceiver:
    """Receives each message of some signals once, in bundles wherever possible.

    A publisher sends its messages in bundles, too, if its process publishes bundles in the same
    namespace. It subscribes to the topic of a signal with another publisher or none.

    Parameters
    ----------
    node : GraphNode
    topics : mapping
        Signals by their full names.
    """

    def __init__(self, node: GraphNode, topics: Mapping[str, Topic]) -> None:
        self._node = node
        self._bundles = node.inbox(BUNDLES)
        self._signals = {name: _Signal(name, topic) for name, topic in topics.items()}
        self._left: list[tuple[int, str, bytes]] = []
        self._counts: list[int] = []
        self._look_due = 0.0
        for signal in self._signals.values():
            signal.subscribe(node)
        node.create_timer(DISCOVERY_PERIOD, self.poll)

    def drain(self) -> list[tuple[int, str, bytes]]:
        """Return system times in ns, full topic names, and received messages."""
        taken, self._left = self._left, []
        for signal in self._signals.values():
            taken += self._by_itself(signal)
        taken += self._in_bundles()
        return taken

    def poll(self) -> None:
        """Update the subscriptions to signals' own topics for the present publishers."""
        now = time.monotonic()
        names = self._bundles.name, *self._signals
        counts = [self._node.count_publishers(name) for name in names]
        pending = any(signal.inbox and signal.bundled for signal in self._signals.values())
        if counts == self._counts and not pending and now < self._look_due:
            return
        self._counts, self._look_due = counts, now + FULL_LOOK_PERIOD
        bundling = set(self._senders(names[0]))
        for signal in self._signals.values():
            senders = self._senders(signal.name)
            if senders != signal.senders:
                signal.senders, signal.bundled = senders, False
            signal.forget(now)
            # The bundles lack a second publisher of the same process.
            known = bool(senders) and len(bundling.intersection(senders)) == len(senders)
            if not known and not signal.inbox:
                signal.subscribe(self._node)
            elif known and signal.inbox and signal.bundled:
                self._left += self._by_itself(signal)
                signal.leave(now)

    def _senders(self, name: str) -> list[bytes]:
        return sorted(map(participant, self._node.get_publishers_info_by_topic(name)))

    def _by_itself(self, signal: _Signal) -> Iterator[tuple[int, str, bytes]]:
        now = time.monotonic()
        for data, received, _ in signal.inbox.drain(unpack_stamped_vector) if signal.inbox else ():
            if not signal.repeats(data, bundled=False, now=now):
                yield received, signal.name, data

    def _in_bundles(self) -> Iterator[tuple[int, str, bytes]]:
        now = time.monotonic()
        for _, received, bundle in self._bundles.drain(unpack_bundle):
            for name, sent, stamp, numbers in bundle:
                if signal := self._signals.get(name):
                    signal.bundled = True
                    message = signal.join(stamp, numbers)
                    if not signal.repeats(message, bundled=True, now=now):
                        yield believed(sent, received), name, message

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

"""Scene of the live scope: outlines, tool and handle, and the hand that is led."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from haptic_accel.core import topics
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.signals import Inbox, Sender
from haptic_accel.scope.server import FRAME_RATE
from haptic_accel.setup.arguments import POINTER

SIGNALS = {
    "tool": topics.SLAVE_POSITION,
    "tool_velocity": topics.SLAVE_VELOCITY,
    "handle": topics.MASTER_POSITION,
    "contact_force": topics.CONTACT_FORCE,
}
"""Topics of `haptic_accel.scope.frames.PLACES`."""


class ScopeScene:
    """Positions that a page shows, and set-points for the hand from the page's pointer.

    Parameters
    ----------
    node : GraphNode
    places : dict
        Filled with the latest vectors while a page shows them.
    master : callable
        Returns the known parameters of the master's node.
    """

    def __init__(
        self, node: GraphNode, places: dict[str, Vector], master: Callable[[], Mapping[str, Any]]
    ) -> None:
        self._node, self._places, self._master = node, places, master
        self._inboxes: dict[str, Inbox] = {}
        self._sender: Sender | None = None
        self._refusal = ""
        self._looking = node.create_timer(1 / FRAME_RATE, self._look, autostart=False)

    def show(self, shown: bool) -> None:
        """Receive the positions of tool and handle only while a page shows them."""
        if shown == bool(self._inboxes):
            return
        if shown:
            # The newest sample of each is enough: samples wake no thread.
            self._inboxes = {name: self._node.inbox(t, depth=1) for name, t in SIGNALS.items()}
            self._looking.reset()
        else:
            self._looking.cancel()
            for inbox in self._inboxes.values():
                inbox.leave()
            self._inboxes = {}
            self._places.clear()

    def update(self) -> None:
        """Create the sender of the hand's set-points if the master follows them."""
        if self._sender is None and self._master().get("device") == POINTER:
            try:
                self._sender = self._node.sender(topics.HAND_SET_POINT)
            except ParameterError as error:
                self._refusal = str(error)

    def lead(self, x: float, z: float) -> str:
        """Send a point to the hand, m; return the reason of a refusal, if any."""
        device = self._master().get("device") or "unknown"
        if device != POINTER:
            return f"hand: master = {device}: must be {POINTER} to be led"
        if self._sender is None:
            return f"hand: {self._refusal}"
        self._sender.send(time.time_ns(), (x, 0.0, z))
        return ""

    @property
    def is_led(self) -> bool:
        """True where a page can lead the hand."""
        return self._sender is not None and self._master().get("device") == POINTER

    def _look(self) -> None:
        for name, inbox in self._inboxes.items():
            for _, vector in inbox.drain_vectors():
                self._places[name] = vector

"""What the live scope shows of the scene: outlines, tool and handle, and the hand that is led."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from haptic_accel.core import topics
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.arguments import POINTER, SIMULATED
from haptic_accel.graph.files import SURFACE
from haptic_accel.nodes.interface import GraphNode, Inbox, Sender
from haptic_accel.scope.server import FRAME_RATE

VIEW = ((-0.1, 0.1), (-0.02, 0.08))
"""Part of the plane y = 0 that a page can show, m: where a led hand can go."""

SIGNALS = {
    "tool": topics.SLAVE_POSITION,
    "tool_velocity": topics.SLAVE_VELOCITY,
    "handle": topics.MASTER_POSITION,
}
"""Topics of `haptic_accel.scope.frames.PLACES`."""


class ScopeScene:
    """Scene of a page, and the set-points that its pointer gives the hand.

    Parameters
    ----------
    node : GraphNode
    places : dict
        Filled with the latest vectors while a page shows them.
    master, slave : callable
        Return the known parameters of the devices' nodes.
    """

    def __init__(
        self,
        node: GraphNode,
        places: dict[str, Vector],
        master: Callable[[], Mapping[str, Any]],
        slave: Callable[[], Mapping[str, Any]],
    ) -> None:
        self._node, self._places = node, places
        self._master, self._slave = master, slave
        self._inboxes: dict[str, Inbox] = {}
        self._sender: Sender | None = None
        self._refusal = ""
        self._looking = node.create_timer(1 / FRAME_RATE, self._look, autostart=False)

    def show(self, shown: bool) -> None:
        """Follow the places while a page shows them."""
        if shown == bool(self._inboxes):
            return
        if shown:
            # Of each, the newest is enough: what comes between wakes nobody.
            self._inboxes = {name: self._node.inbox(t, depth=1) for name, t in SIGNALS.items()}
            self._looking.reset()
        else:
            self._looking.cancel()
            for inbox in self._inboxes.values():
                self._node.leave(inbox)
            self._inboxes = {}
            self._places.clear()

    def update(self) -> None:
        """Offer to lead the hand of a master that can be led; called after parameters changed."""
        if self._sender is None and self._master().get("device") == POINTER:
            try:
                self._sender = self._node.sender(topics.HAND_SET_POINT)
            except ParameterError as error:
                self._refusal = str(error)

    def lead(self, x: float, z: float) -> str:
        """Send a point to the hand, m; return why not, in one line, or nothing."""
        device = self._master().get("device", "unknown")
        if device != POINTER:
            return f"hand: master = {device}: must be {POINTER} to be led"
        if self._sender is None:
            return f"hand: {self._refusal}"
        self._sender.send(time.time_ns(), (x, 0.0, z))
        return ""

    @property
    def name(self) -> str | None:
        """Name of what the tool can touch; None if that is not known."""
        slave = self._slave()
        return slave.get(f"{SURFACE}name") if slave.get("device") == SIMULATED else None

    @property
    def is_led(self) -> bool:
        """Whether a page can lead the hand."""
        return self._sender is not None and self._master().get("device") == POINTER

    def drawing(self) -> dict[str, Any]:
        """Return view, outlines by name of object, and start of the tool over the handle's, m."""
        (left, right), _ = VIEW
        outlines = {str(self.name): [[[left, 0.0], [right, 0.0]]]} if self.name else {}
        return {"view": VIEW, "outlines": outlines, "offset": [0.0, 0.0]}

    def _look(self) -> None:
        for name, inbox in self._inboxes.items():
            for _, vector in inbox.take_vectors():
                self._places[name] = vector

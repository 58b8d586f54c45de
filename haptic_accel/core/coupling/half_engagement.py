# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The decision when the arm of one host is coupled to that of its peer on another.

It has no clock: times are the caller's, in s from any origin and never backwards.
"""

from __future__ import annotations

import math

from haptic_accel.core.actuator.safety import MANUAL
from haptic_accel.core.coupling.engagement import (
    STOPPED,
    Decision,
    Engagement,
    EngagementParameters,
)
from haptic_accel.core.network.packet import Packet

STOPPED_THERE = f"{STOPPED} at the peer"
"""Reason for a free arm while the peer is stopped and this host is not, or no more."""

SILENT = "waiting for the peer's packets"
"""Reason for a free arm while no packet comes."""

RESTARTED = "the peer has started again"
"""Reason for the release of an arm whose peer is another run than before."""

LEFT = "the peer let go"
"""Reason for the release of an arm whose peer is not engaged any more."""

LOST = "the peer was lost: coupler/engage takes the arm again"
"""Reason for a free arm where it must be asked for after that."""


class HalfEngagement(Engagement):
    """State machine of one arm that is coupled to a peer's: free or engaged.

    An arm is ready when its own conditions hold, and engages when the peer is ready or engaged. It
    is released when the peer falls silent, starts again, or is no longer what it was engaged with;
    and taken again only after the peer has let go as well, so that both begin anew. A stop that
    begins at the peer stops this host, which is released by itself; while the peer is stopped the
    arm stays free.

    Parameters
    ----------
    parameters : EngagementParameters
    now : float
        Time of the start, s.
    arm : str
        Arm of this host.

    Attributes
    ----------
    count : int
        Number of times that the arm engaged.
    unusable : str
        Why packets that come are of no use; empty if none come. To be kept up to date.
    """

    def __init__(self, parameters: EngagementParameters, now: float, arm: str) -> None:
        super().__init__(parameters, now, (arm,))
        self.count = 0
        self.unusable = ""
        self._peer: Packet | None = None
        self._heard = -math.inf
        self._session = 0
        self._partner: tuple[int, int] | None = None  # the peer's session and engagement
        self._former: tuple[int, int] | None = None

    def peer_heard(self, packet: Packet, now: float) -> None:
        """Take the state of the peer from its newest packet, which answers this host's."""
        before, self._peer, self._heard = self._peer, packet, now
        known = before is not None and before.session == packet.session
        # A number that falls is wrong: rather one stop too many than one that is not seen.
        if packet.stops != before.stops if before and known else packet.stopped:
            self.stop.follow()
        if self.engaged and self._partner is None and packet.engaged:
            self._partner = packet.session, packet.engagement

    def ready(self, now: float, listeners: int) -> bool:
        """Return whether nothing is missing on this host, which receives the peer's packets.

        Arguments are as for `missing`.
        """
        return not (super().missing(now, listeners) or self._lost(now))

    def missing(self, now: float, listeners: int) -> str:
        """Return what engaging waits for, or what has gone; empty when all is there."""
        return super().missing(now, listeners) or self._missing_there(now)

    def step(self, now: float, listeners: int) -> Decision:
        """Return what is to be done now; arguments as for `missing`."""
        lost = self._lost(now)
        decision = super().step(now, listeners)
        if decision.engage and self._peer:
            self.count += 1
            self._session = self._peer.session
            engaged = self._peer.engaged
            self._partner = (self._peer.session, self._peer.engagement) if engaged else None
        if decision.release:
            self._former = self._partner
            if lost and self._parameters.recovery == MANUAL:
                self._freed = LOST
        return decision

    def due(self, now: float) -> bool:
        """Return whether it is time for the next `step`: at once where the peer was lost."""
        if super().due(now):
            return True
        return self.engaged and (self.stop.stopped or bool(self._missing_there(now)))

    def _lost(self, now: float) -> str:
        """Return how the peer was lost; empty if it was not."""
        if self._peer is None or now - self._heard > self._parameters.timeout:
            return self.unusable or SILENT
        return RESTARTED if self.engaged and self._peer.session != self._session else ""

    def _missing_there(self, now: float) -> str:
        """Return what is missing at the peer."""
        lost, peer = self._lost(now), self._peer
        if lost or peer is None:
            return lost
        if peer.stopped:
            return STOPPED_THERE
        partner = (peer.session, peer.engagement)
        if self.engaged:
            there = peer.engaged and self._partner == partner
            return "" if there or (self._partner is None and peer.ready) else LEFT
        if peer.engaged and partner == self._former:
            return "waiting for the peer to let go"
        return "" if peer.ready or peer.engaged else "waiting for the peer to be ready"

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

"""Engagement of one host's arm with its peer's arm on another host.

The state machine has no clock: the caller passes times in s, which never decrease.
"""

from __future__ import annotations

import math
from dataclasses import replace

from haptic_accel.core.actuator.safety import MANUAL
from haptic_accel.core.coupling import engagement
from haptic_accel.core.network.packet import Packet

STOPPED_THERE = f"{engagement.STOPPED} at the peer"
"""Reason for a free arm while the peer is stopped and this host is not."""

SILENT = "waiting for the peer's packets"
"""Reason for a free arm while no packets arrive."""

RESTARTED = "the peer has restarted"
"""Reason for a release after the peer has restarted."""

LEFT = "the peer disengaged"
"""Reason for a release after the peer has disengaged."""

DIFFERENT = "the peer engaged at other reference positions"
"""Reason for a release after one host resumed the engagement and the other did not."""

RESUME_TIME = 2.0
"""Time after a loss of packets in which an engagement may be resumed, s. It includes `FREE_TIME`;
nobody expects an arm to return after a longer pause."""

LOST = "the peer was lost: engage again by coupler/engage"
"""Reason for a free arm that engages again only on request after the loss of the peer."""


class HalfEngagement(engagement.Engagement):
    """State machine of one arm that is coupled to a peer's arm: free or engaged.

    An arm is ready when its own conditions hold. It engages when the peer is ready or engaged. It
    is released when the peer sends no packets, restarts, or has another session or engagement. It
    engages again only after the peer has released its arm too, so that both start from the same
    state. After a short loss of packets both resume the engagement: they keep their reference
    positions, if both can. A stop that begins at the peer also stops this host, until released
    here. While the peer is stopped, the arm stays free.

    Parameters
    ----------
    parameters : EngagementParameters
    now : float
        Start time, s.
    arm : str
        Arm of this host.

    Attributes
    ----------
    count : int
        Number of engagements of the arm.
    resumes : bool
        The arm keeps its reference position: in this engagement, or if free, in the next one.
    unusable : str
        Reason why received packets are unusable; empty if none are received. Set by the caller.
    """

    def __init__(self, parameters: engagement.EngagementParameters, now: float, arm: str) -> None:
        super().__init__(parameters, now, (arm,))
        self.count = 0
        self.resumes = False
        self.unusable = ""
        self._peer: Packet | None = None
        self._heard = -math.inf
        self._session = 0
        self._partner: tuple[int, int] | None = None  # session and engagement of the peer
        self._former: tuple[int, int] | None = None
        self._resume_until = -math.inf

    def peer_heard(self, packet: Packet, now: float) -> None:
        """Handle the state in the peer's newest packet, which answers this host's session."""
        before, self._peer, self._heard = self._peer, packet, now
        known = before is not None and before.session == packet.session
        # A decreasing number is an error: an unnecessary stop is better than a missed one.
        if packet.stops != before.stops if before and known else packet.stopped:
            self.stop.follow()
        if self.engaged and self._partner is None and packet.engaged:
            self._partner = packet.session, packet.engagement

    def ready(self, now: float, listeners: int) -> bool:
        """Return whether this host, which receives the peer's packets, is ready to engage.

        Arguments as for `missing`.
        """
        return not (super().missing(now, listeners) or self._lost(now))

    def missing(self, now: float, listeners: int) -> str:
        """Return the reason that prevents engagement, or ends it; empty if there is none."""
        return super().missing(now, listeners) or self._missing_there(now)

    def decide(self, now: float, listeners: int) -> engagement.Decision:
        """Return the actions that are due; arguments as for `missing`."""
        lost = self._lost(now)
        by_network = not super().missing(now, listeners) and self._resumable_after(now)
        decision = super().decide(now, listeners)
        if not self.engaged or decision.engage:
            known = self._peer is not None and self._peer.session == self._session
            self.resumes = known and now <= self._resume_until
        if decision.engage and self._peer:
            self.resumes = self.resumes and self._peer.resumes
            decision = replace(decision, resume=self.resumes)
            self.count += 1
            self._session = self._peer.session
            engaged = self._peer.engaged
            self._partner = (self._peer.session, self._peer.engagement) if engaged else None
        if decision.release:
            self._former = self._partner
            self.resumes = by_network and not self.stop.stopped
            self._resume_until = now + RESUME_TIME if self.resumes else -math.inf
            if lost and self._parameters.recovery == MANUAL:
                self._freed = LOST
        return decision

    def due(self, now: float) -> bool:
        """Return whether `decide` is due; at once after the loss of the peer."""
        if super().due(now):
            return True
        return self.engaged and (self.stop.stopped or bool(self._missing_there(now)))

    def _lost(self, now: float) -> str:
        """Return the reason for the loss of the peer; empty if not lost."""
        if self._peer is None or now - self._heard > self._parameters.timeout:
            return self.unusable or SILENT
        return RESTARTED if self.engaged and self._peer.session != self._session else ""

    def _resumable_after(self, now: float) -> bool:
        """Return whether the reason at the peer is a loss of packets after both were engaged."""
        missing = self._missing_there(now)
        return (
            self._parameters.recovery != MANUAL
            and (self._partner is not None or self.resumes)
            and bool(missing)
            and missing not in (RESTARTED, STOPPED_THERE, DIFFERENT)
        )

    def _missing_there(self, now: float) -> str:
        """Return the reason why the peer is not ready."""
        lost, peer = self._lost(now), self._peer
        if lost or peer is None:
            return lost
        if peer.stopped:
            return STOPPED_THERE
        partner = (peer.session, peer.engagement)
        if self.engaged:
            there = peer.engaged and self._partner == partner
            if there and peer.resumes != self.resumes:
                return DIFFERENT
            return "" if there or (self._partner is None and peer.ready) else LEFT
        if peer.engaged and partner == self._former:
            return "waiting for the peer to disengage"
        return "" if peer.ready or peer.engaged else "waiting for the peer to be ready"

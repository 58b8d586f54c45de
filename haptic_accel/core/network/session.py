# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Admission of a peer's packets: of one peer at a time, each once and in order.

It has no clock: times are the caller's, in s from any origin and never backwards.
"""

from __future__ import annotations

import math

from haptic_accel.core.network.packet import Packet

LIFETIME = 0.5
"""Silence after which a peer may be followed by another, s: longer than arms stay coupled without
a word of the peer, and shorter than a process takes to start again."""

PROBLEM_TIME = 2.0
"""Time for which the reason of a refusal is shown, s."""

WINDOW = 256
"""Packets before the newest among which one that comes again is told from one that comes late."""

_MASK = (1 << WINDOW) - 1


class Session:
    """Admits the packets of one peer that are newer than those before.

    A peer that starts again has a new session, which is admitted once the one before has been
    silent for `LIFETIME`. A session that was followed by another never comes back.

    Parameters
    ----------
    side : str
        Own side; the peer's must be the other.

    Attributes
    ----------
    peer : int
        Session of the peer; 0 before its first packet.
    heard : float
        Time of the last packet admitted, s.
    received, lost, doubled, out_of_order, restarts, refused : int
        Packets admitted, missing, that came again, that were overtaken; new sessions after the
        first; packets of others, or malformed.
    """

    def __init__(self, side: str) -> None:
        self._side = side
        self._former: set[int] = set()
        self._newest = 0
        self._seen = 0
        self._problem, self._problem_time = "", -math.inf
        self.peer = 0
        self.heard = -math.inf
        self.received = self.lost = self.doubled = self.out_of_order = 0
        self.restarts = self.refused = 0

    def admits(self, packet: Packet, now: float) -> bool:
        """Count a packet; return whether it may be used."""
        if reason := self._reason(packet, now):
            self.refuse(reason, now)
            return False
        if packet.session != self.peer:
            self._begin(packet)
        elif not self._follows(packet.sequence):
            return False
        self.received += 1
        self.heard = now
        return True

    @property
    def loss(self) -> float:
        """Share of packets that did not come."""
        came = self.received + self.out_of_order
        return self.lost / (came + self.lost) if came else 0.0

    def refuse(self, reason: str, now: float) -> None:
        """Count a packet that is not the peer's, or malformed."""
        self.refused += 1
        self._problem, self._problem_time = reason, now

    def problem(self, now: float) -> str:
        """Return why packets are refused at present, one line; empty if none are."""
        return self._problem if now - self._problem_time < PROBLEM_TIME else ""

    def _reason(self, packet: Packet, now: float) -> str:
        """Return why a packet is none of the peer's; empty if it is."""
        if packet.side == self._side:
            return f"both hosts are side:={packet.side}: one must be the other"
        if packet.session in self._former:
            return "packet of a peer that was followed by another"
        if packet.session != self.peer and now - self.heard < LIFETIME:
            return f"second peer with side:={packet.side}: end one of the two"
        return ""

    def _begin(self, packet: Packet) -> None:
        if self.peer:
            self._former.add(self.peer)
            self.restarts += 1
        self.peer, self._newest, self._seen = packet.session, packet.sequence, 1

    def _follows(self, sequence: int) -> bool:
        """Count a packet of the peer; return whether it is newer than all before."""
        ahead = sequence - self._newest
        if ahead > 0:
            self.lost += ahead - 1
            # The lowest bit is the newest packet; a long silence leaves nothing to remember.
            self._seen = (self._seen << min(ahead, WINDOW) | 1) & _MASK
            self._newest = sequence
            return True
        place = 1 << -ahead if -ahead < WINDOW else 0
        if not place or self._seen & place:
            self.doubled += 1
        else:
            self._seen |= place
            self.out_of_order += 1
            self.lost -= 1
        return False

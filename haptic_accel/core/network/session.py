# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Admission of a peer's packets: of one peer at a time, each once, and only fresh ones.

A packet is fresh if it answers the own session, a random number that is new at every start: one
that was recorded in a session before cannot. One that does not answer says only that somebody is
there, whose session is answered from then on.

It has no clock: times are the caller's, in s from any origin and never backwards.
"""

from __future__ import annotations

import math
import secrets
from enum import Enum, auto

from haptic_accel.core.network.packet import Packet

UNHEARD = "the peer does not receive this host's packets"
"""State in which packets come, but none that answers."""

REFUSED = "the peer's packets are refused"
"""State in which packets come, but none that may be used."""

LIFETIME = 0.5
"""Silence after which a peer may be followed by another, s: longer than arms stay coupled without
a word of the peer, and shorter than a process takes to start again."""

PROBLEM_TIME = 2.0
"""Time for which the reason of a refusal is shown, s."""

WINDOW = 1024
"""Packets before the newest among which one that comes again is told from one that comes late: 1 s
at 1 kHz, beyond which samples are of no use to the playout."""

FASTEST = 2000.0
"""Most packets of a peer in a second: twice as many as its samples make, as each change of its
state sends one, too."""

LARGEST_JUMP = 3.0
"""Time, s, beyond that since the last packet, by whose packets a number may be ahead: more than
any process or network holds packets up. A number far ahead would make all that follow old."""

ANEW = 1.0
"""Time for which packets come but none is admitted, s, after which a new session begins: longer
than a peer needs to be followed by another."""


_NEVER = -math.inf, -math.inf


class Admission(Enum):
    """Use that may be made of a packet."""

    NEWEST = auto()
    OVERTAKEN = auto()
    """Came after a newer one: its samples are still of use, its state is not."""
    HANDSHAKE = auto()
    """Not fresh: its session is to be answered, and nothing else of it may be used."""
    REFUSED = auto()


def random_session() -> int:
    """Return the number of a new session."""
    return secrets.randbits(64) or 1


class Session:
    """Admits the packets of one peer, each once, that answer the own session.

    A peer that starts again has a new session, which is admitted once the one before has been
    silent for `LIFETIME`. A session that was followed by another never comes back. Where packets
    come but none is admitted for `ANEW`, the own session becomes a new one, as after a start.

    Parameters
    ----------
    side : str
        Own side; the peer's must be the other.
    own : int
        Number of the own session, not 0.

    Attributes
    ----------
    own : int
        Session that packets must answer.
    peer : int
        Session of the peer; 0 before its first packet.
    heard, unanswered : float
        Time of the newest packet admitted, and of the last that was not fresh, s.
    received, lost, doubled, out_of_order, restarts, refused, renewals : int
        Packets admitted, missing, that came again or far too late, that were overtaken; new
        sessions of the peer after the first; packets of others, or malformed; new own sessions.
    """

    def __init__(self, side: str, own: int) -> None:
        self._side = side
        self._problem, self._problem_time = "", -math.inf
        self.own = own
        self.heard = self.unanswered = -math.inf
        self.received = self.lost = self.doubled = self.out_of_order = 0
        self.restarts = self.refused = self.renewals = 0
        self._forget()

    @property
    def pair(self) -> tuple[int, int]:
        """Own session and the peer's."""
        return self.own, self.peer

    @property
    def loss(self) -> float:
        """Share of packets that did not come."""
        came = self.received + self.out_of_order
        return self.lost / (came + self.lost) if came else 0.0

    def admits(self, packet: Packet, now: float) -> Admission:
        """Count a packet; return its permitted use."""
        if reason := self._reason(packet, now):
            self.refuse(reason, now)
            if packet.session in self._former:
                self._came_in_vain(now)
            return Admission.REFUSED
        if packet.echo_session != self.own:
            self.unanswered = now
            return Admission.REFUSED if self._lives(now) else Admission.HANDSHAKE
        if packet.session != self.peer:
            self._begin(packet)
        elif not self._follows(packet.sequence, now):
            return self._late(packet.sequence, now)
        self.received += 1
        self.heard = now
        self._vain = _NEVER
        return Admission.NEWEST

    def renew(self) -> None:
        """Begin a new own session; the peer takes it for that of a host that started again."""
        self.own = random_session()
        self.renewals += 1
        self._forget()

    def refuse(self, reason: str, now: float) -> None:
        """Count a packet that is not the peer's, or malformed; the reason is fixed text."""
        self.refused += 1
        self._problem, self._problem_time = reason, now

    def problem(self, now: float) -> str:
        """Return why packets are refused at present, one line; empty if none are."""
        return self._problem if now - self._problem_time < PROBLEM_TIME else ""

    def unusable(self, now: float, timeout: float) -> str:
        """Return why packets that came within a time in s are of no use; empty if none came."""
        if now - self.unanswered <= timeout:
            return UNHEARD
        return REFUSED if now - self._problem_time <= timeout else ""

    def _forget(self) -> None:
        """Forget the peer; no packet that was sent to the former own session is admitted."""
        # First and last of the packets that came in vain since one was admitted.
        self.peer = 0
        self._former: set[int] = set()
        self._newest = self._seen = 0
        self._vain = _NEVER

    def _lives(self, now: float) -> bool:
        return bool(self.peer) and now - self.heard < LIFETIME

    def _reason(self, packet: Packet, now: float) -> str:
        """Return why a packet is none of the peer's; empty if it is."""
        if packet.side == self._side:
            return f"both hosts are side:={packet.side}: one must be the other"
        if packet.session in self._former:
            return "packet of a peer that was followed by another"
        if packet.session != self.peer and self._lives(now):
            return f"second peer with side:={packet.side}: end one of the two"
        return ""

    def _begin(self, packet: Packet) -> None:
        if self.peer:
            self._former.add(self.peer)
            self.restarts += 1
        self.peer, self._newest, self._seen = packet.session, packet.sequence, 1

    def _follows(self, sequence: int, now: float) -> bool:
        """Count a packet of the peer that is newer than all before; return whether it is."""
        ahead = sequence - self._newest
        if not 0 < ahead <= FASTEST * (now - self.heard + LARGEST_JUMP):
            return False
        self.lost += ahead - 1
        # The lowest bit is the newest packet; a long silence leaves nothing to remember.
        self._seen = (self._seen << min(ahead, WINDOW) | 1) & ((1 << WINDOW) - 1)
        self._newest = sequence
        return True

    def _late(self, sequence: int, now: float) -> Admission:
        """Count a packet of the peer that is not newer, or too far ahead."""
        own, behind = self.own, self._newest - sequence
        self._came_in_vain(now)
        if self.own != own:
            return Admission.REFUSED
        place = 1 << behind if 0 <= behind < WINDOW else 0
        if place and not self._seen & place:
            self._seen |= place
            self.out_of_order += 1
            self.lost -= 1
            return Admission.OVERTAKEN
        if behind < 0:
            self.refuse("packet with a number far ahead of the last", now)
        else:
            self.doubled += 1
        return Admission.REFUSED

    def _came_in_vain(self, now: float) -> None:
        """Take note of a packet whose state cannot be used; begin anew if that goes on."""
        if not now - self._vain[1] < LIFETIME:
            self._vain = now, now
        self._vain = self._vain[0], now
        if now - self._vain[0] > ANEW:
            self.renew()

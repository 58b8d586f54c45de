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

"""Session of two hosts: freshness and sequence checks of the peer's packets, restart detection.

A packet is fresh if it echoes the local session, a random number that is new at every start. A
packet recorded in an earlier session is therefore never fresh. A packet without this echo only
announces a peer, whose session is echoed from then on.

The session has no clock: the caller passes times in s from any origin, which never decrease.
"""

from __future__ import annotations

import math
import secrets
from enum import Enum, auto

from haptic_accel.core.network.packet import Packet

UNHEARD = "the peer does not receive this host's packets"
"""Problem: packets arrive, but none echoes the local session."""

REFUSED = "the peer's packets are refused"
"""Problem: packets arrive, but none may be used."""

LIFETIME = 0.5
"""Silence after which another peer is accepted, s. The arms uncouple earlier without packets, and
the restart of a process takes longer."""

PROBLEM_TIME = 2.0
"""Time for which the reason of a rejection is shown, s."""

DUPLICATE_WINDOW = 1024
"""Number of packets before the newest for which duplicates are distinguished from late packets. It
is 1 s at 1 kHz; older samples are of no use to the playout."""

FASTEST = 2000.0
"""Maximum packet rate of a peer, Hz: twice its sampling rate, as each change of its state also
sends a packet."""

LARGEST_JUMP = 3.0
"""Maximum jump of the sequence number, as a time since the last packet, s. No process or network
delays packets that long. A larger number would make all later packets appear old."""

ANEW = 1.0
"""Time without an accepted packet, while packets arrive, after which a new session begins, s. It
is longer than the time until another peer is accepted."""


_NEVER = -math.inf, -math.inf


class Admission(Enum):
    """Permitted use of a packet."""

    NEWEST = auto()
    OVERTAKEN = auto()
    """Overtaken by a newer packet: the samples are used, the state is not."""
    HANDSHAKE = auto()
    """Not fresh: the packet's session is echoed, and its other contents are ignored."""
    REFUSED = auto()


def random_session() -> int:
    """Return a random number for a new session."""
    return secrets.randbits(64) or 1


class Session:
    """Accept each packet of one peer once, if it echoes the local session.

    A restarted peer has a new session, which is accepted after the former was silent for
    `LIFETIME`. A replaced session is never accepted again. If packets arrive but none is accepted
    for `ANEW`, a new local session begins, as after a restart.

    Parameters
    ----------
    side : str
        Local side; the peer must be the other.
    own : int
        Number of the local session, not 0.

    Attributes
    ----------
    own : int
        Local session, which packets must echo.
    peer : int
        Session of the peer; 0 before its first packet.
    last_reception, unanswered : float
        Time of the newest accepted packet, and of the last packet that was not fresh, s.
    received, lost, doubled, out_of_order, restarts, refused, renewals : int
        Numbers of packets: accepted, lost, duplicated or much too late, overtaken; of new sessions
        of the peer after the first; of foreign or malformed packets; of new local sessions.
    """

    def __init__(self, side: str, own: int) -> None:
        self._side = side
        self._problem, self._problem_time = "", -math.inf
        self.own = own
        self.last_reception = self.unanswered = -math.inf
        self.received = self.lost = self.doubled = self.out_of_order = 0
        self.restarts = self.refused = self.renewals = 0
        self._forget()

    @property
    def pair(self) -> tuple[int, int]:
        """Local session and the peer's."""
        return self.own, self.peer

    @property
    def loss(self) -> float:
        """Fraction of packets that were lost."""
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
        self.last_reception = now
        self._vain = _NEVER
        return Admission.NEWEST

    def renew(self) -> None:
        """Begin a new local session; for the peer this looks like a restarted host."""
        self.own = random_session()
        self.renewals += 1
        self._forget()

    def refuse(self, reason: str, now: float) -> None:
        """Count a foreign or malformed packet; the reason is fixed text."""
        self.refused += 1
        self._problem, self._problem_time = reason, now

    def problem(self, now: float) -> str:
        """Return a line on why packets are rejected at present, or an empty string."""
        return self._problem if now - self._problem_time < PROBLEM_TIME else ""

    def unusable(self, now: float, timeout: float) -> str:
        """Return the reason to refuse the latest packets, time in s; empty if none was refused."""
        if now - self.unanswered <= timeout:
            return UNHEARD
        return REFUSED if now - self._problem_time <= timeout else ""

    def _forget(self) -> None:
        """Forget the peer; packets sent to the former local session are no longer accepted."""
        # First and last unusable packets since the last accepted one.
        self.peer = 0
        self._former: set[int] = set()
        self._newest = self._seen = 0
        self._vain = _NEVER

    def _lives(self, now: float) -> bool:
        return bool(self.peer) and now - self.last_reception < LIFETIME

    def _reason(self, packet: Packet, now: float) -> str:
        """Return the evidence against a packet of the peer; empty if it is one."""
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
        """Count a packet with a number above all before; return whether it is acceptable."""
        ahead = sequence - self._newest
        if not 0 < ahead <= FASTEST * (now - self.last_reception + LARGEST_JUMP):
            return False
        self.lost += ahead - 1
        # The lowest bit is the newest packet; a long silence clears all others.
        self._seen = (self._seen << min(ahead, DUPLICATE_WINDOW) | 1) & (
            (1 << DUPLICATE_WINDOW) - 1
        )
        self._newest = sequence
        return True

    def _late(self, sequence: int, now: float) -> Admission:
        """Count a peer's packet that is not newer, or has too large a sequence number."""
        own, behind = self.own, self._newest - sequence
        self._came_in_vain(now)
        if self.own != own:
            return Admission.REFUSED
        bit = 1 << behind if 0 <= behind < DUPLICATE_WINDOW else 0
        if bit and not self._seen & bit:
            self._seen |= bit
            self.out_of_order += 1
            self.lost -= 1
            return Admission.OVERTAKEN
        if behind < 0:
            self.refuse("packet with a number far ahead of the last", now)
        else:
            self.doubled += 1
        return Admission.REFUSED

    def _came_in_vain(self, now: float) -> None:
        """Record a packet with an unusable state; begin a new session if this persists."""
        if not now - self._vain[1] < LIFETIME:
            self._vain = now, now
        self._vain = self._vain[0], now
        if now - self._vain[0] > ANEW:
            self.renew()

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling of one arm with a peer's as a part of the loop: from its samples to its forces.

Datagrams are exchanged with the peer's half, by whatever carries them. At a tick the order is:
`receive`, `play`, `put` for each sample, `look` if the engagement is due, `packet`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from haptic_accel.core.arm_end import ArmEnd
from haptic_accel.core.coupling.engagement import Decision
from haptic_accel.core.coupling.half_engagement import HalfEngagement
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.model import Vector
from haptic_accel.core.network import endpoint
from haptic_accel.core.network.endpoint import State
from haptic_accel.core.network.playout import Played


class HalfCouplingPart:
    """Engages an arm with its peer, computes its forces, and plays the peer's samples.

    Times are as for `Endpoint`.

    Parameters
    ----------
    end : ArmEnd
    engagement : HalfEngagement
        Engagement of the same arm.
    timeout : float
        Silence of the peer after which its packets are of no use, s.

    Attributes
    ----------
    end : ArmEnd
    engagement : HalfEngagement
    """

    def __init__(self, end: ArmEnd, engagement: HalfEngagement, timeout: float) -> None:
        self.end, self.engagement = end, engagement
        self._timeout = timeout
        self._motion: Motion | None = None
        self._ready = False

    def receive(self, datagrams: Iterable[bytes], now: float, system: int) -> None:
        """Take the datagrams that came."""
        for data in datagrams:
            if packet := self.end.incoming(data, now, system):
                self.engagement.peer_heard(packet, now)
        self.engagement.unusable = self.end.endpoint.session.unusable(now, self._timeout)

    def play(self, now: float) -> Played:
        """Return the peer's sample of a tick; playout begins anew after a silence."""
        playout = self.end.endpoint.playout
        if not self.end.endpoint.fresh(now, self._timeout):
            playout.clear()
        return playout.take(now)

    def put_tool(self, stamp: int, acceleration: float) -> None:
        """Take a sample of the tool for the peer, m/s^2, with its stamp in ns."""
        self.end.endpoint.sampled(stamp, acceleration)

    def put(self, motion: Motion, now: float) -> Vector | None:
        """Take a sample of the arm; return the force that it causes, N, None while it is free.

        One that is not finite counts as missing.
        """
        if not math.isfinite(sum(motion.position) + sum(motion.velocity)):
            return None
        self.engagement.position_received(self.engagement.arms[0], now)
        self._motion = motion
        if not self.end.engaged:
            return None
        return self.end.force(motion.position, motion.velocity, now, motion.work)

    def look(self, now: float, listeners: int) -> Decision:
        """Engage or release the arm as things are; arguments as for `Engagement.missing`."""
        decision = self.engagement.step(now, listeners)
        if decision.release:
            self.end.half.disengage()
        if decision.engage and self._motion:
            self.end.engage(self._motion.position)
        self._ready = self.engagement.ready(now, listeners)
        return decision

    def packet(self, now: float, system: int) -> bytes | None:
        """Return the datagram that is due for the peer; None if none is."""
        here = self.engagement
        state = State(self._ready, here.engaged, here.stop.stopped, here.stop.began, here.count)
        motion = endpoint.Motion(*self._motion[:3]) if self._motion else endpoint.Motion()
        return self.end.outgoing(state, motion, now, system)

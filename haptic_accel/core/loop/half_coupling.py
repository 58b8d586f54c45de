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

"""Coupling of one arm with a peer's arm as a part of the loop.

The caller exchanges datagrams with the peer's half. The order in a tick is: `receive`, `begin`,
`put` for each sample, `poll` if the engagement is due, `packet`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator

from haptic_accel.core.arm_endpoint import ArmEndpoint
from haptic_accel.core.coupling.engagement import Decision
from haptic_accel.core.coupling.half_engagement import HalfEngagement
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.loop.wiring import MASTER, ArmCommand, Tool
from haptic_accel.core.model import ZERO
from haptic_accel.core.network import endpoint
from haptic_accel.core.network.endpoint import State
from haptic_accel.core.network.playout import WAITING, Played


class HalfCouplingPart:
    """Engage an arm with its peer, compute its forces, and play the peer's samples.

    Times as for `Endpoint`.

    Parameters
    ----------
    end : ArmEndpoint
    engagement : HalfEngagement
        Engagement of the same arm.
    timeout : float
        Time without packets of the peer after which its last packet is ignored, s.

    Attributes
    ----------
    end : ArmEndpoint
    engagement : HalfEngagement
    offset : int
        System time minus the clock of the stamps, ns.
    played : Played
        Last played sample of the peer's tool.
    """

    def __init__(self, end: ArmEndpoint, engagement: HalfEngagement, timeout: float) -> None:
        self.end, self.engagement = end, engagement
        self.offset = 0
        self.played = Played(ZERO, WAITING)
        self.count_force = ZERO
        self._timeout = timeout
        self._motion: Motion | None = None
        self._commands: deque[ArmCommand] = deque()
        self._tools: deque[Tool] = deque()
        self._ready = False

    def receive(self, datagrams: Iterable[bytes], now: float, system: int) -> None:
        """Process received datagrams."""
        for data in datagrams:
            if packet := self.end.incoming(data, now, system):
                self.engagement.peer_heard(packet, now)
        self.engagement.unusable = self.end.endpoint.session.unusable(now, self._timeout)

    def begin(self, now: float, stamp: int) -> None:
        """At the master, play the peer's sample of a tick; restart the playout after a silence."""
        if self.engagement.arms[0] != MASTER:
            return
        playout = self.end.endpoint.playout
        if not self.end.endpoint.fresh(now, self._timeout):
            playout.clear()
        self.played = playout.play(now)
        if self.played.kind != WAITING:
            self._tools.append(Tool(stamp, self.played.value))

    def put_tool(self, tool: Tool) -> None:
        """Add a sample of the tool for the peer."""
        self.end.endpoint.sampled(tool.stamp + self.offset, tool.acceleration)

    def tools(self) -> Iterator[Tool]:
        """Yield each played sample once."""
        while self._tools:
            yield self._tools.popleft()

    def put(self, arm: str, motion: Motion, now: float) -> None:
        """Add a sample of the arm; a non-finite sample counts as missing."""
        usable = self.engagement.position_received(arm, now, motion)
        if not (usable and math.isfinite(sum(motion.velocity))):
            return
        self._motion = motion
        if self.end.engaged and not self.engagement.interrupted:
            force = self.end.force(motion.position, motion.velocity, now, motion.work)
            self._commands.append(ArmCommand(arm, motion.stamp, force))

    def commands(self) -> Iterator[ArmCommand]:
        """Yield the force of each sample once; none while the arm is free."""
        while self._commands:
            yield self._commands.popleft()

    def poll(self, now: float, listeners: int) -> Decision:
        """Engage or release the arm if this is due; arguments as for `Engagement.missing`."""
        decision = self.engagement.decide(now, listeners)
        if decision.release:
            self._commands.clear()
            self.end.half.disengage()
        if decision.engage and self._motion:
            self.end.engage(self._motion.position, resume=decision.resume)
        self._ready = self.engagement.ready(now, listeners)
        return decision

    def packet(self, now: float, system: int) -> bytes | None:
        """Return the datagram that is due for the peer, or None."""
        here = self.engagement
        stop = here.stop
        state = State(
            self._ready, here.engaged, stop.stopped, here.resumes, stop.began, here.count
        )
        motion = endpoint.Motion()
        if newest := self._motion:
            stamp = newest.stamp + self.offset
            motion = endpoint.Motion(stamp, newest.position, newest.velocity)
        return self.end.outgoing(state, motion, now, system)

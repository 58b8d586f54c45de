# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling of both arms as a part of the loop: from their samples to the forces on both."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from haptic_accel.core.coupling.engagement import Decision, Engagement
from haptic_accel.core.coupling.pairing import Motion, Pairing
from haptic_accel.core.coupling.passive import PassivePair
from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.loop.wiring import Pull, Tool
from haptic_accel.core.topics import ARMS


class CouplingPart:
    """Engages both arms, and computes their forces where the samples of both are there.

    Parameters
    ----------
    coupling : PositionPositionCoupling or PassivePair
    engagement : Engagement
        Engagement of both arms.
    rate : float
        Samples per second of both arms.
    longest : int
        Most samples of an arm that wait for the other's, and of the tool that wait.

    Attributes
    ----------
    engagement : Engagement
    """

    def __init__(
        self,
        coupling: PositionPositionCoupling | PassivePair,
        engagement: Engagement,
        rate: float,
        longest: int = 1,
    ) -> None:
        self._coupling, self.engagement = coupling, engagement
        self._pairing = Pairing(rate, longest)
        self._engaging = False
        self._tools: deque[Tool] = deque(maxlen=longest)

    @property
    def engaged(self) -> bool:
        """The arms are coupled."""
        return self._coupling.engaged

    @property
    def held(self) -> int:
        """Number of ticks at which an earlier sample stood for one that is missing."""
        return self._pairing.held

    @property
    def waiting(self) -> bool:
        """True while a sample of one arm waits for that of the other."""
        return self._pairing.waiting

    def begin(self, now: float, stamp: int) -> None:
        """Begin a tick: nothing is due by itself."""

    def put(self, arm: str, motion: Motion, now: float) -> None:
        """Take a sample of an arm, of `ARMS`, at a time in s."""
        self.engagement.position_received(arm, now)
        self._pairing.put(ARMS.index(arm), motion)

    def put_tool(self, tool: Tool) -> None:
        """Take a sample of the tool, which `tools` returns as it is."""
        self._tools.append(tool)

    def tools(self) -> Iterator[Tool]:
        """Yield the samples of the tool for the compensation, each once."""
        while self._tools:
            yield self._tools.popleft()

    def look(self, now: float, listeners: int) -> Decision:
        """Couple the arms with the next samples of both, or uncouple them, as things are.

        Arguments as for `Engagement.missing`.
        """
        decision = self.engagement.step(now, listeners)
        if decision.release:
            self._engaging = False
            self._coupling.disengage()
        if decision.engage:
            self._engaging = True
        return decision

    def clear(self) -> None:
        """Forget the samples that wait."""
        self._pairing.clear()

    def pulls(self) -> Iterator[Pull]:
        """Yield the forces of each tick of which both samples are there, while engaged."""
        for master, slave in self._pairing.pairs():
            if self._engaging:
                self._engaging = False
                self._coupling.engage(master.position, slave.position)
            if not self._coupling.engaged:
                continue
            motions = master.position, slave.position, master.velocity, slave.velocity
            if isinstance(self._coupling, PassivePair):
                forces = self._coupling.forces(*motions, (master.work, slave.work))
            else:
                forces = self._coupling.forces(*motions)
            # What the sample of one arm causes acts on the other.
            for arm, motion, force in zip(ARMS, (slave, master), forces, strict=True):
                yield Pull(arm, motion.stamp, force)

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The arms of two hosts in lockstep: each half beside its arm, and a simulated network between."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_accel.core.arm_end import ArmEnd
from haptic_accel.core.coupling.engagement import EngagementParameters
from haptic_accel.core.coupling.half_engagement import HalfEngagement
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.loop.half_coupling import HalfCouplingPart
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network.channel import Channel, ChannelParameters
from haptic_accel.core.network.playout import Played
from haptic_accel.core.sampling import LATENCY, NANOSECONDS
from haptic_accel.core.topics import ARMS

BEGIN = 1_800_000_000
"""System time of both hosts at the first sample, s."""

ROUNDING = 1e-9
"""Time by which a packet may be early, s: sums of times are not exact."""


class Crossed(NamedTuple):
    """Results of a sample on both hosts.

    Attributes
    ----------
    on_master, on_slave : tuple of float
        Forces for the arms, N; None for one that is free, and commanded nothing.
    played : Played
        The tool's acceleration at the master, m/s^2.
    position : float
        Time of the sample that is played, in samples since the first; NaN while waiting.
    energy : tuple of float
        Accounts of the master's and the slave's half, J.
    """

    on_master: Vector | None
    on_slave: Vector | None
    played: Played
    position: float = math.nan
    energy: tuple[float, float] = (0.0, 0.0)


class TwoHosts:
    """Coupling of two arms, and the tool's acceleration, over a simulated network.

    The halves are those of the live hosts, and so is the order of what is done at a sample: a
    packet leaves once the sample's force is known, and arrives with the next sample at the
    earliest.

    Parameters
    ----------
    parameters : PassiveParameters
    network : ChannelParameters
        Channels of both directions.
    rate : float
        Samples per second.
    latency : int
        Samples from the one that caused a force to the tick at which the force takes effect.
    seed : int
        Seed of the network.
    blackouts : sequence of (float, float)
        Start and end of each time, s, in which nothing comes through.

    Attributes
    ----------
    halves : list of HalfCouplingPart
        Those of master and slave.
    channels : list of Channel
        From the master, and from the slave.
    """

    def __init__(
        self,
        parameters: PassiveParameters,
        network: ChannelParameters,
        rate: float,
        latency: int = LATENCY,
        seed: int = 0,
        blackouts: Sequence[tuple[float, float]] = (),
    ) -> None:
        self._first = round(BEGIN * rate)
        self._made = parameters, rate, latency
        self._sessions = itertools.count(1)
        self.halves = [self._half(side, 0.0) for side in ARMS]
        self.channels = [
            Channel[bytes](network, number, blackouts)
            for number in np.random.SeedSequence(seed).generate_state(2).tolist()
        ]

    def restart(self, index: int, now: float) -> None:
        """Start the half of an arm again, 0 for the master's and 1 for the slave's, at a time."""
        self.halves[index] = self._half(ARMS[index], now)

    def sample(
        self, time: float, handle: Motion, tool: Motion, acceleration: float = 0.0
    ) -> Crossed:
        """Take a sample of both arms at a time in s, and the tool's acceleration, m/s^2."""
        system = BEGIN * NANOSECONDS + round(time * NANOSECONDS)
        for half, channel in zip(self.halves, reversed(self.channels), strict=True):
            half.receive(channel.arrived(time + ROUNDING), time, system)
        master, slave = self.halves
        played = master.play(time)
        slave.put_tool(system, acceleration)
        on_master = self._force(master, handle, time, system)
        on_slave = self._force(slave, tool, time, system)
        for half, channel in zip(self.halves, self.channels, strict=True):
            if packet := half.packet(time, system):
                channel.send(packet, time)
        position = master.end.endpoint.playout.position - self._first
        energy = master.end.half.energy, slave.end.half.energy
        return Crossed(on_master, on_slave, played, position, energy)

    def _half(self, side: str, now: float) -> HalfCouplingPart:
        parameters, rate, latency = self._made
        conditions = EngagementParameters()
        end = ArmEnd(side, parameters, rate, latency, next(self._sessions))
        return HalfCouplingPart(end, HalfEngagement(conditions, now, side), conditions.timeout)

    def _force(
        self, half: HalfCouplingPart, arm: Motion, now: float, system: int
    ) -> Vector | None:
        """Return the force that a sample of an arm causes, whose device stops with its coupler."""
        engagement = half.engagement
        engagement.arm_stopped(engagement.arms[0], engagement.stop.stopped)
        force = half.put(arm._replace(stamp=system), now)
        released = engagement.due(now) and half.look(now, listeners=1).release
        return ZERO if released else force

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The arms of two hosts in lockstep: each half beside its arm, and a simulated network between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_accel.core.arm_end import ArmEnd
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.model import ZERO, Sample, Vector
from haptic_accel.core.network.channel import Channel, ChannelParameters
from haptic_accel.core.network.endpoint import Motion, State
from haptic_accel.core.network.playout import Played
from haptic_accel.core.sampling import LATENCY, NANOSECONDS, RELEASED
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
        Forces for the arms, N.
    played : Played
        The tool's acceleration at the master, m/s^2.
    position : float
        Time of the sample that is played, in samples since the first; NaN while waiting.
    energy : tuple of float
        Accounts of the master's and the slave's half, J.
    """

    on_master: Vector
    on_slave: Vector
    played: Played
    position: float = math.nan
    energy: tuple[float, float] = (0.0, 0.0)


class Host:
    """One host: an arm's end of the coupling.

    It engages as soon as packets come and are answered, and lets go once they fail for
    `RELEASED`, or the peer has let go.
    """

    def __init__(
        self, side: str, parameters: PassiveParameters, rate: float, latency: int
    ) -> None:
        session = 1 + ARMS.index(side)
        self.end = ArmEnd(side, parameters, rate, latency, session)
        self._engagement = 0
        self._with_peer = False

    def say(self, arm: Sample, now: float, system: int) -> bytes | None:
        """Return the packet that is due."""
        state = State(ready=True, engaged=self.end.engaged, engagement=self._engagement)
        return self.end.outgoing(state, Motion(system, arm.position, arm.velocity), now, system)

    def hear(self, packets: Sequence[bytes], now: float, system: int) -> None:
        """Take the packets that have arrived."""
        for data in packets:
            self.end.incoming(data, now, system)

    def force(self, arm: Sample, now: float) -> Vector:
        """Return the force for the arm, N."""
        end, endpoint = self.end, self.end.endpoint
        peer, age = endpoint.peer, endpoint.round_trip_age(now)
        answered = peer is not None and endpoint.fresh(now, RELEASED) and age < math.inf
        if end.engaged and not (answered and peer and peer.engaged >= self._with_peer):
            end.half.disengage()
        elif answered and not end.engaged:
            end.engage(arm.position)
            self._with_peer = False
            self._engagement += 1
        if not (end.engaged and peer):
            return ZERO
        self._with_peer |= peer.engaged
        return end.force(arm.position, arm.velocity, now)


class TwoHosts:
    """Coupling of two arms, and the tool's acceleration, over a simulated network.

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
        self.hosts = [Host(side, parameters, rate, latency) for side in ARMS]
        self.channels = [
            Channel[bytes](network, number, blackouts)
            for number in np.random.SeedSequence(seed).generate_state(2).tolist()
        ]

    def sample(self, time: float, handle: Sample, tool: Sample) -> Crossed:
        """Take a sample of both arms at a time in s."""
        system = BEGIN * NANOSECONDS + round(time * NANOSECONDS)
        master, slave = self.hosts
        slave.end.endpoint.sampled(system, tool.acceleration)
        arms = handle, tool
        for host, arm, channel in zip(self.hosts, arms, self.channels, strict=True):
            if packet := host.say(arm, time, system):
                channel.send(packet, time)
        for host, channel in zip(self.hosts, reversed(self.channels), strict=True):
            host.hear(channel.arrived(time + ROUNDING), time, system)
        playout = master.end.endpoint.playout
        played = playout.take(time)
        return Crossed(
            master.force(handle, time),
            slave.force(tool, time),
            played,
            playout.position - self._first,
            (master.end.half.energy, slave.end.half.energy),
        )

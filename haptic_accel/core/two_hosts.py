"""The arms of two hosts in lockstep: each half beside its arm, and a simulated network between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from haptic_accel.core.coupling.passive import PassiveHalf, PassiveParameters
from haptic_accel.core.model import ZERO, Sample, Vector
from haptic_accel.core.network.channel import Channel, ChannelParameters
from haptic_accel.core.network.endpoint import Endpoint, Motion, State
from haptic_accel.core.network.playout import Played
from haptic_accel.core.sampling import LATENCY, NANOSECONDS, RELEASED

BEGIN = 1_800_000_000
"""System time of both hosts at the first sample, s."""

ROUNDING = 1e-9
"""Time by which a packet may be early, s: sums of times are not exact."""


class Crossed(NamedTuple):
    """What both hosts do in a sample.

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
    """One host: an arm's half of the coupling, and its end of the network.

    It engages as soon as packets come and are answered, and lets go once they fail for
    `RELEASED`, or the peer has let go.
    """

    def __init__(
        self, side: str, parameters: PassiveParameters, rate: float, latency: int
    ) -> None:
        self._scale = parameters.scale if side == "slave" else 1.0
        own = replace(parameters, max_force=min(parameters.max_force / self._scale, 100.0))
        self.half = PassiveHalf(own, rate, latency, leads=side == "slave")
        self._session = 1 + (side == "slave")
        self.end = Endpoint(side, rate, self._session)
        self._origin = ZERO
        self._engagement = 0
        self._motion = Motion()
        self._with_peer = False

    def say(self, arm: Sample, now: float, system: int) -> bytes | None:
        """Return the packet that is due, in the master's scale."""
        place = self._relative(arm.position) if self.half.engaged else ZERO
        self._motion = Motion(system, place, self._scaled(arm.velocity))
        state = State(ready=True, engaged=self.half.engaged, engagement=self._engagement)
        return self.end.outgoing(state, self._motion, self.half.shipped, now, system)

    def hear(self, packets: Sequence[bytes], now: float, system: int) -> None:
        """Take the packets that have arrived."""
        for data in packets:
            packet = self.end.incoming(data, now, system)
            if packet and packet.echo_session == self._session:
                self.half.receive(packet.shipped)

    def force(self, arm: Sample, now: float) -> Vector:
        """Return the force for the arm, N."""
        peer, age = self.end.peer, self.end.round_trip_age(now)
        answered = peer is not None and self.end.fresh(now, RELEASED) and age < math.inf
        if self.half.engaged and not (answered and peer and peer.engaged >= self._with_peer):
            self.half.disengage()
        elif answered and not self.half.engaged:
            self.half.engage()
            self._origin, self._with_peer = arm.position, False
            self._engagement += 1
        if not (self.half.engaged and peer):
            return ZERO
        self._with_peer |= peer.engaged
        place, speed = self._relative(arm.position), self._scaled(arm.velocity)
        x, y, z = self.half.force(place, speed, peer.position, peer.velocity, age)
        return x * self._scale, y * self._scale, z * self._scale

    def _relative(self, position: Vector) -> Vector:
        x, y, z = (p - o for p, o in zip(position, self._origin, strict=True))
        return self._scaled((x, y, z))

    def _scaled(self, vector: Vector) -> Vector:
        x, y, z = vector
        return x / self._scale, y / self._scale, z / self._scale


class TwoHosts:
    """Coupling of two arms, and the tool's acceleration, over a simulated network.

    Parameters
    ----------
    parameters : PassiveParameters
    network : ChannelParameters
        Of both directions.
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
        self.hosts = [Host(side, parameters, rate, latency) for side in ("master", "slave")]
        self.channels = [
            Channel[bytes](network, number, blackouts)
            for number in np.random.SeedSequence(seed).generate_state(2).tolist()
        ]

    def sample(self, time: float, handle: Sample, tool: Sample) -> Crossed:
        """Take a sample of both arms at a time in s."""
        system = BEGIN * NANOSECONDS + round(time * NANOSECONDS)
        master, slave = self.hosts
        slave.end.sampled(system, tool.acceleration)
        arms = handle, tool
        for host, arm, channel in zip(self.hosts, arms, self.channels, strict=True):
            if packet := host.say(arm, time, system):
                channel.send(packet, time)
        for host, channel in zip(self.hosts, reversed(self.channels), strict=True):
            host.hear(channel.arrived(time + ROUNDING), time, system)
        playout = master.end.playout
        played = playout.take(time)
        return Crossed(
            master.force(handle, time),
            slave.force(tool, time),
            played,
            playout.position - self._first,
            (master.half.energy, slave.half.energy),
        )

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two arms, each with its half of the coupling, over an arbitrary network.

Neither engagement nor sessions protect the control law: arms engage again at once, at any
position.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from two_arms import HAND_DAMPING, RATE, Around, Hand, Path, PointMass

from haptic_accel.core.actuator import ArmLimits, SafetyParameters
from haptic_accel.core.coupling.passive import PassiveHalf, PassiveParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network import Channel
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.simulated_rig import rig_side
from haptic_accel.core.tick import ARM

PACKETS = 2
"""Samples from packet to packet."""

UNLIMITED = 100.0
"""Peak force that no control law reaches, N."""


@dataclass(frozen=True)
class Packet:
    """Message to the peer half; `echoed` is the newest received packet's sending time, s."""

    sequence: int
    session: int
    heard: int
    sent: float
    echoed: float
    position: Vector
    velocity: Vector
    shipped: float


@dataclass
class Side:
    """Arm, its half of the coupling, and the packets from the peer."""

    outside: Around
    parameters: PassiveParameters
    channel: Channel[Packet]
    latency: int = 1
    leads: bool = False
    reports_work: bool = False
    stopped: bool = False
    speed_noise: float = 0.0
    age_factor: float = 1.0
    session: int = 0
    sequence: itertools.count[int] = field(default_factory=itertools.count)
    newest: Packet | None = None
    left: set[int] = field(default_factory=set)
    noise: random.Random = field(default_factory=lambda: random.Random(0))

    def __post_init__(self) -> None:
        """Start the half's process."""
        self.limit(UNLIMITED)
        self.start()

    def limit(self, force: float) -> None:
        """Let the device limit its force, N, from rest on."""
        safety = SafetyParameters(arm=ArmLimits(peak_force=force))
        self.device = rig_side(PointMass(self.outside), safety, RATE, self.latency, [ARM])
        self.read(0)

    def start(self) -> None:
        """Start the half's process, again if it runs."""
        self.session += 1
        self.half = PassiveHalf(self.parameters, RATE, self.latency, leads=self.leads)
        self.newest, self.left = None, set()
        self.origin = self.arm.position

    def hear(self, packet: Packet) -> None:
        """Accept a peer's packet unless a newer one came."""
        if packet.session in self.left:
            return
        if self.newest is None or packet.session != self.newest.session:
            if self.newest is not None:
                self.left.add(self.newest.session)
            self.half.new_session()
        elif packet.sequence <= self.newest.sequence:
            return
        self.newest = packet
        if packet.heard == self.session:
            self.half.receive(packet.shipped)

    def packet(self, now: float) -> Packet:
        """Return a packet to the peer."""
        newest = self.newest
        return Packet(
            next(self.sequence),
            self.session,
            newest.session if newest else 0,
            now,
            newest.sent if newest else -math.inf,
            self.own_position,
            self.arm.velocity,
            self.half.shipped,
        )

    @property
    def own_position(self) -> Vector:
        """Position relative to where the arm engaged, m."""
        x, y, z = (p - o for p, o in zip(self.arm.position, self.origin, strict=True))
        return x, y, z

    def read(self, tick: int) -> None:
        """Read the arm's sample of a tick, and its motors' work so far, J."""
        self.device.begin(tick)
        self.device.read()
        (sample,) = self.device.samples
        self.arm, self.work = sample.sample, sum(sample.work)

    def push(self, tick: int, force: Vector) -> None:
        """Command the force caused by a tick's sample; a stopped device applies zero."""
        stamp = round(tick * NANOSECONDS / RATE)
        self.device.command(ARM, stamp, *(ZERO if self.stopped else force))
        self.device.apply()
        self.device.watch()

    def force(self, now: float) -> Vector:
        """Return the force caused by the present sample, N."""
        newest = self.newest
        if newest is None or newest.heard != self.session:
            self.half.disengage()
            return ZERO
        if not self.half.engaged:
            self.half.engage()
        work = self.work if self.reports_work else None
        age = (now - newest.echoed) * self.age_factor
        motion = self.own_position, self.measured_velocity
        return self.half.force(*motion, newest.position, newest.velocity, age, work)

    @property
    def measured_velocity(self) -> Vector:
        """Velocity with the noise of its measurement, m/s."""
        x, y, z = (v + self.noise.uniform(-1, 1) * self.speed_noise for v in self.arm.velocity)
        return x, y, z


@dataclass(frozen=True)
class Instant:
    """Energy given to both arms until a sample, J, and the sample's forces, N."""

    given: float
    forces: tuple[Vector, Vector]


Event = Callable[[float, Side, Side], None]
"""Events at master and slave by time, s."""


def nothing(_: float, __: Side, ___: Side) -> None:
    """Let nothing happen."""


def run(
    parameters: PassiveParameters,
    networks: tuple[Channel[Packet], Channel[Packet]],
    path: Path,
    around_slave: Around,
    duration: float,
    event: Event = nothing,
    latency: int = 1,
    hand_damping: float = HAND_DAMPING,
) -> Iterator[Instant]:
    """Yield the `Instant` of each sample.

    Parameters
    ----------
    networks : tuple of Channel
        Channels from master and slave.
    """
    hand = Hand(path, damping=hand_damping)
    surroundings: tuple[Around, Around] = (hand, around_slave)
    master, slave = (
        Side(outside, parameters, channel, latency, leads)
        for outside, channel, leads in zip(surroundings, networks, (False, True), strict=True)
    )
    for tick in range(round(duration * RATE)):
        now = tick / RATE
        for side in (master, slave):
            side.read(tick)
        hand.lead(now)
        event(now, master, slave)
        for side, other in ((master, slave), (slave, master)):
            for packet in other.channel.arrived(now):
                side.hear(packet)
        forces = master.force(now), slave.force(now)
        for side, force in zip((master, slave), forces, strict=True):
            if tick % PACKETS == 0:
                side.channel.send(side.packet(now), now)
            side.push(tick, force)
        yield Instant(master.work + slave.work, forces)

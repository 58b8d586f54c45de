# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two arms, each with its half of the coupling, over a network that may do anything."""

from __future__ import annotations

import itertools
import math
import random
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from haptic_accel.core.coupling.passive import PassiveHalf, PassiveParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network.channel import Channel
from haptic_accel.core.two_arms import HAND_DAMPING, RATE, Arm, Around, Hand, Path

PACKETS = 2
"""Samples from packet to packet."""


@dataclass(frozen=True)
class Packet:
    """Message of a half to its peer; `echoed` is when the newest packet it had was sent, s."""

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
    """An arm, its half of the coupling, and what it has heard of its peer."""

    arm: Arm
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
        self.start()

    def start(self) -> None:
        """Start the half's process, again if it runs."""
        self.session += 1
        self.half = PassiveHalf(self.parameters, RATE, self.latency, leads=self.leads)
        self.newest, self.left = None, set()
        self.origin = self.arm.position
        self.due = deque([ZERO] * self.latency)

    def hear(self, packet: Packet) -> None:
        """Take a packet of the peer unless a newer one is there."""
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
        """Return what to tell the peer."""
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

    def force(self, now: float) -> Vector:
        """Return the force that acts from now on, N."""
        newest = self.newest
        if newest is None or newest.heard != self.session:
            self.let_go()
            return ZERO
        if not self.half.engaged:
            self.half.engage()
        work = self.arm.work if self.reports_work else None
        age = (now - newest.echoed) * self.age_factor
        velocity = self.measured_velocity
        self.due.append(
            self.half.force(
                self.own_position, velocity, newest.position, newest.velocity, age, work
            )
        )
        due = self.due.popleft()
        return ZERO if self.stopped else due

    def let_go(self) -> None:
        """Take the force off."""
        self.half.disengage()
        self.due = deque([ZERO] * self.latency)

    @property
    def measured_velocity(self) -> Vector:
        """Velocity with the noise of its measurement, m/s."""
        x, y, z = (v + self.noise.uniform(-1, 1) * self.speed_noise for v in self.arm.velocity)
        return x, y, z


@dataclass(frozen=True)
class Instant:
    """State of both arms at a sample; energy given to both, J, and their commanded forces, N."""

    time: float
    master: Vector
    slave: Vector
    slave_speed: float
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
    """Yield both arms' motion sample by sample.

    Parameters
    ----------
    networks : tuple of Channel
        From the master and from the slave.
    """
    hand = Hand(path, damping=hand_damping)
    surroundings: tuple[Around, Around] = (hand, around_slave)
    master, slave = (
        Side(Arm(outside), parameters, channel, latency, leads)
        for outside, channel, leads in zip(surroundings, networks, (False, True), strict=True)
    )
    for tick in range(round(duration * RATE)):
        now = tick / RATE
        hand.lead(now)
        event(now, master, slave)
        for side, other in ((master, slave), (slave, master)):
            for packet in other.channel.arrived(now):
                side.hear(packet)
        forces = master.force(now), slave.force(now)
        for side, force in zip((master, slave), forces, strict=True):
            if tick % PACKETS == 0:
                side.channel.send(side.packet(now), now)
            side.arm.move(force)
        speed = math.hypot(*slave.arm.velocity)
        given = master.arm.work + slave.arm.work
        yield Instant(now, master.own_position, slave.own_position, speed, given, forces)

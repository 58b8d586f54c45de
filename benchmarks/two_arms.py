"""Measure the coupling of two arms over a network: two point masses, a hand and a wall.

Each row of the table is one law on one network: net energy given to the arms, speed of the slave
on the wall with the hand at rest, and error in free space.
"""

from __future__ import annotations

import itertools
import math
import random
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from haptic_accel.core.coupling.passive import PassiveHalf, PassiveParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network.channel import Channel, ChannelParameters

RATE = 1000.0
"""Samples per second of both halves."""

STEPS = 5
"""Steps of integration in a sample."""

CHANGE_TIME = 2.0
"""Time at which a network becomes another, s."""

PACKETS = 2
"""Samples from packet to packet."""

HAND_DAMPING = 3.0
"""Damping of a hand that holds an arm, N s/m: 0.4 of critical on the arm's mass."""

Around = Callable[[Vector, Vector], Vector]
"""Force, N, of what is around an arm, from its position, m, and velocity, m/s."""

Path = Callable[[float], Vector]
"""Place of the hand, m, over time, s."""


@dataclass
class Arm:
    """A point mass that a motor, and whatever is around it, push; it has no friction.

    Attributes
    ----------
    outside : callable
        Force of hand or wall.
    limit : float
        Largest force of each motor, N.
    """

    outside: Around
    mass: float = 0.1
    limit: float = math.inf
    position: Vector = ZERO
    velocity: Vector = ZERO
    work: float = 0.0

    def move(self, force: Vector) -> None:
        """Let a motor force act for a sample."""
        before, step = self.position, 1.0 / RATE / STEPS
        fx, fy, fz = (max(-self.limit, min(self.limit, f)) for f in force)
        for _ in range(STEPS):
            x, y, z = self.position
            vx, vy, vz = self.velocity
            ox, oy, oz = self.outside(self.position, self.velocity)
            vx += step * (fx + ox) / self.mass
            vy += step * (fy + oy) / self.mass
            vz += step * (fz + oz) / self.mass
            self.velocity = vx, vy, vz
            self.position = x + step * vx, y + step * vy, z + step * vz
        moved = (now - then for now, then in zip(self.position, before, strict=True))
        self.work += sum(f * d for f, d in zip((fx, fy, fz), moved, strict=True))


class Hand:
    """A hand that leads an arm along a path."""

    def __init__(
        self, path: Path, stiffness: float = 150.0, damping: float = HAND_DAMPING
    ) -> None:
        self._path, self._stiffness, self._damping = path, stiffness, damping
        self.place = path(0.0)

    def lead(self, time: float) -> None:
        """Go on to the place of a time, s."""
        self.place = self._path(time)

    def __call__(self, position: Vector, velocity: Vector) -> Vector:
        """Return its force on the arm, N."""
        x, y, z = (
            self._stiffness * (p - q) - self._damping * v
            for p, q, v in zip(self.place, position, velocity, strict=True)
        )
        return x, y, z


def wall(stiffness: float = 3000.0, depth: float = -0.005) -> Around:
    """Return the force of an elastic wall below a depth, m, without damping."""

    def push(position: Vector, _: Vector) -> Vector:
        return 0.0, 0.0, stiffness * max(0.0, depth - position[2])

    return push


def free(_: Vector, __: Vector) -> Vector:
    """Return no force: nothing is around the arm."""
    return ZERO


@dataclass(frozen=True)
class Packet:
    """What a half tells its peer; `echoed` is when the newest packet it had was sent, s."""

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
"""What happens to master and slave at a time, s."""


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


def press(time: float) -> Vector:
    """Place of a hand that presses 10 mm below where it began, then rests."""
    return 0.0, 0.0, -0.01 * min(1.0, time / 0.3)


def stroke(time: float, speed: float = 0.1, length: float = 0.08, turn: float = 0.15) -> Vector:
    """Place of a hand that strokes to and fro along x, m; it turns smoothly."""
    half = length / speed + turn * (1 - 2 / math.pi)
    passed, within = divmod(time, half)
    cruise = half - turn
    if within < turn / 2:
        place = (turn / math.pi) * speed * (1 - math.cos(math.pi * within / turn))
    elif within < turn / 2 + cruise:
        place = speed * (turn / math.pi + within - turn / 2)
    else:
        rest = half - within
        place = length - (turn / math.pi) * speed * (1 - math.cos(math.pi * rest / turn))
    return (place if passed % 2 == 0 else length - place), 0.0, 0.0


@dataclass(frozen=True)
class Row:
    """A law on a network, and what it reached."""

    law: str
    network: ChannelParameters
    before: ChannelParameters | None
    given: float
    end_speed: float
    error: float


def row(
    parameters: PassiveParameters,
    network: ChannelParameters,
    before: ChannelParameters | None = None,
    seed: int = 0,
) -> Row:
    """Return what a law reaches on a network; `before` is the one at first."""

    def change(time: float, *sides: Side) -> None:
        if time >= CHANGE_TIME:
            for side in sides:
                side.channel.parameters = network

    def instants(path: Path, around: Around) -> list[Instant]:
        first = before or network
        channels = Channel[Packet](first, seed), Channel[Packet](first, seed + 1)
        return list(run(parameters, channels, path, around, 6.0, change))

    contact, moved = instants(press, wall()), instants(stroke, free)
    errors = [math.dist(i.master, i.slave) ** 2 for i in moved[3000:]]
    return Row(
        parameters.law,
        network,
        before,
        max(i.given for i in contact + moved),
        max(i.slave_speed for i in contact[-500:]),
        math.sqrt(sum(errors) / len(errors)),
    )

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two point masses, a hand and a wall: the least that shows whether a coupling is stable."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from haptic_accel.core.model import ZERO, Sample, Vector
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.two_hosts import TwoHosts

RATE = 1000.0
"""Samples per second of both halves."""

STEPS = 5
"""Steps of integration in a sample."""

ENGAGING = 1.0
"""Time in which both arms engage, s, on any network that lets them."""

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
class Instant:
    """Positions of both arms, m, speed of the slave, m/s, and energy given to both, J."""

    master: Vector
    slave: Vector
    slave_speed: float
    given: float


def couple(
    hosts: TwoHosts, path: Path, around_slave: Around, duration: float
) -> Iterator[Instant]:
    """Yield sample by sample how two arms move that two hosts couple.

    Parameters
    ----------
    hosts : TwoHosts
        At `RATE` and `LATENCY`.
    path : callable
        Place of the hand at the master, which begins after `ENGAGING`.
    around_slave : callable
        Surface or scene that the slave meets.
    duration : float
        s.
    """
    hand = Hand(path)
    master, slave = Arm(hand), Arm(around_slave)
    due = deque([(ZERO, ZERO)] * LATENCY)
    for tick in range(round(duration * RATE)):
        now = tick / RATE
        hand.lead(max(0.0, now - ENGAGING))
        samples = (Sample(arm.position, arm.velocity, 0.0) for arm in (master, slave))
        due.append(hosts.sample(now, *samples)[:2])
        for arm, force in zip((master, slave), due.popleft(), strict=True):
            arm.move(force)
        speed = math.hypot(*slave.velocity)
        yield Instant(master.position, slave.position, speed, master.work + slave.work)

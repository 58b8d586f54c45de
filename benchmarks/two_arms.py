# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two point masses, a hand and a wall: a minimal model for checking coupling stability."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from haptic_accel import ChannelParameters, PassiveParameters, Vector
from haptic_accel.core import ZERO, SafetyParameters
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.simulated_rig import rig_side
from haptic_accel.core.tick import ARM
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import Sample
from haptic_accel.kits.link.two_hosts import TwoHosts

RATE = 1000.0
"""Sampling rate of both halves, Hz."""

STEPS = 5
"""Integration steps per sample."""

ENGAGING = 1.0
"""Time in which both arms engage on any network that allows it, s."""

HAND_DAMPING = 3.0
"""Damping of a hand that holds an arm, N s/m: 0.4 of critical for the arm's mass."""

Around = Callable[[Vector, Vector], Vector]
"""Force of the environment of an arm, N, from its position, m, and velocity, m/s."""

Path = Callable[[float], Vector]
"""Position of the hand, m, as a function of time, s."""


class PointMass:
    """Device without friction and accelerometer, driven by hand or wall and the arm's motors.

    Parameters
    ----------
    outside : callable
        Force of hand or wall.
    mass : float
        Mass, kg.
    """

    late = 0
    contact_force = None

    def __init__(self, outside: Around, mass: float = 0.1) -> None:
        self._outside, self._mass = outside, mass
        self._tick = 0
        self._position = self._velocity = self._force = ZERO

    def read(self, time: float) -> Sample:
        """Integrate the present force until a time in s, in whole samples; return the sample."""
        samples = round(time * RATE) - self._tick
        self._tick += samples
        step, (fx, fy, fz) = 1.0 / RATE / STEPS, self._force
        for _ in range(samples * STEPS):
            x, y, z = self._position
            vx, vy, vz = self._velocity
            ox, oy, oz = self._outside(self._position, self._velocity)
            vx += step * (fx + ox) / self._mass
            vy += step * (fy + oy) / self._mass
            vz += step * (fz + oz) / self._mass
            self._velocity = vx, vy, vz
            self._position = x + step * vx, y + step * vy, z + step * vz
        return Sample(self._position, self._velocity, ZERO)

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        """Set the force of the motors, N."""
        self.read(time)
        self._force = arm_force or self._force


class Hand:
    """Hand that leads an arm along a path."""

    def __init__(
        self, path: Path, stiffness: float = 150.0, damping: float = HAND_DAMPING
    ) -> None:
        self._path, self._stiffness, self._damping = path, stiffness, damping
        self.point = path(0.0)

    def lead(self, time: float) -> None:
        """Move to the position of a time, s."""
        self.point = self._path(time)

    def __call__(self, position: Vector, velocity: Vector) -> Vector:
        """Return the force of the hand on the arm, N."""
        x, y, z = (
            self._stiffness * (p - q) - self._damping * v
            for p, q, v in zip(self.point, position, velocity, strict=True)
        )
        return x, y, z


def wall(stiffness: float = 3000.0, depth: float = -0.005) -> Around:
    """Return the force function of an elastic wall below a depth, m, without damping."""

    def push(position: Vector, _: Vector) -> Vector:
        return 0.0, 0.0, stiffness * max(0.0, depth - position[2])

    return push


def free(_: Vector, __: Vector) -> Vector:
    """Return zero force: the arm has no environment."""
    return ZERO


def press(time: float) -> Vector:
    """Path of a hand that presses to 10 mm below its start, then rests."""
    return 0.0, 0.0, -0.01 * min(1.0, time / 0.3)


def stroke(time: float, speed: float = 0.1, length: float = 0.08, turn: float = 0.15) -> Vector:
    """Path of a hand that strokes back and forth along x, m, with smooth turns."""
    half = length / speed + turn * (1 - 2 / math.pi)
    passed, within = divmod(time, half)
    cruise = half - turn
    if within < turn / 2:
        travelled = (turn / math.pi) * speed * (1 - math.cos(math.pi * within / turn))
    elif within < turn / 2 + cruise:
        travelled = speed * (turn / math.pi + within - turn / 2)
    else:
        rest = half - within
        travelled = length - (turn / math.pi) * speed * (1 - math.cos(math.pi * rest / turn))
    return (travelled if passed % 2 == 0 else length - travelled), 0.0, 0.0


@dataclass(frozen=True)
class Instant:
    """State of both arms: positions, m, slave speed, m/s, and energy given to both, J."""

    master: Vector
    slave: Vector
    slave_speed: float
    given: float


class TwoArms:
    """Two arms coupled by two hosts, with default limits above the forces of all laws.

    Parameters
    ----------
    parameters : PassiveParameters
    network : ChannelParameters
        Channels of both directions, at `RATE` and `LATENCY`.
    path : callable
        Path of the hand at the master, which starts after `ENGAGING`.
    around_slave : callable
        Surface or scene at the slave.
    seed, blackouts
        As for `TwoHosts`.

    Attributes
    ----------
    hosts : TwoHosts
    """

    def __init__(
        self,
        parameters: PassiveParameters,
        network: ChannelParameters,
        path: Path,
        around_slave: Around,
        seed: int = 0,
        blackouts: Sequence[tuple[float, float]] = (),
    ) -> None:
        self._hand = Hand(path)
        surroundings: tuple[Around, Around] = (self._hand, around_slave)
        sides = {
            arm: rig_side(PointMass(around), SafetyParameters(), RATE, LATENCY, [ARM])
            for arm, around in zip(ARMS, surroundings, strict=True)
        }
        self.hosts = TwoHosts(parameters, network, sides, seed=seed, blackouts=blackouts)

    def move(self, duration: float) -> Iterator[Instant]:
        """Yield the motion of the arms for each sample during a time in s."""
        for tick in range(round(duration * RATE)):
            self.hosts.step(tick)
            master, slave = (
                sample for loop in self.hosts.loops.values() for sample in loop.samples
            )
            yield Instant(
                master.position,
                slave.position,
                math.hypot(*slave.velocity),
                sum(master.work) + sum(slave.work),
            )
            self._hand.lead(max(0.0, tick / RATE - ENGAGING))

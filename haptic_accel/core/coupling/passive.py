# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Passive coupling of two arms over a network: spring, local damping and energy tank.

Each arm has one half of the coupling. See haptic_accel/kits/link/passive_coupling.md for the law,
its proof and its performance.
The parameters of the position-position coupling (paper, section II) are here, too.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, like, parameter
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.tick import ArmSample, PairCoupling

FADE_TIME = 0.5
"""Time in which the gains change, s. It is several times a person's reaction time to a pull (0.2
s), and the period of the tool's oscillation on the coupling (0.1 s)."""


@dataclass(frozen=True)
class CouplingParameters(Checked):
    """Gains of the coupling; defaults from the paper (0.25 N/mm each way)."""

    k_m: float = parameter(250.0, "stiffness at the master", "N/m", 0, 5000.0)
    k_sl: float = parameter(250.0, "stiffness driving the slave", "N/m", 0, 5000.0)
    damping: float = parameter(
        0.0, "damping of the velocity difference, both ways", "N s/m", 0, 50.0
    )
    scale: float = parameter(1.0, "slave motion per master motion", low=0.01, high=100.0)
    max_force: float = parameter(
        3.3, "limit of each arm's force (Phantom Omni: 3.3 N)", "N", 0, 100.0
    )


LAWS = ("spring", "damped", "passive")
"""Spring only; spring with local damping and age-limited stiffness; the same with an energy
tank."""

CEILING = 2.5
"""Maximum energy in the tank of a half, as a multiple of the initial energy. The excess is sent to
the peer."""

KEPT = 0.5
"""Fraction of the energy dissipated by local damping that is stored in the tank. With 1, a
coupling oscillates long if the delay exceeds its design value."""

SIGN = 1e-12
"""Minimum energy sent to a restarted peer by a half that has already applied forces, J."""

SPEED_MARGIN = 0.5
"""Maximum increase of an arm's speed since measurement while a force acts, m/s: a tip of 60 g that
bounces off a wall at 0.25 m/s."""

RESTART_TRAVEL = 0.01
"""Distance, m, in the check for a reset work counter of a device: the work exceeds the largest
force times the sum of this distance and the arm's motion."""

QUANTILE = 0.99
"""Quantile of the ages of the peer's data that determines the damping."""

AGE_WINDOW = 2.0
"""Window of the quantile, s."""

AGE_PERIOD = 0.01
"""Interval between two ages in the window, s."""

NONSENSE = 1e6
"""Limit for the sum of positions, m, velocities, m/s, and work, J; no arm reaches it."""

LONGEST_AGE = 10.0
"""Upper limit of the age, s; longer ages are set to it."""

LEAD = 0.8
"""Lead time of the slave's set-point along the master's velocity, as a multiple of the age. The
set-point is late by half an age, and damping delays the slave by another half."""

LEAD_SMOOTHING = 0.03
"""Time constant of the master velocity's low-pass, s; it suppresses tremor of the handle."""

SMOOTHING = 0.1
"""Time constant of the set-point's low-pass filter, as a multiple of the age: its corner frequency
is 30 Hz at an age of 50 ms."""

RAISE_TIME = 1.0
"""Minimum time in which the stiffness rises from zero to its parameter, s; it falls at once."""

SHARE_TIME = 0.03
"""Minimum time in which a force that the tank had limited to zero recovers, s. Energy arrives in
bursts, which would otherwise be perceptible as jolts."""


@dataclass(frozen=True)
class PassiveParameters(Checked):
    """Gains of the coupling in two halves; lengths and forces in the master's scale."""

    law: str = parameter(
        "passive",
        "spring alone; damped: with local damping, and stiffness reduced with the delay;"
        " passive: with an energy tank as well",
        choices=LAWS,
    )
    stiffness: float = parameter(
        250.0, "stiffness while the peer's data is fresh enough (paper: 0.25 N/mm)", "N/m", 1, 5000
    )
    local_damping: float = parameter(
        3.0,
        "maximum damping of each arm's own motion; with data of age A, stiffness is limited"
        " to twice this over A",
        "N s/m",
        0.1,
        50.0,
    )
    energy: float = parameter(
        2e-3, "initial energy of each half: the maximum that its arm receives", "J", 1e-6, 1.0
    )
    scale: float = like(CouplingParameters, "scale")
    max_force: float = like(CouplingParameters, "max_force")


class _Force(NamedTuple):
    """Command: force, N; damping part of the force, N; maximum energy sent to the arm, J."""

    total: Vector
    damping: Vector
    reserve: float


_NO_FORCE = _Force(ZERO, ZERO, 0.0)


class _AgeQuantile:
    """Quantile of the ages of the peer's data in a sliding window.

    Parameters
    ----------
    rate : float
        Samples per second.
    """

    def __init__(self, rate: float) -> None:
        self._every = max(1, round(AGE_PERIOD * rate))
        self._ages: deque[float] = deque(maxlen=round(AGE_WINDOW / AGE_PERIOD))
        self._samples = 0
        self._longest = 0.0
        self._quantile = 0.0

    def put(self, age: float) -> float:
        """Add an age, s; return the quantile, or the new age if it is longer."""
        if age < LONGEST_AGE:  # longer: the network's delay is still unknown
            self._longest = max(self._longest, age)
        self._samples += 1
        if self._samples % self._every == 0:
            self._ages.append(self._longest)
            self._longest = 0.0
            ages = sorted(self._ages)
            self._quantile = ages[int(QUANTILE * (len(ages) - 1))]
        return max(self._quantile, age)


class PassiveHalf:
    """Half of the coupling at one arm: force, local damping and energy tank.

    Positions are relative to the position at engagement, in the master's scale. The initial energy
    is granted once, at the first force, unless the peer has sent energy before.

    Parameters
    ----------
    parameters : PassiveParameters
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples.
    leads : bool
        True to extrapolate the set-point by the peer's velocity; for the slave only.

    Attributes
    ----------
    engaged : bool
        True while the arm is coupled.
    energy : float
        Energy in the tank, J, that may be transferred to the arm; includes the spring's potential
        energy.
    shipped : float
        Energy sent to the present peer since `new_session`, J.
    stiffness, damping : float
        Present values, N/m and N s/m.
    limited : float
        Fraction of the last second in which the tank limited the force.
    """

    def __init__(
        self,
        parameters: PassiveParameters,
        rate: float,
        latency: int = LATENCY,
        *,
        leads: bool = False,
    ) -> None:
        self._p = parameters
        self._lead = LEAD if leads else 0.0
        self._period = 1.0 / rate
        self._latency = latency
        self._ages = _AgeQuantile(rate)
        self.engaged = self._used = False
        self.energy = self.shipped = self._received = 0.0
        self.limited = 0.0
        self.stiffness = self.damping = self._age = 0.0
        self._bearable = 0.0  # stiffness for the age, N/m
        self._risen = self._rise = 1.0
        self._clear()

    def engage(self, rise_time: float = 0.0) -> None:
        """Couple the arm, with a stiffness for the age of the peer's data.

        Parameters
        ----------
        rise_time : float
            Time in which stiffness and damping rise from zero, s.
        """
        self.engaged = True
        self._ages = _AgeQuantile(1.0 / self._period)
        self._bearable = 0.0
        self._risen, self._rise = 0.0, self._period / max(self._period, rise_time)

    def disengage(self) -> None:
        """Uncouple: forces are zero until the next `engage`."""
        self._settle()
        self.engaged = False

    def change(self, parameters: PassiveParameters) -> None:
        """Change the gains; the initial energy does not change."""
        self._p = parameters

    def new_session(self) -> None:
        """Begin with a new or restarted peer.

        A half that has already applied forces shares its energy with the new peer. A restarted
        half thereby learns that the initial energy was already granted.
        """
        self.shipped = self._received = 0.0
        if self._used:
            spare = max(0.0, self.energy - self._under_way)
            self._ship(max(SIGN, min(self._p.energy, spare / 2)))

    def receive(self, shipped: float) -> None:
        """Receive the cumulative energy sent by the peer, J; outdated values are ignored.

        Pass values only from packets that answer a session of this half.
        """
        if math.isfinite(shipped) and shipped > self._received:
            self.energy += min(shipped - self._received, max(0.0, -self._surplus))
            self._received = shipped

    def force(
        self,
        position: Vector,
        velocity: Vector,
        set_point: Vector,
        set_point_velocity: Vector,
        round_trip_age: float,
        work: float | None = None,
    ) -> Vector:
        """Return the force for the arm, N; zero if an argument is invalid.

        Parameters
        ----------
        position, velocity : tuple of float
            Motion of the arm, m and m/s.
        set_point, set_point_velocity : tuple of float
            Newest motion of the peer, m and m/s.
        round_trip_age : float
            Age of the local position on which the peer's data is based, s.
        work : float, optional
            Cumulative work of the applied forces up to this position, J; None if the commanded
            forces were applied.
        """
        numbers = (*position, *velocity, *set_point, *set_point_velocity, work or 0.0)
        if not (self.engaged and sum(map(abs, numbers)) < NONSENSE):
            self._settle()
            return ZERO
        self._start()
        self._book(position, work)
        self._follow_age(round_trip_age)
        if self._p.law == "passive":
            set_point = self._extrapolated(set_point, set_point_velocity)
        force = self._spend(position, velocity, set_point)
        self._forces.append(force)
        self._ship(self._surplus)
        return force.total

    @property
    def _under_way(self) -> float:
        """Maximum energy that the forces still acting can transfer to the arm, J."""
        return sum(force.reserve for force in self._forces)

    @property
    def share(self) -> float:
        """Fraction of the last force for which the energy in the tank sufficed."""
        return self._spring_share * self._total_share

    @property
    def supply(self) -> float:
        """Energy that neither spring nor acting forces need, over the initial energy, 0 to 1."""
        if not self._accounted:
            return 1.0
        spare = self.energy - self._spring_energy - self._under_way
        return max(0.0, min(1.0, spare / self._p.energy))

    @property
    def _surplus(self) -> float:
        """Energy above the ceiling, J, excluding the spring and forces still acting."""
        ceiling = self._p.energy * CEILING
        return self.energy - self._spring_energy - self._under_way - ceiling

    @property
    def _accounted(self) -> bool:
        return self._p.law == "passive"

    def _start(self) -> None:
        """Grant the initial energy before the first force, unless the peer has sent energy."""
        if not self._used and not self._received:
            self.energy = self._p.energy
        self._used = True

    def _clear(self) -> None:
        self._position: Vector | None = None
        self._work: float | None = None
        self._forces = deque([_NO_FORCE] * (self._latency + 1))
        self._spring_energy = 0.0
        self._spring_share = self._total_share = 1.0
        self._set_point: Vector | None = None
        self._filtered_velocity = ZERO

    def _settle(self) -> None:
        """Subtract the energy that present forces could transfer, as it is no longer measured."""
        self.energy -= self._under_way
        self._clear()

    def _book(self, position: Vector, work: float | None) -> None:
        """Subtract the work of the force that acted since the previous sample from the tank."""
        acted = self._forces.popleft()
        if self._position is not None:
            x, y, z = position
            x0, y0, z0 = self._position
            dx, dy, dz = x - x0, y - y0, z - z0
            fx, fy, fz = acted.total
            bx, by, bz = acted.damping
            # If samples are missing, the force may have ended: limit its work to one sample.
            spent = max(fx * dx + fy * dy + fz * dz, -acted.reserve)
            if work is not None and self._work is not None:
                spent = self._plausible(work - self._work, math.sqrt(dx * dx + dy * dy + dz * dz))
            self.energy -= spent
            damped = -(bx * dx + by * dy + bz * dz)
            spare = self.energy - self._under_way
            self.energy -= max(0.0, min((1.0 - KEPT) * damped, spare / 2))
        self._position, self._work = position, work

    def _plausible(self, reported: float, distance: float) -> float:
        """Return a device's work, J, over a distance, m, limited to the possible work."""
        limit = self._p.max_force
        if reported > limit * (distance + RESTART_TRAVEL):
            return 0.0
        return max(reported, -limit * distance)

    def _follow_age(self, age: float) -> None:
        """Set stiffness and damping for the age of the peer's data, s."""
        p, before = self._p, self._bearable
        if p.law == "spring":
            self.stiffness = p.stiffness
            return
        age = self._ages.put(age if 0.0 <= age < LONGEST_AGE else LONGEST_AGE)
        self._age = age = age + (2 * self._latency + 1) * self._period  # the force's own delay
        rise = p.stiffness * self._period / RAISE_TIME
        self._bearable = min(p.stiffness, 2 * p.local_damping / age)
        if before:
            self._bearable = min(self._bearable, before + rise)
        self._risen = min(1.0, self._risen + self._rise)
        self.stiffness = self._risen * self._bearable
        self.damping = self.stiffness * age / 2

    def _extrapolated(self, set_point: Vector, velocity: Vector) -> Vector:
        """Return the filtered set-point, extrapolated to the present along the velocity."""
        share = self._period / (self._period + LEAD_SMOOTHING)
        self._filtered_velocity = filtered = _toward(self._filtered_velocity, velocity, share)
        x, y, z = set_point
        vx, vy, vz = filtered
        lead = self._lead * self._age
        ahead = x + lead * vx, y + lead * vy, z + lead * vz
        share = self._period / (self._period + SMOOTHING * self._age)
        self._set_point = _toward(self._set_point or ahead, ahead, share)
        return self._set_point

    def _spend(self, position: Vector, velocity: Vector, set_point: Vector) -> _Force:
        """Return the force towards a set-point, limited by the energy in the tank."""
        k, b = self.stiffness, self.damping
        x, y, z = position
        vx, vy, vz = velocity
        ex, ey, ez = set_point[0] - x, set_point[1] - y, set_point[2] - z
        travel = (math.sqrt(vx * vx + vy * vy + vz * vz) + SPEED_MARGIN) * self._period
        most = self._p.max_force
        reach = limit = math.inf
        if self._accounted:
            spare = max(0.0, self.energy - self._under_way)
            reach, limit = math.sqrt(2.0 * spare * k), spare / (2.0 * travel)
        stretch = k * math.sqrt(ex * ex + ey * ey + ez * ez)
        spring = min(stretch, most)
        self._spring_share = self._recovered(self._spring_share, reach, spring)
        ratio = k * self._spring_share * (spring / stretch if stretch else 1.0)
        fx, fy, fz = ratio * ex - b * vx, ratio * ey - b * vy, ratio * ez - b * vz
        size = math.sqrt(fx * fx + fy * fy + fz * fz)
        requested = min(size, most)
        self._total_share = self._recovered(self._total_share, limit, requested)
        shorter = self._total_share * (requested / size if size else 1.0)
        limited = min(reach, most) < stretch or min(limit, most) < size
        self.limited += (float(limited) - self.limited) * self._period
        self._spring_energy = min(spring, reach) ** 2 / (2.0 * k)
        reserve = size * shorter * travel
        b *= shorter
        total = fx * shorter, fy * shorter, fz * shorter
        return _Force(total, (-b * vx, -b * vy, -b * vz), reserve)

    def _recovered(self, share: float, possible: float, requested: float) -> float:
        """Return the possible share of a requested force; it rises slowly from the last."""
        return min(
            possible / requested if possible < requested else 1.0,
            share + self._period / SHARE_TIME,
        )

    def _ship(self, energy: float) -> None:
        if energy > 0.0:
            self.energy -= energy
            self.shipped += energy


class PassivePair(PairCoupling):
    """Both halves in one process, as a replacement for `PositionPositionCoupling`.

    Parameters
    ----------
    parameters : PassiveParameters
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples.

    Attributes
    ----------
    sides : tuple of PassiveHalf
        Halves of master and slave.
    """

    def __init__(self, parameters: PassiveParameters, rate: float, latency: int = LATENCY) -> None:
        super().__init__()
        self.stiffness, self.scale = parameters.stiffness, parameters.scale
        self._origins: tuple[Vector, Vector] | None = None
        self.sides = (
            PassiveHalf(parameters, rate, latency),
            PassiveHalf(of_slave(parameters), rate, latency, leads=True),
        )

    def engage(self, master: Vector, slave: Vector) -> None:
        """Couple the arms at their positions, m."""
        self.engaged = True
        self._origins, self._slave = (master, slave), slave
        for half in self.sides:
            half.engage()

    def disengage(self) -> None:
        """Uncouple: forces are zero until the next `engage`."""
        self.engaged, self._origins = False, None
        for half in self.sides:
            half.disengage()

    def change(self, parameters: PassiveParameters, samples: int = 0) -> None:
        """Change the gains; the stiffness falls at once and rises within `RAISE_TIME`.

        The lag of the slave, in the master's scale, does not change. The number of samples exists
        for `PositionPositionCoupling.change` only and is ignored.
        """
        if self._origins is not None:
            ratio = parameters.scale / self.scale
            x, y, z = self._slave
            x0, y0, z0 = self._origins[1]
            moved = x - (x - x0) * ratio, y - (y - y0) * ratio, z - (z - z0) * ratio
            self._origins = self._origins[0], moved
        self.scale = parameters.scale
        for half, own in zip(self.sides, (parameters, of_slave(parameters)), strict=True):
            half.change(own)

    def couple(self, master: ArmSample, slave: ArmSample) -> None:
        """Compute the forces for samples of both arms, with the work of their motors if known."""
        if self._origins is None:
            self.m_x = self.m_y = self.m_z = self.s_x = self.s_y = self.s_z = 0.0
            return
        first, second = self.sides
        if all(map(math.isfinite, slave.position)):
            self._slave = slave.position
        scale, (master_origin, slave_origin) = self.scale, self._origins
        one = scaled(master.position, 1.0, master_origin)
        other = scaled(slave.position, 1.0 / scale, slave_origin)
        other_velocity = scaled(slave.velocity, 1.0 / scale)
        on_one, on_other = (sum(a.work) if a.has_work else None for a in (master, slave))
        if on_other is not None:
            on_other /= scale * scale
        on_master = first.force(one, master.velocity, other, other_velocity, 0.0, on_one)
        on_slave = second.force(other, other_velocity, one, master.velocity, 0.0, on_other)
        first.receive(second.shipped)
        second.receive(first.shipped)
        self.stiffness = first.stiffness
        self.m_x, self.m_y, self.m_z = on_master
        self.s_x, self.s_y, self.s_z = scaled(on_slave, scale)


def _toward(start: Vector, end: Vector, share: float) -> Vector:
    x, y, z = start
    return x + share * (end[0] - x), y + share * (end[1] - y), z + share * (end[2] - z)


def of_slave(parameters: PassiveParameters) -> PassiveParameters:
    """Return the parameters of the slave's half, converted to the master's scale."""
    return replace(parameters, max_force=min(parameters.max_force / parameters.scale, 100.0))


def scaled(vector: Vector, factor: float, origin: Vector = ZERO) -> Vector:
    """Return a vector scaled by a factor about an origin."""
    x, y, z = vector
    x0, y0, z0 = origin
    return (x - x0) * factor, (y - y0) * factor, (z - z0) * factor

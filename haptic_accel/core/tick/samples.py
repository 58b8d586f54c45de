# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sample of one arm at a tick, work of its motors, and synchronization of both arms' samples."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from haptic_accel.core.model import IDENTITY, ZERO, Sample

if TYPE_CHECKING:
    from haptic_accel.core.model import Quaternion, Vector

KEPT: int = 1000
"""Maximum number of force changes that wait for the next sample; beyond, the oldest are
dropped."""

BEFORE_ALL: float = float("-inf")


class ArmSample:
    """Sample of an arm and its accelerometer at a tick; SI units, axes as in `Sample`.

    Parameters
    ----------
    stamp : int
        Time on the clock of the stamps, ns.
    position, velocity : tuple of float
        Position, m, and velocity, m/s.
    work : float, optional
        Cumulative work of the arm's motors, J, from any start; None if unknown.
    acceleration : tuple of float
        Acceleration, m/s^2.

    Attributes
    ----------
    arm, tick, stamp : int
        Index of the arm in `ARMS`, tick, and its time, ns.
    x, y, z, v_x, v_y, v_z, a_x, a_y, a_z : float
        Position, velocity and acceleration.
    orientation : tuple of float
        Quaternion; the object `IDENTITY` itself for an arm without orientation.
    work_x, work_y, work_z : float
        Cumulative work of the arm's motors per axis, J; valid if `has_work`.
    contact : tuple of float or None
        Force of the surface on the tool, N; None if unknown.
    """

    def __init__(
        self,
        stamp: int = 0,
        position: Vector = ZERO,
        velocity: Vector = ZERO,
        work: float | None = None,
        acceleration: Vector = ZERO,
    ) -> None:
        self.arm = self.tick = 0
        self.stamp: int = stamp
        self.x = self.y = self.z = self.v_x = self.v_y = self.v_z = 0.0
        self.a_x = self.a_y = self.a_z = self.work_x = self.work_y = self.work_z = 0.0
        self.x, self.y, self.z = position
        self.v_x, self.v_y, self.v_z = velocity
        self.a_x, self.a_y, self.a_z = acceleration
        self.orientation: Quaternion = IDENTITY
        self.has_work: bool = work is not None
        self.work_z = work or 0.0
        self.contact: Vector | None = None

    @property
    def position(self) -> Vector:
        """Position of tip or handle, m."""
        return self.x, self.y, self.z

    @property
    def velocity(self) -> Vector:
        """Velocity of the same point, m/s."""
        return self.v_x, self.v_y, self.v_z

    @property
    def acceleration(self) -> Vector:
        """Acceleration in the axes of tool or handle, m/s^2."""
        return self.a_x, self.a_y, self.a_z

    @property
    def work(self) -> Vector:
        """Cumulative work of the arm's motors, J, per axis."""
        return self.work_x, self.work_y, self.work_z

    @property
    def sample(self) -> Sample:
        """Readings as a device returns them."""
        return Sample(self.position, self.velocity, self.acceleration, self.orientation)


class TimedForce:
    """Force, N, of an arm's motors or its actuator, from a time in s on, or due at a tick.

    The stamp is that of the sample that caused the force, ns.
    """

    def __init__(
        self,
        time: float = 0.0,
        on_arm: bool = False,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
    ) -> None:
        self.time, self.on_arm, self.x, self.y, self.z = time, on_arm, x, y, z
        self.stamp = self.due = 0


class ArmWork:
    """Cumulative sum of applied force times displacement, per axis.

    The work between two samples is the applied force times the change of position. This is exact
    for a force that changes at samples only. For other changes (late, or set to zero by a
    watchdog) the displacement is divided under the assumption of constant velocity. With an
    acceleration a and a period T the error is at most a T^2 / 8 times the change of force: 1 uJ
    for 1 N, 8 m/s^2 and 1 ms. A lost sample makes the period longer.

    The forces are the commands to the device, at the times of the calls. Delays and suppressed
    forces inside the device are unknown here.

    Attributes
    ----------
    x, y, z : float
        Work up to the newest sample, J.
    unknown : int
        Number of samples without a position.

    Examples
    --------
    >>> work = ArmWork()
    >>> work.until(0.0, ArmSample(0))
    >>> work.apply(0.0, 2.0, 0.0, -1.0)
    >>> work.until(0.001, ArmSample(1_000_000, (0.5, 7.0, 0.25)))
    >>> work.x, work.y, work.z
    (1.0, 0.0, -0.25)
    """

    def __init__(self) -> None:
        self.unknown = 0
        self.x = self.y = self.z = 0.0
        self._time: float = BEFORE_ALL
        self._p_x = self._p_y = self._p_z = 0.0
        self._f_x = self._f_y = self._f_z = 0.0
        # The first `_count` are the changes since the last sample; the others are reused.
        self._changes: list[TimedForce] = []
        self._count = 0

    def apply(self, time: float, x: float, y: float, z: float) -> None:
        """Record that a force, N, acts from a time on, s; times must increase."""
        changes = self._changes
        if self._count == KEPT:
            changes.append(changes.pop(0))
            self._count -= 1
        elif self._count == len(changes):
            changes.append(TimedForce())
        change: TimedForce = changes[self._count]
        change.time, change.x, change.y, change.z = time, x, y, z
        self._count += 1

    def until(self, time: float, sample: ArmSample) -> None:
        """Add the work up to a sample, and store it in the sample.

        Parameters
        ----------
        time : float
            Time of the sample, s; it may precede the last forces.
        sample : ArmSample
            It counts as lost if its position is not finite.
        """
        x, y, z = sample.x, sample.y, sample.z
        sample.has_work = True
        if not math.isfinite(x + y + z):
            self.unknown += 1
            sample.work_x, sample.work_y, sample.work_z = self.x, self.y, self.z
            return
        since, changes = self._time, self._changes
        f_x, f_y, f_z = self._f_x, self._f_y, self._f_z
        held_x, held_y, held_z = f_x, f_y, f_z
        # Mean force between the two times; changes up to the second time are removed.
        used: int = 0
        while used < self._count:
            change: TimedForce = changes[used]
            moment = change.time
            if moment > time:
                break
            used += 1
            n_x, n_y, n_z = change.x, change.y, change.z
            if time > since:
                left = (time - (moment if moment > since else since)) / (time - since)
                f_x += (n_x - held_x) * left
                f_y += (n_y - held_y) * left
                f_z += (n_z - held_z) * left
            held_x, held_y, held_z = n_x, n_y, n_z
        if used:
            self._count -= used
            if self._count:
                changes[:] = changes[used:] + changes[:used]
            self._f_x, self._f_y, self._f_z = held_x, held_y, held_z
        self._time = time
        if since > BEFORE_ALL:
            self.x += f_x * (x - self._p_x)
            self.y += f_y * (y - self._p_y)
            self.z += f_z * (z - self._p_z)
        self._p_x, self._p_y, self._p_z = x, y, z
        sample.work_x, sample.work_y, sample.work_z = self.x, self.y, self.z


class Pairing:
    """Synchronizer of the samples of two arms, tick by tick.

    A sample waits for the other arm's sample of the same tick. If the other arm has already sent a
    later sample, its previous sample is used instead.

    Parameters
    ----------
    rate : float
        Samples per second of both arms.
    longest : int
        Maximum number of waiting samples per arm.

    Attributes
    ----------
    master, slave : ArmSample
        Samples of the last complete tick.
    held : int
        Number of ticks with an earlier sample in place of a missing one.
    """

    def __init__(self, rate: float, longest: int) -> None:
        self._half_period: float = 0.5e9 / rate
        self._longest: int = longest
        self._masters: list[ArmSample] = []
        self._slaves: list[ArmSample] = []
        self._has_master = self._has_slave = False
        self.master: ArmSample = ArmSample()
        self.slave: ArmSample = ArmSample()
        self.held = 0

    @property
    def waiting(self) -> bool:
        """True while a sample of one arm waits for the other arm's."""
        return bool(self._masters or self._slaves)

    def put(self, sample: ArmSample) -> None:
        """Add a sample of the arm that it specifies; stamps must increase."""
        waiting = self._slaves if sample.arm else self._masters
        if len(waiting) == self._longest:
            del waiting[0]
        waiting.append(sample)

    def clear(self) -> None:
        """Discard all samples."""
        self._masters.clear()
        self._slaves.clear()
        self._has_master = self._has_slave = False

    def advance(self) -> bool:
        """Take the samples of the next complete tick; return False if there is none."""
        masters, slaves = self._masters, self._slaves
        while masters and slaves:
            first: ArmSample = masters[0]
            second: ArmSample = slaves[0]
            ahead = first.stamp - second.stamp
            if ahead <= self._half_period:
                self.master = first
                self._has_master = True
                del masters[0]
            else:
                self.held += self._has_master
            if ahead >= -self._half_period:
                self.slave = second
                self._has_slave = True
                del slaves[0]
            else:
                self.held += self._has_slave
            if self._has_master and self._has_slave:
                return True
        return False

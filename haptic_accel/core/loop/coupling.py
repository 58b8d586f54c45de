# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling of both arms as a part of the loop: from their samples to the forces on both."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from haptic_accel.core.coupling.pairing import Motion, Pairing
from haptic_accel.core.coupling.passive import PassivePair
from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.model import Vector


class Caused(NamedTuple):
    """Samples of both arms at a tick, and the forces that they cause, N."""

    master: Motion
    slave: Motion
    on_master: Vector
    on_slave: Vector


class CouplingPart:
    """Computes the forces of each tick of which both arms' samples are there.

    Parameters
    ----------
    coupling : PositionPositionCoupling or PassivePair
    rate : float
        Samples per second of both arms.
    longest : int
        Most samples of an arm that wait for the other's.
    """

    def __init__(
        self, coupling: PositionPositionCoupling | PassivePair, rate: float, longest: int
    ) -> None:
        self._coupling = coupling
        self._pairing = Pairing(rate, longest)
        self._engaging = False

    @property
    def engaged(self) -> bool:
        """The arms are coupled."""
        return self._coupling.engaged

    @property
    def held(self) -> int:
        """Number of ticks at which an earlier sample stood for one that is missing."""
        return self._pairing.held

    @property
    def waiting(self) -> bool:
        """True while a sample of one arm waits for that of the other."""
        return self._pairing.waiting

    def put(self, arm: int, motion: Motion) -> None:
        """Take a sample of an arm, 0 for the master and 1 for the slave."""
        self._pairing.put(arm, motion)

    def engage(self) -> None:
        """Couple the arms with the next samples of both."""
        self._engaging = True

    def disengage(self) -> None:
        """Uncouple the arms."""
        self._engaging = False
        self._coupling.disengage()

    def clear(self) -> None:
        """Forget the samples that wait."""
        self._pairing.clear()

    def step(self) -> Iterator[Caused | None]:
        """Yield the forces of each complete tick; None for a tick while the arms are free."""
        for master, slave in self._pairing.pairs():
            if self._engaging:
                self._engaging = False
                self._coupling.engage(master.position, slave.position)
            if self._coupling.engaged:
                on_master, on_slave = self._forces(master, slave)
                yield Caused(master, slave, on_master, on_slave)
            else:
                yield None

    def _forces(self, master: Motion, slave: Motion) -> tuple[Vector, Vector]:
        _, position, velocity, work = master
        _, slave_position, slave_velocity, slave_work = slave
        motions = position, slave_position, velocity, slave_velocity
        if isinstance(self._coupling, PassivePair):
            return self._coupling.forces(*motions, (work, slave_work))
        return self._coupling.forces(*motions)

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples of the two arms that belong to the same tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import half_period


class Motion(NamedTuple):
    """Stamp of a sample, ns, position, m, and velocity, m/s, of an arm.

    The work is that of its motors' force, J, since any moment; None where it is not known.
    """

    stamp: int
    position: Vector
    velocity: Vector
    work: float | None = None


class Pairing:
    """Pairs the samples of two arms, tick by tick.

    A sample waits for that of the other arm. Where the other arm has sent a later one, it is lost:
    the one before stands for it.

    Parameters
    ----------
    rate : float
        Samples per second of both arms.
    longest : int
        Most samples of an arm that wait.

    Attributes
    ----------
    held : int
        Number of ticks at which an earlier sample stood for one that is missing.
    """

    def __init__(self, rate: float, longest: int) -> None:
        self._half_period = half_period(rate)
        self._waiting: tuple[deque[Motion], deque[Motion]] = (
            deque(maxlen=longest),
            deque(maxlen=longest),
        )
        self._before: list[Motion | None] = [None, None]
        self.held = 0

    @property
    def waiting(self) -> bool:
        """True while a sample of one arm waits for that of the other."""
        return any(self._waiting)

    def put(self, arm: int, motion: Motion) -> None:
        """Take a sample of an arm, 0 or 1, in the order of the stamps."""
        self._waiting[arm].append(motion)

    def clear(self) -> None:
        """Forget all samples."""
        for waiting in self._waiting:
            waiting.clear()
        self._before = [None, None]

    def pairs(self) -> Iterator[tuple[Motion, Motion]]:
        """Yield the samples of both arms for each tick that is complete."""
        first, second = self._waiting
        half_period = self._half_period
        while first and second:
            ahead = first[0].stamp - second[0].stamp
            self._before = [
                first.popleft() if ahead <= half_period else self._held(0),
                second.popleft() if ahead >= -half_period else self._held(1),
            ]
            master, slave = self._before
            if master and slave:
                yield master, slave

    def _held(self, arm: int) -> Motion | None:
        """Return the sample that stands for an arm's missing one."""
        before = self._before[arm]
        self.held += before is not None
        return before

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Pairing of the samples of two arms by tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import half_period


class Motion(NamedTuple):
    """Sample of an arm: stamp, ns, position, m, and velocity, m/s.

    `work` is the cumulative work of the arm's motors, J, from any start; None if unknown.
    """

    stamp: int
    position: Vector
    velocity: Vector
    work: float | None = None


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
    held : int
        Number of ticks with an earlier sample in place of a missing one.
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
        """True while a sample of one arm waits for the other arm's."""
        return any(self._waiting)

    def put(self, arm: int, motion: Motion) -> None:
        """Add a sample of an arm, 0 or 1; stamps must increase."""
        self._waiting[arm].append(motion)

    def clear(self) -> None:
        """Discard all samples."""
        for waiting in self._waiting:
            waiting.clear()
        self._before = [None, None]

    def pairs(self) -> Iterator[tuple[Motion, Motion]]:
        """Yield the samples of both arms for each complete tick."""
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
        """Return the replacement of an arm's missing sample."""
        before = self._before[arm]
        self.held += before is not None
        return before

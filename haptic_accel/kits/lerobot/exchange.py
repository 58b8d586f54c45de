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

"""Memory that the fast path shares with LeRobot's process."""

from __future__ import annotations

import mmap
import os

import numpy as np

from haptic_accel.core.model import FloatArray, Vector

WRITTEN, TICKS, LATE, LOST, FELT = range(5)
"""Places in `Ring.counts`: samples so far; ticks, and those that were late by half a period or
more; samples that did not come and are held from the one before; steady time of the
last request to let the coil move, ns, which the reader sets."""

SLOTS = 8192
"""Samples that are kept: 8 s at 960 Hz, so that no reader is overtaken."""

LONGEST = SLOTS // 2
"""Most samples that can be read together: the other half is the reader's time, 4 s at 960 Hz."""

_COLUMNS = 4  # tick, acceleration along x, y, z
_SIZE = 8 * (FELT + 1 + SLOTS * _COLUMNS)


class Ring:
    """Newest samples of one writer, for readers in other processes.

    Parameters
    ----------
    descriptor : int
        File of `memory_file`, which this process has made or inherited.

    Attributes
    ----------
    counts : ndarray of int
        See `WRITTEN` and the others.

    Notes
    -----
    The writer never waits for a reader. A reader checks that what it copied was not overwritten.
    """

    def __init__(self, descriptor: int) -> None:
        memory = mmap.mmap(descriptor, _SIZE)
        self.counts = np.frombuffer(memory, np.int64, FELT + 1)
        slots = np.frombuffer(memory, np.float64, offset=self.counts.nbytes)
        self._slots = slots.reshape(SLOTS, _COLUMNS)

    def put(self, tick: int, acceleration: Vector) -> None:
        """Add the sample of a tick, m/s^2; ticks without one hold the sample before."""
        if written := self.counts[WRITTEN]:
            before, *held = self._slots[(written - 1) % SLOTS].tolist()
            for missing in range(max(int(before) + 1, tick - SLOTS), tick):
                self._put(missing, *held)
                self.counts[LOST] += 1
        self._put(tick, *acceleration)

    def _put(self, *row: float) -> None:
        self._slots[self.counts[WRITTEN] % SLOTS] = row
        self.counts[WRITTEN] += 1  # last, as readers trust what it counts

    def newest(self, size: int) -> tuple[int, FloatArray] | None:
        """Return the newest tick, and as many samples as asked for, the newest last.

        Parameters
        ----------
        size : int
            Number of samples, `LONGEST` at most.

        Returns
        -------
        tuple of int and ndarray, shape (size, 3), or None
            Tick, and accelerations in m/s^2; None before there are so many.
        """
        while (begin := int(self.counts[WRITTEN]) - size) >= 0:
            rows = self._slots[np.arange(begin, begin + size) % SLOTS]
            if self.counts[WRITTEN] - begin < SLOTS:
                return int(rows[-1, 0]), rows[:, 1:]
        return None


def memory_file() -> int:
    """Return the descriptor of a new file in memory, which ends with its last process.

    It has no name. Named shared memory outlives a process that is killed, and Python's tracker of
    such names would remove it when the first process ends.
    """
    descriptor = os.memfd_create("haptic_accel")
    os.ftruncate(descriptor, _SIZE)
    return descriptor

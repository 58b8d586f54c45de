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

"""Exchange of the fast path with LeRobot's process: samples one way, letters the other."""

from __future__ import annotations

import mmap
import os

import numpy as np

from haptic_accel.core.model import FloatArray, Vector

FEEL, MUTE = b"f", b"m"
"""Letters that let the coil move, and that silence it."""

SLOTS = 8192
"""Samples that are kept: 8 s at 960 Hz, so that no reader is overtaken."""

LONGEST = SLOTS // 2
"""Most samples that can be read together: the other half is the reader's time, 4 s at 960 Hz."""

_COUNTS = 4  # written samples, ticks, late ticks, lost samples
_COLUMNS = 4  # tick, acceleration along x, y, z
_SIZE = 8 * (_COUNTS + SLOTS * _COLUMNS)


class Ring:
    """Newest samples of one writer, for readers in other processes.

    Parameters
    ----------
    descriptor : int
        File of `memory_file`, which this process has inherited or made.

    Notes
    -----
    The writer never waits for a reader. A reader checks that what it copied was not overwritten.
    """

    def __init__(self, descriptor: int) -> None:
        memory = mmap.mmap(descriptor, _SIZE)
        self._counts = np.frombuffer(memory, np.int64, _COUNTS)
        slots = np.frombuffer(memory, np.float64, offset=8 * _COUNTS)
        self._slots = slots.reshape(SLOTS, _COLUMNS)

    @property
    def written(self) -> int:
        """Number of samples so far."""
        return int(self._counts[0])

    @property
    def ticks(self) -> tuple[int, int]:
        """Numbers of ticks, and of ticks that were late by half a period and more."""
        return int(self._counts[1]), int(self._counts[2])

    @property
    def lost(self) -> int:
        """Number of samples that did not come, and are held from the one before."""
        return int(self._counts[3])

    def count(self, ticks: int, late: int) -> None:
        """Set the numbers of ticks and late ticks."""
        self._counts[1:3] = ticks, late

    def put(self, tick: int, acceleration: Vector) -> None:
        """Add the sample of a tick, m/s^2; ticks without one hold the sample before."""
        written = self.written
        if written:
            before = self._slots[(written - 1) % SLOTS].copy()
            missing = range(max(int(before[0]) + 1, tick - SLOTS), tick)
            for each in missing:
                self._put(each, before[1:])
            self._counts[3] += len(missing)
        self._put(tick, acceleration)

    def _put(self, tick: int, acceleration: Vector | FloatArray) -> None:
        written = self.written
        self._slots[written % SLOTS] = tick, *acceleration
        self._counts[0] = written + 1  # last, as readers trust what it counts

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
        while (written := self.written) >= size:
            rows = self._slots[np.arange(written - size, written) % SLOTS]
            if self.written - (written - size) < SLOTS:
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

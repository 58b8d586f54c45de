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

"""Resampling of forces with due times to the samples of another clock."""

from __future__ import annotations

from bisect import insort

import numpy as np

from haptic_accel.core.model import FloatArray


class HeldForce:
    """Forces with due times, each held until the next is due.

    Each sample of the other clock is the mean force over its period. A step between two samples
    thus keeps its time to a fraction of a sample, and the impulse is preserved.

    Examples
    --------
    >>> held = HeldForce()
    >>> held.put(0.5, 2.0)
    >>> held.means(0.0, 1.0, 2)
    array([1., 2.])
    """

    def __init__(self) -> None:
        self._waiting: list[tuple[float, float]] = []
        self._held = 0.0

    def put(self, due: float, force: float) -> None:
        """Add a force in N with a due time in s; a late one acts at once."""
        insort(self._waiting, (due, force))

    def replace(self, force: float) -> None:
        """Apply a force in N at once, and discard those that are not due yet."""
        self._waiting.clear()
        self._held = force

    def means(self, start: float, rate: float, count: int) -> FloatArray:
        """Return the mean force of each sample, and discard forces that were due before their end.

        Parameters
        ----------
        start : float
            Start of the first sample, s; equal to the end of the last sample of the previous call.
        rate : float
            Samples per second.
        count : int

        Returns
        -------
        ndarray, shape (count,)
            N.
        """
        means = np.full(count, self._held)
        while self._waiting and self._waiting[0][0] < start + count / rate:
            due, force = self._waiting.pop(0)
            place = max(0.0, (due - start) * rate)
            first = int(place)
            # For the rest of that sample the new force acts.
            means[first : first + 1] += (force - self._held) * (first + 1 - place)
            means[first + 1 :] = force
            self._held = force
        return means

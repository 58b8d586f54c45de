# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force that is held from one due time to the next, on the grid of another clock."""

from __future__ import annotations

from bisect import insort

import numpy as np

from haptic_accel.core.model import FloatArray


class HeldForce:
    """Forces with due times, each held until the next is due.

    Each sample of the other clock gets the mean of the force over its own period, so that a step
    between two samples keeps its time to a fraction of one, and the impulse is kept.

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
        """Add a force in N that is due at a time in s; one that is late acts at once."""
        insort(self._waiting, (due, force))

    def replace(self, force: float) -> None:
        """Apply a force in N at once, and discard those that are not due yet."""
        self._waiting.clear()
        self._held = force

    def means(self, start: float, rate: float, count: int) -> FloatArray:
        """Return the mean force of each sample, and forget what was due before their end.

        Parameters
        ----------
        start : float
            Time at which the first sample begins, s: where the samples of the call before end.
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
            # Of that sample only the rest has the new force.
            means[first : first + 1] += (force - self._held) * (first + 1 - place)
            means[first + 1 :] = force
            self._held = force
        return means

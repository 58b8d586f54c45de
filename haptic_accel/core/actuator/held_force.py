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
    >>> held.means(np.array([0.0, 1.0, 2.0]))
    array([1., 2.])
    """

    def __init__(self) -> None:
        self._waiting: list[tuple[float, float]] = []
        self._held = 0.0

    def put(self, due: float, force: float) -> None:
        """Add a force in N that is due at a time in s; one that is late acts at once."""
        insort(self._waiting, (due, force))

    def replace(self, force: float) -> None:
        """Hold a force in N at once, and discard those that are not due yet."""
        self._waiting.clear()
        self._held = force

    def means(self, edges: FloatArray) -> FloatArray:
        """Return the mean force of each sample, and forget what was due before the last edge.

        Parameters
        ----------
        edges : ndarray, shape (n + 1,)
            Times at which the samples begin, and the last one ends, s; increasing, from the last
            edge of the call before.

        Returns
        -------
        ndarray, shape (n,)
            N.
        """
        start, end = float(edges[0]), float(edges[-1])
        times, forces = [start], [self._held]
        while self._waiting and self._waiting[0][0] < end:
            due, self._held = self._waiting.pop(0)
            times.append(max(due, start))
            forces.append(self._held)
        times.append(end)
        impulse = np.append(0.0, np.cumsum(np.diff(times) * forces))
        return np.asarray(np.diff(np.interp(edges, times, impulse)) / np.diff(edges))

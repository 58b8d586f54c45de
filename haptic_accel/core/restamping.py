# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Moves the stamps of signals that are played again to the time at which they are."""

from __future__ import annotations

from collections.abc import Callable

LISTENING = 100_000_000
"""Initial time in which arrivals are only compared, ns: the first one may be delayed."""


class StampShift:
    """Adds the same offset to all recorded stamps, so that they match the present time.

    Their spacing stays exactly as recorded, however unevenly they arrive: the offset is that of
    the fastest of the first arrivals. It is determined anew where stamps and arrivals drift apart,
    because a bag is played at another speed or in a loop.

    Parameters
    ----------
    grid : callable
        Function that returns the last point of the sampling grid up to a moment, both system time
        in ns: moved stamps lie on the grid that the other arm is sampled on.
    period : int
        Period of the grid, ns: maximum time by which a moved stamp may be ahead of its arrival.
    limit : int
        Maximum time by which it may be behind, ns.

    Attributes
    ----------
    anchored : int
        Number of times that the offset was determined; one in a playback at original speed.
    """

    def __init__(self, grid: Callable[[int], int], period: int, limit: int) -> None:
        self._grid = grid
        self._ahead = period
        self._behind = limit
        self._until: int | None = None
        self._quickest = 0
        self._offset: int | None = None
        self.anchored = 0

    def moved(self, stamp: int, now: int) -> int | None:
        """Return a stamp as if its sample had just been taken; None while only comparing.

        Parameters
        ----------
        stamp : int
            Recorded stamp, ns.
        now : int
            Time of arrival, system time, ns.
        """
        if self._offset is None:
            if self._until is None:
                self._until, self._quickest = now + LISTENING, now - stamp
            self._quickest = min(self._quickest, now - stamp)
            if now < self._until:
                return None
            self._anchor(stamp, self._quickest)
        elif not -self._ahead <= now - stamp - self._offset <= self._behind:
            self._anchor(stamp, now - stamp)
        assert self._offset is not None
        return stamp + self._offset

    def _anchor(self, stamp: int, distance: int) -> None:
        self._offset = self._grid(stamp + distance) - stamp
        self.anchored += 1

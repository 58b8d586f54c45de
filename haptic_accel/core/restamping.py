# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Moves the stamps of signals that are played again to the ticks at which they can be used."""

from __future__ import annotations

from collections.abc import Callable

LISTENING = 100_000_000
"""Time in which arrivals are compared, ns: initially, as the first may be delayed, and while all
come after their ticks."""

LEAD = 20_000_000
"""Time from the arrival of an undelayed sample until it is used, ns: a player pauses for longer
only on a busy machine. As no force acts on what is played, nobody feels it."""


class StampShift:
    """Adds the same offset to all recorded stamps, so that each is a tick still to come.

    Their spacing stays exactly as recorded, however unevenly they arrive: the offset is that of
    the fastest of the first arrivals. It is determined anew where stamps and arrivals drift apart,
    because a bag is played at another speed or in a loop, or its player stays behind.

    Parameters
    ----------
    grid : callable
        Function that returns the first point of the sampling grid from a moment on, both system
        time in ns: moved stamps lie on the grid that the other arm is sampled on.
    period : int
        Period of the grid, ns: maximum time by which a sample may be earlier than the fastest.
    limit : int
        Maximum time by which a moved stamp may be behind its arrival, ns.

    Attributes
    ----------
    anchored : int
        Number of times that the offset was determined; one in a playback at original speed.
    """

    def __init__(self, grid: Callable[[int], int], period: int, limit: int) -> None:
        self._grid = grid
        # The next point of the grid may be a period later.
        self._ahead = LEAD + 2 * period
        self._behind = limit
        self._until: int | None = None
        self._quickest = 0
        self._offset: int | None = None
        self.anchored = 0

    def moved(self, stamp: int, now: int) -> int | None:
        """Return the stamp of the tick that a sample belongs to; None while only comparing.

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
        elif now <= stamp + self._offset:
            self._until = None
        elif self._until is None:  # the first after its tick
            self._until, self._quickest = now + LISTENING, now - stamp
        else:
            self._quickest = min(self._quickest, now - stamp)
            if now >= self._until:
                self._anchor(stamp, self._quickest)
        assert self._offset is not None
        return stamp + self._offset

    def _anchor(self, stamp: int, distance: int) -> None:
        self._offset = self._grid(stamp + distance + LEAD) - stamp
        self._until = None
        self.anchored += 1

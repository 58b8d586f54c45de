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

"""Shift of the stamps of replayed signals to ticks at which they can be used."""

from __future__ import annotations

from collections.abc import Callable

LISTENING = 100_000_000
"""Time for which arrivals are compared, ns: at the start, as the first may be delayed, and while
all arrive after their ticks."""

LEAD = 20_000_000
"""Time from the arrival of an undelayed sample until it is used, ns. A player pauses for longer
only on a busy machine. Nobody feels it, as no force acts on replayed arms."""


class StampShift:
    """Constant offset for all recorded stamps that moves each to a future tick.

    Their spacing remains exactly as recorded, however unevenly they arrive. The offset is that of
    the fastest of the first arrivals. It is determined again if stamps and arrivals drift apart: a
    bag is played at another speed or in a loop, or its player is slow.

    Parameters
    ----------
    grid : callable
        Function from a time to the next point of the sampling grid, both system times in ns.
        Shifted stamps lie on the grid of the other arm's samples.
    period : int
        Period of the grid, ns: the maximum time by which a sample may be earlier than the fastest.
    limit : int
        Maximum delay of an arrival relative to its shifted stamp, ns.

    Attributes
    ----------
    anchored : int
        Number of times the offset was determined; one for a playback at original speed.
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
        """Return the shifted stamp of a sample; None during the comparison.

        Parameters
        ----------
        stamp : int
            Recorded stamp, ns.
        now : int
            Arrival time, system time, ns.
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

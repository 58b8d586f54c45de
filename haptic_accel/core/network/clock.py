# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Offset of a peer's clock from packets that echo each other.

Times are system times in ns, of which those of the two hosts need not agree.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from haptic_accel.core.sampling import NANOSECONDS

INTERVAL = NANOSECONDS
"""Time in which the exchange of least round trip is kept, ns."""

WINDOW = 120
"""Number of intervals to which a line is fitted."""

FEWEST = 10
"""Intervals from which on the drift is estimated; until then the exchange of least round trip
counts."""

SLACK = 1e-3
"""Deviation from the line, beyond what both round trips allow, above which a clock was set, s."""


class Exchange(NamedTuple):
    """Middle of an exchange by the own clock, ns; offset that it shows, and its round trip, s."""

    time: int
    offset: float
    round_trip: float


class ClockOffset:
    """Peer's clock minus the own one: a line through the best exchange of every second.

    The way there and back need not take equally long: the offset is known to half a round trip.

    Attributes
    ----------
    bound : float
        Half of the least round trip, and the distance of the line from its exchange, s; infinite
        before the first exchange.
    drift : float
        Change of the offset, s/s.

    Examples
    --------
    >>> clock = ClockOffset()
    >>> clock.add(sent=0, received=3_000_000, replied=4_000_000, arrived=2_000_000)
    >>> clock.offset(2_000_000), clock.bound
    (0.0025, 0.0005)
    """

    def __init__(self) -> None:
        self._exchanges: deque[Exchange] = deque(maxlen=WINDOW)
        self._interval: int | None = None
        self._restart()

    def add(self, sent: int, received: int, replied: int, arrived: int) -> None:
        """Take an exchange.

        Parameters
        ----------
        sent, arrived : int
            Own time of the packet's sending, and of the reply's arrival, ns.
        received, replied : int
            Peer's time of the packet's reception, and of the reply's sending, ns.
        """
        away, held = arrived - sent, replied - received
        if held < 0 or away <= held:  # a clock was set meanwhile
            return
        interval, round_trip = arrived // INTERVAL, (away - held) / NANOSECONDS
        new = interval != self._interval
        if not new and round_trip >= self._exchanges[-1].round_trip:
            return
        offset = ((received - sent) + (replied - arrived)) / 2 / NANOSECONDS
        found = Exchange((sent + arrived) // 2, offset, round_trip)
        if new:
            self._interval = interval
            self._close()
            self._exchanges.append(found)
        else:
            self._exchanges[-1] = found
        if len(self._exchanges) == 1:
            self._fit()

    def offset(self, now: int) -> float:
        """Return the offset at an own time in ns, s; 0 before the first exchange."""
        return self._offset + self.drift * (now - self._origin) / NANOSECONDS

    def _restart(self) -> None:
        self._exchanges.clear()
        self._origin, self._offset = 0, 0.0
        self.drift, self.bound = 0.0, math.inf

    def _close(self) -> None:
        """Fit the line to the intervals that are over; begin anew after a clock was set."""
        if self._exchanges and self._differs(last := self._exchanges[-1]):
            self._restart()
            self._exchanges.append(last)
        self._fit()

    def _differs(self, exchange: Exchange) -> bool:
        """Return whether an exchange can only be explained by a clock that was set."""
        difference = abs(exchange.offset - self.offset(exchange.time))
        return difference > exchange.round_trip / 2 + self.bound + SLACK

    def _fit(self) -> None:
        """Fit the line to the exchanges there are."""
        if not self._exchanges:
            return
        best = min(self._exchanges, key=lambda each: each.round_trip)
        self.bound = best.round_trip / 2
        self._origin, self._offset, self.drift = best.time, best.offset, 0.0
        if len(self._exchanges) < FEWEST:
            return
        # What holds up one way makes a round trip longer, and its exchange worse, by as much.
        weights = [each.round_trip**-2 for each in self._exchanges]
        times = [(each.time - best.time) / NANOSECONDS for each in self._exchanges]
        offsets = [each.offset for each in self._exchanges]
        middle, mean = _mean(times, weights), _mean(offsets, weights)
        spread = _mean([(time - middle) ** 2 for time in times], weights)
        products = [
            (time - middle) * (offset - mean) for time, offset in zip(times, offsets, strict=True)
        ]
        self.drift = _mean(products, weights) / spread
        self._offset = mean - self.drift * middle
        self.bound += abs(self._offset - best.offset)


def _mean(values: Sequence[float], weights: Sequence[float]) -> float:
    return sum(v * w for v, w in zip(values, weights, strict=True)) / sum(weights)

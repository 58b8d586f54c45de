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

"""Clock offset between two hosts, estimated from packets that echo each other.

Times are system times in ns. The system times of the two hosts may differ.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from haptic_accel.core.sampling import NANOSECONDS

INTERVAL = NANOSECONDS
"""Length of an interval, ns. The exchange with the shortest round trip in each is kept."""

FITTED_INTERVALS = 120
"""Number of intervals in the line fit."""

FEWEST = 10
"""Minimum number of intervals for a drift estimate. With fewer, the exchange with the shortest
round trip determines the offset."""

SLACK = 1e-3
"""Deviation from the line, beyond the uncertainty of both round trips, that indicates a clock
step, s."""


class Exchange(NamedTuple):
    """Exchange: local time at its middle, ns; measured offset and round trip, s."""

    time: int
    offset: float
    round_trip: float


class ClockOffset:
    """Peer's clock minus the local clock: a line through the best exchange of each second.

    The delays of the two directions may differ, so the offset is known to half a round trip.

    Attributes
    ----------
    bound : float
        Half of the shortest round trip plus the distance of the line from that exchange, s.
        Infinite before the first exchange.
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
        self._exchanges: deque[Exchange] = deque(maxlen=FITTED_INTERVALS)
        self._interval: int | None = None
        self._restart()

    def add(self, sent: int, received: int, replied: int, arrived: int) -> None:
        """Add an exchange.

        Parameters
        ----------
        sent, arrived : int
            Local times of the packet's transmission and of the reply's arrival, ns.
        received, replied : int
            Peer's times of the packet's reception and of the reply's transmission, ns.
        """
        away, held = arrived - sent, replied - received
        if held < 0 or away <= held:  # a clock was set during the exchange
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
        """Return the offset at a local time in ns, s; 0 before the first exchange."""
        return self._offset + self.drift * (now - self._origin) / NANOSECONDS

    def _restart(self) -> None:
        self._exchanges.clear()
        self._origin, self._offset = 0, 0.0
        self.drift, self.bound = 0.0, math.inf

    def _close(self) -> None:
        """Fit the line to the completed intervals; restart the estimate after a clock step."""
        if self._exchanges and self._differs(last := self._exchanges[-1]):
            self._restart()
            self._exchanges.append(last)
        self._fit()

    def _differs(self, exchange: Exchange) -> bool:
        """Return whether only a clock step can explain an exchange."""
        difference = abs(exchange.offset - self.offset(exchange.time))
        return difference > exchange.round_trip / 2 + self.bound + SLACK

    def _fit(self) -> None:
        """Fit the line to the available exchanges."""
        if not self._exchanges:
            return
        best = min(self._exchanges, key=lambda each: each.round_trip)
        self.bound = best.round_trip / 2
        self._origin, self._offset, self.drift = best.time, best.offset, 0.0
        if len(self._exchanges) < FEWEST:
            return
        # A delay in one direction lengthens the round trip, and the exchange's error, by its
        # duration.
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

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

"""Rate control of datagrams for a transport with a send queue."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 0.1
"""Window for the shortest round trip, s: jitter lengthens many round trips, a queue all of
them."""

REMEMBERED = 100
"""Number of windows whose shortest round trip counts as that of an empty queue: 10 s."""

LATE = 0.01
"""Round trip in excess of the shortest that indicates a queue, s."""

STEADY = 5
"""Number of windows without a queue before the rate is increased."""

SPARSEST = 16
"""Maximum decimation factor: each packet of the coupling contains the last 16 samples."""

LONGEST_GAP = 0.01
"""Maximum interval between datagrams, s: a tenth of the coupling's watchdog timeout."""


class Pace:
    """Decimation of datagrams that avoids a queue before the network.

    Congestion control interprets lost and overtaken datagrams as overload. With 5 % loss it passes
    some hundred per second; of a thousand, each waits for seconds. Each datagram contains the
    number of the newest one received from the peer. If the shortest round trip of a `WINDOW` grows
    by `LATE`, half of the datagrams are skipped, and more if that has no effect. It starts with a
    low rate, as a queue takes seconds to drain.

    Attributes
    ----------
    stride : int
        Decimation factor: number of datagrams of which one is sent.

    Examples
    --------
    >>> pace = Pace()
    >>> [pace.number(now) for now in (0.0, 0.001)]
    [1, None]
    """

    def __init__(self) -> None:
        self.stride = SPARSEST // 2
        self._given = self._numbered = self._calm = 0
        self._last = -math.inf
        self._sent: deque[tuple[int, float]] = deque(maxlen=4096)
        self._least, self._until = math.inf, -math.inf
        self._windows: deque[float] = deque(maxlen=REMEMBERED)

    def number(self, now: float) -> int | None:
        """Return the number of a datagram to send at a time, s; None to skip it."""
        self._given += 1
        if self._given % self.stride and now - self._last < LONGEST_GAP:
            return None
        self._last = now
        self._numbered += 1
        self._sent.append((self._numbered, now))
        return self._numbered

    def acknowledge(self, newest: int, now: float) -> None:
        """Process the number of the newest datagram that the peer received."""
        trip = math.inf
        while self._sent and self._sent[0][0] <= newest:
            trip = now - self._sent.popleft()[1]
        self._least = min(self._least, trip)
        if now >= self._until and math.isfinite(self._least):
            self._windows.append(self._least)
            self._follow(self._least - min(self._windows))
            self._least, self._until = math.inf, now + WINDOW

    def _follow(self, excess: float) -> None:
        """Reduce the rate while a queue exists; increase it after some time without one."""
        if excess > LATE:
            self.stride, self._calm = min(2 * self.stride, SPARSEST), 0
            return
        self._calm += 1
        if self._calm >= STEADY:
            self.stride, self._calm = max(1, self.stride - 1), 0

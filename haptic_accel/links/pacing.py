# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pace of datagrams through a transport that queues what the network does not take."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 0.1
"""Time of which the least round trip counts, s: jitter lengthens many trips, a queue every one."""

REMEMBERED = 100
"""Windows of which the least round trip is that of an empty queue: 10 s."""

LATE = 0.01
"""Round trip beyond the least from which a queue is taken to be there, s."""

STEADY = 5
"""Windows without a queue after which one more of so many datagrams is tried."""

SPARSEST = 16
"""Most datagrams of which one is sent: each packet of the coupling has the last 16 samples."""

LONGEST_GAP = 0.01
"""Time after which a datagram is sent in any case, s: a tenth of the coupling's watchdog."""


class Pace:
    """Leaves datagrams out, so that none waits in a queue before the network.

    A congestion control takes lost and overtaken datagrams for a sign that it sends too many.
    With 5 % loss it lets some hundred a second pass, and of a thousand each waits for seconds.
    Each datagram says the number of the newest that came the other way; where the least round trip
    of a `WINDOW` grows by `LATE`, half of the datagrams are left out, and more while that does not
    help. It begins with few, as a queue takes seconds to drain.

    Attributes
    ----------
    stride : int
        Datagrams of which one is sent.

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
        """Return the number of a datagram that is to be sent now, s; None to leave it out."""
        self._given += 1
        if self._given % self.stride and now - self._last < LONGEST_GAP:
            return None
        self._last = now
        self._numbered += 1
        self._sent.append((self._numbered, now))
        return self._numbered

    def heard(self, newest: int, now: float) -> None:
        """Take the number of the newest datagram that has come to the other end."""
        trip = math.inf
        while self._sent and self._sent[0][0] <= newest:
            trip = now - self._sent.popleft()[1]
        self._least = min(self._least, trip)
        if now >= self._until and math.isfinite(self._least):
            self._windows.append(self._least)
            self._follow(self._least - min(self._windows))
            self._least, self._until = math.inf, now + WINDOW

    def _follow(self, excess: float) -> None:
        """Send less while a queue is there, and more after some time without."""
        if excess > LATE:
            self.stride, self._calm = min(2 * self.stride, SPARSEST), 0
            return
        self._calm += 1
        if self._calm >= STEADY:
            self.stride, self._calm = max(1, self.stride - 1), 0

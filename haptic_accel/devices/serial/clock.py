"""When a sample was taken, by the host's clock: lines through the counts of a device.

A frame arrives some time after its first sample was taken, never before, and some much later than
others. What it tells of the device's clock is therefore looked at in blocks, of each of which
only the quickest frame counts; a line through the last blocks is the clock. The device stamps
samples when it comes to it, but takes them evenly: another line, of its clock against the count
of samples, says when. What remains is the shortest time that a frame takes, which nobody can see
from one side.
"""

from __future__ import annotations

from collections import deque

import numpy as np

MICROSECOND = 1e-6
"""Unit of a device's clock, s."""

BLOCK = 32
"""Frames of which the quickest counts."""

BLOCKS = 256
"""Through which a line goes: 8 s at 1000 frames per second, in which no crystal drifts."""

LEAST_BLOCKS = 32
"""With fewer, the rate is taken for nominal: jitter over a short time would make a large error."""

LARGEST_DRIFT = 1e-3
"""Share by which a rate may differ from its nominal value: crystals have 1e-4."""

IN_TIME = 0.95
"""Share of frames that are there when the delay is over."""

DELAY_STEP = 20e-6
"""By which the delay grows for a frame that came later, s; for others it shrinks by a twentieth of
that, and so comes to rest where `IN_TIME` of them are in time."""

LONGEST_DELAY = 1.0
"""Periods that the delay may be, besides the length of a frame: to wait for stragglers costs more
than to do without them."""

STRAGGLER = 0.5e-3
"""Lateness against the line beyond which a block tells of the link, not of the clock, s; as much
too early, it tells that the line is wrong."""

PATIENCE = 32
"""Blocks in a row that are late until the line counts as wrong."""


class Unwrapped:
    """A count that begins anew after `modulus`, as one that does not."""

    def __init__(self, modulus: int = 1 << 32) -> None:
        self._modulus = modulus
        self._last: int | None = None

    def add(self, count: int) -> int:
        """Return the whole count, nearest to the last one."""
        if self._last is None:
            self._last = count
        half = self._modulus // 2
        self._last += (count - self._last + half) % self._modulus - half
        return self._last


class Line:
    """A line through the last points, whose slope stays near a nominal one.

    Parameters
    ----------
    slope : float
        Nominal.
    """

    def __init__(self, slope: float) -> None:
        self._nominal = slope
        self._points: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self._start = 0.0, 0.0
        self.slope = slope

    def __bool__(self) -> bool:
        """Whether it has a point."""
        return bool(self._points)

    def at(self, x: float) -> float:
        """Return y on the line."""
        x_0, y_0 = self._start
        return y_0 + self.slope * (x - x_0)

    def distance(self, x: float, y: float) -> float:
        """Return by how much a point is above the line; 0 where there is none yet."""
        return y - self.at(x) if self else 0.0

    def add(self, x: float, y: float) -> None:
        """Take a point."""
        self._points.append((x, y))
        self._fit()

    def begin_anew(self) -> None:
        """Forget all points."""
        self._points.clear()

    def _fit(self) -> None:
        x_last, y_last = self._points[-1]
        # From the last point on, so that no digits are lost after hours.
        x, y = (np.array(self._points) - (x_last, y_last)).T
        x_mean, y_mean = float(x.mean()), float(y.mean())
        self.slope = self._nominal
        if len(self._points) >= LEAST_BLOCKS:
            spread = float(np.sum((x - x_mean) ** 2))
            slope = float(np.sum((x - x_mean) * (y - y_mean))) / spread
            low, high = (self._nominal * (1 + sign * LARGEST_DRIFT) for sign in (-1, 1))
            self.slope = min(max(slope, low), high)
        self._start = x_last + x_mean, y_last + y_mean


class SampleClock:
    """Tells when a device's samples were taken.

    Parameters
    ----------
    rate : float
        Samples per second, nominal.
    samples_per_frame : int

    Attributes
    ----------
    jumps : int
        How often the device's clock, or its count of samples, did not go on evenly.
    delay : float
        From when a frame's first sample was taken to when `IN_TIME` of all frames are there, s.
        Who takes samples as old gets them as evenly as they were taken.
    """

    def __init__(self, rate: float, samples_per_frame: int = 1) -> None:
        self._period = 1 / (rate * MICROSECOND)
        self._stamps = Line(self._period)
        self._host = Line(MICROSECOND)
        self._late_blocks = 0
        self._block: list[tuple[float, int, int, float]] = []
        self._quickest: tuple[float, int, int, float] | None = None
        self.jumps = 0
        self.delay = 0.0
        self._longest_delay = (samples_per_frame - 1 + LONGEST_DELAY) / rate

    @property
    def rate(self) -> float:
        """Samples per second, by the host's clock."""
        return 1 / (self._stamps.slope * self._host.slope)

    def add(self, index: int, clock: int, arrival: float) -> None:
        """Take what a frame tells.

        Parameters
        ----------
        index : int
            Count of its first sample, not beginning anew.
        clock : int
            When that was taken by the device's clock, us, not beginning anew.
        arrival : float
            When the frame was there, s of the host's clock.
        """
        told = (arrival - clock * MICROSECOND * self._tick, index, clock, arrival)
        self._block.append(told)
        if len(self._block) == BLOCK:
            self._take(min(self._block))
            self._block.clear()
            self._quickest = None
        elif not self._host and (self._quickest is None or told < self._quickest):
            self._quickest = told
        late = arrival - self.time(index) > self.delay
        self.delay += DELAY_STEP * (IN_TIME if late else IN_TIME - 1)
        self.delay = min(max(self.delay, 0.0), self._longest_delay)

    def time(self, index: int) -> float:
        """Return when a sample was taken, s of the host's clock.

        Before the first block is complete, by its quickest frame so far.
        """
        if self._host:
            return self._host.at(self._stamps.at(index))
        assert self._quickest, "no frame was added"
        _, first, _, arrival = self._quickest
        return arrival + (index - first) * self._period * MICROSECOND

    @property
    def _tick(self) -> float:
        """Seconds of the host in one of the device."""
        return self._host.slope / MICROSECOND

    def _take(self, quickest: tuple[float, int, int, float]) -> None:
        _, index, clock, arrival = quickest
        if abs(self._stamps.distance(index, clock)) > self._period / 2:
            self._stamps.begin_anew()
            self.jumps += 1
        self._stamps.add(index, clock)
        late = self._host.distance(clock, arrival)
        self._late_blocks = self._late_blocks + 1 if late > STRAGGLER else 0
        if 0 < self._late_blocks < PATIENCE:
            return
        if abs(late) > STRAGGLER:
            self._host.begin_anew()
            self._late_blocks = 0
            self.jumps += 1
        self._host.add(clock, arrival)

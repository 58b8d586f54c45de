"""Time when a sample was taken, by the host's clock: lines fitted to the counts of a device.

A frame arrives some time after its first sample was taken, never before, and some much later than
others. Of each block of frames only the quickest one counts; a line through the last blocks is
the device's clock. The device stamps samples with some jitter, but takes them evenly: another
line, of its clock against the count of samples, removes that. The shortest transport time of a
frame remains, which cannot be measured from one side.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from haptic_accel.devices.serial.protocol import CLOCKS

MICROSECOND = 1e-6
"""Unit of a device's clock, s."""

BLOCK = 32
"""Frames in a block, of which the quickest counts."""

BLOCKS = 256
"""Blocks that a line is fitted to: 8 s at 1000 frames per second, in which no crystal drifts."""

LEAST_BLOCKS = 32
"""Fewest blocks to fit a slope to: with fewer, jitter would make a large error."""

LARGEST_DRIFT = 1e-3
"""Largest relative difference of a rate from its nominal value: crystals have 1e-4."""

IN_TIME = 0.95
"""Share of frames that arrive within the delay."""

DELAY_STEP = 20e-6
"""Increase of the delay for a late frame, s; for others it shrinks by a twentieth of that, and so
settles where `IN_TIME` of them are in time."""

LONGEST_DELAY = 1.0
"""Longest delay besides the length of a frame, in periods: waiting for frames that come later
would add more latency than their samples are worth."""

STRAGGLER = 0.5e-3
"""Lateness against the line beyond which a block is ignored, s; a block as much too early shows
that the line is wrong."""

PATIENCE = 32
"""Late blocks in a row after which the line counts as wrong."""


def unwrapped(count: int, near: int) -> int:
    """Return the continuous count nearest to another from one that wraps around at `CLOCKS`."""
    return near + (count - near + CLOCKS // 2) % CLOCKS - CLOCKS // 2


class Line:
    """Line through the last points, with a slope near a nominal one.

    Parameters
    ----------
    slope : float
        Nominal slope.
    """

    def __init__(self, slope: float) -> None:
        self._nominal = slope
        self._points: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self._start = 0.0, 0.0
        self.slope = slope

    def __bool__(self) -> bool:
        """Return True if it has a point."""
        return bool(self._points)

    def at(self, x: float) -> float:
        """Return y on the line."""
        x_0, y_0 = self._start
        return y_0 + self.slope * (x - x_0)

    def distance(self, x: float, y: float) -> float:
        """Return the height of a point above the line; 0 without a line."""
        return y - self.at(x) if self else 0.0

    def add(self, x: float, y: float) -> None:
        """Add a point, and fit the line."""
        self._points.append((x, y))
        # Relative to the last point, so that no digits are lost after hours.
        points = np.array(self._points) - (x, y)
        x_mean, y_mean = points.mean(axis=0).tolist()
        self.slope = self._nominal
        if len(points) >= LEAST_BLOCKS:
            variance, covariance = np.cov(points, rowvar=False)[0].tolist()
            low, high = (self._nominal * (1 + sign * LARGEST_DRIFT) for sign in (-1, 1))
            self.slope = min(max(covariance / variance, low), high)
        self._start = x + x_mean, y + y_mean

    def clear(self) -> None:
        """Remove all points."""
        self._points.clear()


class SampleClock:
    """Clock of a device's samples.

    Parameters
    ----------
    rate : float
        Nominal sampling rate, Hz.
    samples_per_frame : int

    Attributes
    ----------
    delay : float
        Time from a frame's first sample until `IN_TIME` of all frames have arrived, s. Samples
        read at this age are as even as they were taken.
    """

    def __init__(self, rate: float, samples_per_frame: int = 1) -> None:
        self._period = 1 / (rate * MICROSECOND)
        self._stamps = Line(self._period)
        self._host = Line(MICROSECOND)
        self._late_blocks = 0
        self._block: list[tuple[float, int, int, float]] = []
        self.delay = 0.0
        self._longest_delay = (samples_per_frame - 1 + LONGEST_DELAY) / rate

    def add(self, index: int, clock: int, arrival: float) -> None:
        """Process the stamps of a frame.

        Parameters
        ----------
        index : int
            Continuous count of its first sample.
        clock : int
            Time of that sample by the device's clock, us, continuous.
        arrival : float
            Time of arrival by the host's clock, s.
        """
        # Seconds of the host per second of the device.
        tick = self._host.slope / MICROSECOND
        self._block.append((arrival - clock * MICROSECOND * tick, index, clock, arrival))
        if len(self._block) == BLOCK:
            self._take(min(self._block))
            self._block.clear()
        late = arrival - self.time(index) > self.delay
        self.delay += DELAY_STEP * (IN_TIME if late else IN_TIME - 1)
        self.delay = min(max(self.delay, 0.0), self._longest_delay)

    def time(self, index: int) -> float:
        """Return the time of a sample by the host's clock, s.

        Based on the quickest frame so far until the first block is complete.
        """
        if self._host:
            return self._host.at(self._stamps.at(index))
        _, first, _, arrival = min(self._block)
        return arrival + (index - first) * self._period * MICROSECOND

    def _take(self, quickest: tuple[float, int, int, float]) -> None:
        _, index, clock, arrival = quickest
        if abs(self._stamps.distance(index, clock)) > self._period / 2:
            self._stamps.clear()
        self._stamps.add(index, clock)
        late = self._host.distance(clock, arrival)
        self._late_blocks = self._late_blocks + 1 if late > STRAGGLER else 0
        if 0 < self._late_blocks < PATIENCE:
            return
        if abs(late) > STRAGGLER:
            self._host.clear()
            self._late_blocks = 0
        self._host.add(clock, arrival)

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

"""Conversion between the clocks of device and host by a line fit to frame arrivals.

Frames arrive after a varying transport time. In each block of frames only the fastest frame
counts; the line goes through the last blocks. The shortest transport time remains as an error, as
one side cannot measure it: stamps convert to times that are late by this error, and actions due by
the device's clock happen early by it.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from haptic_accel.devices.serial.protocol import CLOCKS

MICROSECOND = 1e-6
"""Unit of a device's clock, s."""

BLOCK = 32
"""Frames in a block, of which the fastest counts."""

BLOCKS = 256
"""Blocks that a line is fitted to: 8 s at 1000 frames per second, in which no crystal drifts."""

LEAST_BLOCKS = 32
"""Fewest blocks to fit a slope to: with fewer, jitter would make a large error."""

FIRST_BLOCKS = 4
"""Blocks for a line without a fitted slope: older blocks are wrong by the drift."""

LARGEST_DRIFT = 1e-3
"""Largest relative difference of a rate from its nominal value: crystals have 1e-4."""

STRAGGLER = 0.5e-3
"""Lateness against the line beyond which a block is ignored, s; equal earliness shows that the
line is wrong."""

LATE_BLOCKS = 32
"""Late blocks in a row after which the line counts as wrong."""


def unwrapped(count: int, near: int) -> int:
    """Return a count that wraps at `CLOCKS` as the continuous count nearest to `near`."""
    return near + (count - near + CLOCKS // 2) % CLOCKS - CLOCKS // 2


class Line(NamedTuple):
    """Line through a point.

    Attributes
    ----------
    clock : float
        Time by the device's clock, us.
    time : float
        The same time by the host's clock, s.
    slope : float
        Host's s per us of the device.
    """

    clock: float
    time: float
    slope: float


class DeviceClock:
    """Clock of a device; one thread may add frames while others convert times."""

    def __init__(self) -> None:
        self._line = Line(0.0, 0.0, MICROSECOND)
        self._points: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self._late_blocks = 0
        self._block: list[tuple[float, int, float]] = []

    @property
    def known(self) -> bool:
        """True after the first complete block; until then the fastest frame counts."""
        return bool(self._points)

    def add(self, clock: int, arrival: float) -> None:
        """Process the stamp of a frame.

        Parameters
        ----------
        clock : int
            Time of the stamp by the device's clock, us, continuous.
        arrival : float
            Time of arrival by the host's clock, s.
        """
        slope = self._line.slope
        self._block.append((arrival - clock * slope, clock, arrival))
        if self.known and len(self._block) < BLOCK:
            return
        _, stamp, arrived = min(self._block)
        if len(self._block) == BLOCK:
            self._block.clear()
            self._take(stamp, arrived)
        else:
            self._line = Line(stamp, arrived, slope)

    def time(self, clock: float) -> float:
        """Convert a device time, us, to the host's clock, s."""
        line = self._line
        return line.time + line.slope * (clock - line.clock)

    def device_time(self, time: float) -> float:
        """Convert a host time, s, to the device's clock, us, continuous."""
        line = self._line
        return line.clock + (time - line.time) / line.slope

    def device_duration(self, duration: float) -> float:
        """Convert a duration on the host's clock, s, to the device's clock, us."""
        return duration / self._line.slope

    def _take(self, clock: float, arrival: float) -> None:
        """Add a block's fastest frame to the line fit."""
        late = arrival - self.time(clock) if self.known else 0.0
        self._late_blocks = self._late_blocks + 1 if late > STRAGGLER else 0
        if 0 < self._late_blocks < LATE_BLOCKS:
            return
        if abs(late) > STRAGGLER:
            self._points.clear()
            self._late_blocks = 0
        self._points.append((clock, arrival))
        self._line = self._fitted()

    def _fitted(self) -> Line:
        # Relative to the last point, so that no digits are lost after hours.
        last = self._points[-1]
        points, slope = np.array(self._points) - last, MICROSECOND
        if len(points) < LEAST_BLOCKS:
            points = points[-FIRST_BLOCKS:]
        else:
            variance, covariance = np.cov(points, rowvar=False)[0].tolist()
            low, high = (MICROSECOND * (1 + sign * LARGEST_DRIFT) for sign in (-1, 1))
            # A clock that stands still has no slope.
            slope = min(max(covariance / variance, low), high) if variance else slope
        clock, time = points.mean(axis=0).tolist()
        return Line(last[0] + clock, last[1] + time, slope)

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

"""Hand that follows a sequence of points."""

from __future__ import annotations

import math

WORKSPACE = ((-0.15, 0.15), (-0.02, 0.08))
"""Workspace of the hand along the surface (x) and its normal (z), m. At 13 mm below the surface
the coupling's 250 N/m give the arms' maximum force."""

SPEED = 1.0
"""Maximum speed of the hand, m/s: ten strokes of 0.1 m per second."""

STEP = 1e-3
"""Maximum step over which the hand's acceleration is held, s."""

LAG = 7e-3
"""Time constant of each of the four lags behind the points, s. The total is 28 ms. At 60 Hz, a
usual rate of points, the lags attenuate each new point's correction to 1/64."""

CORRECTION, ACCELERATION = 0.6, 0.3
"""Gains of a point's deviation from its expected position, for the corrections of position and,
divided by the time between points, of velocity (alpha-beta filter)."""

EXPECTED = 0.05
"""Time after a point for which the motion is extrapolated, s: three frames of a screen."""


class GuidedHand:
    """Position and velocity of a hand that follows points smoothly.

    Between two points the motion is extrapolated with the last velocity, so that points at the
    rate of a screen cause no steps. Four lags keep the residual below the tactile band. The
    velocity is linear within a step, and the position is its exact integral.

    Parameters
    ----------
    height : float
        Height of the hand at rest, m.
    """

    def __init__(self, height: float) -> None:
        self._height = height
        self._rest()

    def _rest(self) -> None:
        self._time, self._pointed = 0.0, -math.inf
        self._axes = _Axis(0.0, *WORKSPACE[0]), _Axis(self._height, *WORKSPACE[1])

    def point(self, x: float, z: float) -> None:
        """Lead the hand to a point, m, or to the nearest one within `WORKSPACE`.

        A point that is not finite is ignored.
        """
        if math.isfinite(x) and math.isfinite(z):
            passed = max(STEP, self._time - self._pointed)
            self._pointed = self._time
            for axis, coordinate in zip(self._axes, (x, z), strict=True):
                axis.expect(coordinate, passed)

    def at(self, time: float) -> tuple[float, float, float, float]:
        """Return x, z in m and their velocities in m/s at a time in s, as for `Exploration`.

        Times must not decrease, except to 0, where the hand is at rest.
        """
        if time < self._time:
            self._rest()
        steps = math.ceil((time - self._time) / STEP - 1e-6)
        for left in range(steps, 0, -1):
            step = (time - self._time) / left
            going_on = self._time - self._pointed < EXPECTED
            for axis in self._axes:
                axis.advance(step, going_on)
            self._time += step
        self._time = time
        x, z = self._axes
        return x.position, z.position, x.velocity, z.velocity


class _Axis:
    """One axis of the hand."""

    def __init__(self, coordinate: float, low: float, high: float) -> None:
        self._low, self._high = low, high
        self.position, self.velocity = coordinate, 0.0
        self._goal, self._pace = coordinate, 0.0
        self._lags = [coordinate, coordinate]

    def expect(self, coordinate: float, passed: float) -> None:
        """Correct goal and velocity by a point, a time in s after the previous one."""
        if passed > EXPECTED:  # the point was released meanwhile
            passed, self._pace = EXPECTED, 0.0
        coordinate = min(self._high, max(self._low, coordinate))
        farthest = SPEED * passed
        deviation = min(farthest, max(-farthest, coordinate - self._goal))
        self._goal += CORRECTION * deviation
        pace = self._pace + ACCELERATION * deviation / passed
        self._pace = min(SPEED, max(-SPEED, pace))

    def advance(self, step: float, going_on: bool) -> None:
        """Move for a step in s."""
        if going_on:
            self._goal = min(self._high, max(self._low, self._goal + self._pace * step))
        ahead = self._goal
        for stage, lagging in enumerate(self._lags):
            ahead = self._lags[stage] = lagging + (ahead - lagging) * step / LAG
        # The last two lags as a second-order system, with constant acceleration over the step.
        acceleration = ((ahead - self.position) / LAG - 2 * self.velocity) / LAG
        self.position += (self.velocity + acceleration * step / 2) * step
        self.velocity += acceleration * step

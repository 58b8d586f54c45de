# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The hand that goes where it is led, point by point."""

from __future__ import annotations

import math

WORKSPACE = ((-0.15, 0.15), (-0.02, 0.08))
"""Reach of the hand along the surface (x) and its normal (z), m; 13 mm below the surface the
coupling's 250 N/m have the arms' largest force."""

SPEED = 1.0
"""Highest speed at which the hand follows, m/s: ten strokes of 0.1 m per second."""

STEP = 1e-3
"""Longest step for which the hand's acceleration is held, s."""

LAG = 7e-3
"""Time constant of each of the four lags behind the points, s. Together 28 ms; at 60 Hz, a usual
rate of points, they leave 1/64 of what each new point corrects."""

CORRECTION, ACCELERATION = 0.6, 0.3
"""Shares of a point's deviation from where it was expected that correct the expected position and,
divided by the time between points, velocity (alpha-beta filter)."""

EXPECTED = 0.05
"""Time after a point for which it is expected to go on, s: three pictures of a screen."""


class GuidedHand:
    """Position and velocity of a hand that follows points smoothly.

    Between two points the motion goes on at the velocity of the last ones, so that points at the
    rate of a screen make no steps, and four lags keep what remains below the tactile band. The
    velocity is linear within a step, and the position its exact integral.

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
        """Lead the hand to a point, m, or to that next to it within `WORKSPACE`.

        One that is not finite is ignored.
        """
        if math.isfinite(x) and math.isfinite(z):
            passed = max(STEP, self._time - self._pointed)
            self._pointed = self._time
            for axis, place in zip(self._axes, (x, z), strict=True):
                axis.expect(place, passed)

    def at(self, time: float) -> tuple[float, float, float, float]:
        """Return x, z in m and their velocities in m/s at a time in s, as for `Exploration`.

        Times do not go back, but to 0: there the hand rests.
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

    def __init__(self, place: float, low: float, high: float) -> None:
        self._low, self._high = low, high
        self.position, self.velocity = place, 0.0
        self._goal, self._pace = place, 0.0
        self._lags = [place, place]

    def expect(self, place: float, passed: float) -> None:
        """Correct the goal and its pace by a point, the time in s after the one before."""
        if passed > EXPECTED:  # it was let go meanwhile
            passed, self._pace = EXPECTED, 0.0
        place = min(self._high, max(self._low, place))
        farthest = SPEED * passed
        deviation = min(farthest, max(-farthest, place - self._goal))
        self._goal += CORRECTION * deviation
        pace = self._pace + ACCELERATION * deviation / passed
        self._pace = min(SPEED, max(-SPEED, pace))

    def advance(self, step: float, going_on: bool) -> None:
        """Move for a step in s."""
        if going_on:
            self._goal = min(self._high, max(self._low, self._goal + self._pace * step))
        ahead = self._goal
        for place, lagging in enumerate(self._lags):
            ahead = self._lags[place] = lagging + (ahead - lagging) * step / LAG
        # The last two lags as one of second order, whose acceleration is held for the step.
        acceleration = ((ahead - self.position) / LAG - 2 * self.velocity) / LAG
        self.position += (self.velocity + acceleration * step / 2) * step
        self.velocity += acceleration * step

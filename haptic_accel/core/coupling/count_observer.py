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
"""Observer of an arm's position between the counts of its encoders."""

from __future__ import annotations

from haptic_accel.core.model import ZERO, Vector

CORRECTION_TIME = 0.02
"""Time constant with which the observer returns to the measured position, s: several counts of 55
um at 10 mm/s, as in the vibration of a texture."""

STEP_MEMORY = 1.0
"""Time constant with which the largest step is forgotten, s: several reversals of a stroke."""

COARSEST = 1e-3
"""Step beyond which a position is no count, but has jumped, m: as for the simulated encoders."""

FINEST = 1e-6
"""Step below which a position counts as smooth, m: 0.3 mN through the paper's spring."""

_AXES = 0, 1, 2


class CountObserver:
    """Estimate an arm's position between the counts of its encoders, from its velocity.

    The estimate moves with the velocity and returns to the measured position in
    `CORRECTION_TIME`. It is never farther from it than the largest recent step between two samples
    that the velocity does not explain: a count for rounded positions, and nothing for smooth ones.
    So neither resolution nor geometry of the encoders must be known. After a jump the estimate
    starts anew. Where the velocity is late, the estimate is late by less; without velocity it is
    the measured position.

    Parameters
    ----------
    rate : float
        Samples per second.

    Examples
    --------
    >>> observer = CountObserver(1000.0)
    >>> observer.rounding((0.0, 0.0, 1e-3), (0.0, 0.0, 0.01))
    (0.0, 0.0, 0.0)
    """

    def __init__(self, rate: float) -> None:
        self._half = 0.5 / rate
        self._left = 1.0 - 1.0 / (1.0 + CORRECTION_TIME * rate)
        self._kept = 1.0 - 1.0 / (1.0 + STEP_MEMORY * rate)
        self.restart()

    def restart(self) -> None:
        """Forget the motion and the steps."""
        self._before: tuple[Vector, Vector] | None = None
        self._rounding, self._steps = [0.0] * 3, [0.0] * 3

    def rounding(self, position: Vector, velocity: Vector) -> Vector:
        """Return measured minus estimated position, m, for the next sample, in m and m/s."""
        before, self._before = self._before, (position, velocity)
        if before is None:
            return ZERO
        (was, speed_was), rounding, steps = before, self._rounding, self._steps
        # Comparisons, as calls of min, max and abs would take most of the time.
        for axis in _AXES:
            speed = velocity[axis]
            step = position[axis] - was[axis] - (speed + speed_was[axis]) * self._half
            if not -COARSEST < step < COARSEST:  # or no number
                self.restart()
                return ZERO
            size = step if step > 0.0 else -step
            largest = self._kept * steps[axis]
            steps[axis] = largest = largest if largest > size else size
            left = (rounding[axis] + step) * self._left if speed and largest > FINEST else 0.0
            left = left if left < largest else largest
            rounding[axis] = left if left > -largest else -largest
        x, y, z = rounding
        return x, y, z

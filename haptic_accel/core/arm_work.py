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

"""Work of an arm's motors, from applied forces and measured positions."""

from __future__ import annotations

import math
from collections import deque

from haptic_accel.core.model import ZERO, Vector

KEPT = 1000
"""Maximum number of force changes that wait for the next sample; beyond, the oldest ones are
merged."""


class ArmWork:
    """Cumulative sum of applied force times displacement, per axis.

    The work between two samples is the held force times the change of position. This is exact for
    a force that changes at samples only. For other changes (late, or set to zero by a watchdog)
    the displacement is divided assuming constant velocity. With an acceleration a and a period T
    the error is at most a T^2 / 8 times the change of force: 1 uJ for 1 N, 8 m/s^2 and 1 ms. A
    lost sample makes the period longer.

    The forces are those passed to the device, at the times they were passed. The delay of a
    device, and forces that it suppresses itself, are unknown here.

    Examples
    --------
    >>> work = ArmWork()
    >>> work.until(0.0, (0.0, 0.0, 0.0))
    (0.0, 0.0, 0.0)
    >>> work.apply(0.0, (2.0, 0.0, -1.0))
    >>> work.until(0.001, (0.5, 7.0, 0.25))
    (1.0, 0.0, -0.25)
    """

    def __init__(self) -> None:
        self._sum = ZERO
        self._time = -math.inf
        self._position: Vector | None = None
        self._force = ZERO
        self._changes: deque[tuple[float, Vector]] = deque(maxlen=KEPT)

    def apply(self, time: float, force: Vector) -> None:
        """Record that a force, N, is held from a time on, s; times must increase."""
        self._changes.append((time, force))

    def until(self, time: float, position: Vector) -> Vector:
        """Return the work up to a sample, J, per axis.

        Parameters
        ----------
        time : float
            Time of the sample, s; it may be before that of the last forces.
        position : tuple of float
            Position at the sample, m; one that is not finite counts as lost.
        """
        # One line per axis here and below, as a loop over them takes four times longer.
        x, y, z = position
        if not math.isfinite(x + y + z):
            return self._sum
        before, since = self._position, self._time
        f_x, f_y, f_z = self._mean_force(since, time)
        self._position, self._time = position, time
        if before is not None:
            (w_x, w_y, w_z), (b_x, b_y, b_z) = self._sum, before
            self._sum = w_x + f_x * (x - b_x), w_y + f_y * (y - b_y), w_z + f_z * (z - b_z)
        return self._sum

    def _mean_force(self, since: float, time: float) -> Vector:
        """Return the mean force between two times, and discard the forces before the second."""
        held, changes = self._force, self._changes
        x, y, z = held
        while changes and changes[0][0] <= time:
            moment, force = changes.popleft()
            left = (time - max(moment, since)) / (time - since) if time > since else 0.0
            if left:
                x += (force[0] - held[0]) * left
                y += (force[1] - held[1]) * left
                z += (force[2] - held[2]) * left
            held = force
        self._force = held
        return x, y, z

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

"""Interface of both sides of the virtual rig."""

from __future__ import annotations

import math
from typing import Protocol

from haptic_accel.core.model import Sample, Vector

LONGEST_ADVANCE = 0.1
"""Maximum time simulated in one call, s; the rig stands still for the rest of a longer stall."""

RESOLUTION = 10e-6
"""Maximum step of a rig's clock, s."""


def clock_step(rate: float) -> float:
    """Return the step of a rig's clock, s; a sampling period is a whole number of steps.

    As the clock counts steps, all periods have the same length, whenever the rig started.

    Examples
    --------
    >>> clock_step(1000.0), clock_step(150e3)
    (1e-05, 6.666666666666667e-06)
    """
    period = 1.0 / rate
    return period / max(1, math.ceil(period / RESOLUTION))


class Rig(Protocol):
    """One side of the virtual rig; times in s.

    The rig stands still until its first force: any arm force, even zero, or a non-zero actuator
    force. Until then all samples are equal, without noise. Later samples are thus independent of
    the waiting time. A released arm (see `Holding`) returns to its start, so that all engagements
    begin there.
    """

    def advance(self, time: float) -> None:
        """Integrate the physics until a time; a past time changes nothing."""

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N."""

    def apply_actuator_force(self, force: Vector) -> None:
        """Set the forces of the actuator's coils along x, y, z of the handle, N."""

    def release(self) -> None:
        """Set all forces to zero."""

    def counters(self) -> dict[str, int]:
        """Return counts of out-of-range values by name."""


class SampledRig:
    """Rig as a device, sampled exactly at the requested times, like a converter with a clock.

    Its time starts with the first read or write.

    Parameters
    ----------
    rig : Rig
    """

    late = 0
    """Number of forces that took effect after their due time."""

    _rig: Rig
    _elapsed = 0.0
    _origin: float | None = None

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @property
    def contact_force(self) -> Vector | None:
        """Force of the surface on the tool at the last sample, N; None if unknown."""
        return None

    def read(self, time: float) -> Sample:
        """Simulate until a time, s, and return the sample then."""
        self._advance(time)
        return self._rig.measure()

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        """Simulate until a time, s, then change the forces, N."""
        self._advance(time)
        if arm_force is not None:
            self._rig.apply_arm_force(arm_force)
        if actuator_force is not None:
            self._rig.apply_actuator_force(actuator_force)

    def _advance(self, time: float) -> None:
        if self._origin is None:
            self._origin = time - self._elapsed
        self._elapsed = time - self._origin
        self._rig.advance(self._elapsed)

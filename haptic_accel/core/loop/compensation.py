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

"""Compensation part of the loop: from samples of tool and handle to the actuator's force.

The force of a tick depends on the tool's sample of that tick and on the handle's sample of the
previous tick. The handle's sample of the same tick may not have arrived yet.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.control.loss_concealment import LossConcealment
from haptic_accel.core.model import IDENTITY, ZERO, Vector
from haptic_accel.core.orientation import from_base, is_turned
from haptic_accel.core.sampling import NANOSECONDS

SENDING_TIME = 0.5
"""Time reserved for sending a force to its device before it is due, in periods. The handle's
sample of the previous tick is awaited until then."""

LONGEST_BRIDGE = 0.02
"""Longest gap in the tool's samples that prediction fills, s. A longer prediction of texture is
useless, and the arms disengage soon after."""


class CompensatedSample(NamedTuple):
    """Result for a tool sample: stamp, ns, desired acceleration, m/s^2, and coils' forces, N."""

    stamp: int
    desired_acceleration: Vector
    actuator_force: Vector


class CompensationPart:
    """Compute one force for each sample of the tool, in order.

    Parameters
    ----------
    compensation : Compensation
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples.
    longest : int
        Maximum number of waiting samples of the handle: at least those of two successive ticks.

    Attributes
    ----------
    compensation : Compensation
    samples, lost, bridged, without : int
        Numbers of tool samples: received; lost; lost and predicted; used without the handle's
        sample.
    measured_across : bool
        True if the tool has measured an acceleration across the actuator's axis.
    orientation : tuple of float
        Newest orientation of the handle in its base frame, from whose axes those of the tool's
        samples are turned into the handle's.
    """

    def __init__(
        self, compensation: Compensation, rate: float, latency: int, longest: int = 2
    ) -> None:
        self.compensation = compensation
        self._period = NANOSECONDS / rate
        self._longest_wait = (max(1, latency) - SENDING_TIME) * self._period
        self._longest_bridge = LONGEST_BRIDGE * rate
        self._tool: deque[tuple[int, Vector]] = deque()
        self._handle: deque[tuple[int, Vector | None]] = deque(maxlen=longest)
        self._last: int | None = None
        self._axes = compensation.axes
        self._concealments = [LossConcealment() for _ in self._axes.names]
        self._stored = tuple(zip(self._axes.indices, self._concealments, strict=True))
        self.samples = self.lost = self.bridged = self.without = 0
        self.measured_across = False
        self.orientation = IDENTITY

    def put_tool(self, stamp: int, acceleration: Vector) -> None:
        """Add a sample of the tool, m/s^2, with its stamp in ns; stamps must increase."""
        if not self.measured_across and (acceleration[0] or acceleration[1]):
            self.measured_across = True
        if is_turned(self.orientation, acceleration):
            acceleration = from_base(self.orientation, acceleration)
        self._tool.append((stamp, acceleration))

    def put_count_force(self, force: Vector) -> None:
        """Set the arm's force due to rounding, N, in the base frame, due with the next forces."""
        if self.orientation != IDENTITY:
            force = from_base(self.orientation, force)
        each = self.compensation
        each.count_x, each.count_y, each.count_z = force

    def put_handle(self, stamp: int, acceleration: Vector | None) -> None:
        """Add a sample of the handle; None for a lost one."""
        self._handle.append((stamp, acceleration))

    @property
    def waiting(self) -> bool:
        """True while a sample of the tool waits for a sample of the handle."""
        return bool(self._tool)

    def clear(self) -> None:
        """Discard the waiting samples."""
        self._tool.clear()
        self._handle.clear()
        self._last = None

    def forces(self, now: int) -> Iterator[CompensatedSample]:
        """Yield the forces of all samples that are ready.

        After each force, and before the next one, the controller does part of its slow
        computations.

        Parameters
        ----------
        now : int
            Time on the clock of the stamps, ns.
        """
        while self._tool:
            stamp, tool = self._tool[0]
            found, handle = self._before(stamp)
            if not found and now - stamp < self._longest_wait:
                return
            self._tool.popleft()
            self._fill(stamp)
            self.without += handle is None and self.samples > 0  # no sample precedes the first
            self.samples += 1
            self._store(tool)
            yield CompensatedSample(stamp, *self.compensation.process(tool, handle))
            self.compensation.adapt()

    def _before(self, stamp: int) -> tuple[bool, Vector | None]:
        """Return True and the previous tick's handle sample (None if lost); False if awaited."""
        due = stamp - self._period
        while self._handle and self._handle[0][0] < due - self._period / 2:
            self._handle.popleft()
        if not self._handle:
            return False, None
        received, acceleration = self._handle[0]
        return True, acceleration if received < due + self._period / 2 else None

    def _fill(self, stamp: int) -> None:
        """Pass predictions of lost samples to the filters, which thus miss no sample."""
        last, self._last = self._last, stamp
        lost = 0 if last is None else round((stamp - last) / self._period) - 1
        self.lost += lost
        if 0 < lost <= self._longest_bridge:
            self.bridged += lost
            for predicted in zip(
                *(each.predict(lost) for each in self._concealments), strict=True
            ):
                self.compensation.process(self._axes.vector(predicted), None)

    def _store(self, tool: Vector) -> None:
        """Store a sample for predictions; one with an axis that is not finite counts as zero."""
        if len(self._stored) > 1 and not math.isfinite(sum(tool)):
            tool = ZERO
        for index, concealment in self._stored:
            concealment.put(tool[index])

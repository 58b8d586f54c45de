# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compensation as a part of the loop: from the samples of tool and handle to the actuator's force.

The force of a tick is caused by the tool's sample of that tick and the handle's of the tick
before: the handle's own sample may not have been received yet.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from haptic_accel.core.control.bridging import Bridge
from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.sampling import NANOSECONDS

SENDING_TIME = 0.5
"""Time kept for the way of a force to its device, periods before it is due: so long the handle's
sample of the tick before is waited for."""

LONGEST_BRIDGE = 0.02
"""Longest gap in the tool's samples that is bridged by prediction, s; texture is not known any
longer ahead, and arms let go soon after."""


class Caused(NamedTuple):
    """Stamp of a tool's sample, ns, desired acceleration, m/s^2, and actuator force, N."""

    stamp: int
    desired_acceleration: float
    actuator_force: float


class CompensationPart:
    """Computes one force for each sample of the tool, in order.

    Parameters
    ----------
    compensation : Compensation
    rate : float
        Samples per second.
    latency : int
        Samples from the one that causes a force to the tick at which the force is due.
    longest : int
        Most samples of the handle that wait: those of a tick and the one before, or more.

    Attributes
    ----------
    samples, lost, bridged, without : int
        Samples of the tool that were received; that were lost; of these, predicted; that were
        received and used without the handle's sample.
    """

    def __init__(
        self, compensation: Compensation, rate: float, latency: int, longest: int = 2
    ) -> None:
        self._compensation = compensation
        self._period = NANOSECONDS / rate
        self._longest_wait = (max(1, latency) - SENDING_TIME) * self._period
        self._longest_bridge = LONGEST_BRIDGE * rate
        self._tool: deque[tuple[int, float]] = deque()
        self._handle: deque[tuple[int, float | None]] = deque(maxlen=longest)
        self._last: int | None = None
        self._bridge = Bridge()
        self.samples = self.lost = self.bridged = self.without = 0

    def put_tool(self, stamp: int, acceleration: float) -> None:
        """Take a sample of the tool, m/s^2, with its stamp in ns, in order."""
        self._tool.append((stamp, acceleration))

    def put_handle(self, stamp: int, acceleration: float | None) -> None:
        """Take a sample of the handle; None for one that is lost."""
        self._handle.append((stamp, acceleration))

    @property
    def waiting(self) -> bool:
        """True while a sample of the tool waits for one of the handle."""
        return bool(self._tool)

    def clear(self) -> None:
        """Forget the samples that wait."""
        self._tool.clear()
        self._handle.clear()
        self._last = None

    def forces(self, now: int) -> Iterator[Caused]:
        """Yield the forces of all samples that need not wait any longer.

        The controller does a piece of its slow work after each, before the next is computed.

        Parameters
        ----------
        now : int
            Time by the clock of the stamps, ns.
        """
        while self._tool:
            stamp, tool = self._tool[0]
            found, handle = self._before(stamp)
            if not found and now - stamp < self._longest_wait:
                return
            self._tool.popleft()
            self._fill(stamp)
            self.without += handle is None and self.samples > 0  # the first has none before it
            self.samples += 1
            self._bridge.put(tool)
            yield Caused(stamp, *self._compensation.sample(tool, handle))
            self._compensation.adapt()

    def _before(self, stamp: int) -> tuple[bool, float | None]:
        """Return whether the handle's acceleration of the tick before is known or lost, and it."""
        wanted = stamp - self._period
        while self._handle and self._handle[0][0] < wanted - self._period / 2:
            self._handle.popleft()
        if not self._handle:
            return False, None
        received, acceleration = self._handle[0]
        return True, acceleration if received < wanted + self._period / 2 else None

    def _fill(self, stamp: int) -> None:
        """Pass predictions of lost samples to the filters, which keep their place in time."""
        last, self._last = self._last, stamp
        lost = 0 if last is None else round((stamp - last) / self._period) - 1
        self.lost += lost
        if 0 < lost <= self._longest_bridge:
            self.bridged += lost
            for predicted in self._bridge.predict(lost):
                self._compensation.sample(predicted, None)

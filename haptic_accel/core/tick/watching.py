# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trace of samples for supervision and learning."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from haptic_accel.core.model import FloatArray

DESIRED, MEASURED, FORCE, DRIVE = range(4)
"""Rows of the signals of a trace."""

NEVER_LIMITED: int = -1 << 40
"""Value of `Trace.limited` while no limit has acted: long before the first sample."""


class Trace:
    """Latest samples of one coil or controller, for computations that do not run in every sample.

    These computations read blocks at intervals, see `core.control.estimation`.

    Attributes
    ----------
    count : int
        Number of samples since the start.
    stored : int
        Number of samples in the signals.
    signals : list of ndarray, shape (n,)
        Signals by `DESIRED`, `MEASURED`, `FORCE` and `DRIVE`, oldest first: desired acceleration,
        m/s^2; acceleration of the handle, m/s^2, which repeats the last value while unknown; force
        that drives the handle, N; input of the controller's convolution, m/s^2, or force that the
        controller requested, N.
    kept : int
        Minimum number of samples that remain stored; readers may increase it.
    missing, saturated : list of float
        Counts at samples without a measurement, and at samples beyond the sensor's range.
    limited : int
        Count at the last sample at which a limit of the actuator acted.
    """

    def __init__(self) -> None:
        import numpy as np

        self.count = self.stored = 0
        self.kept = self.full = 1
        self.limited: int = NEVER_LIMITED
        self.latest: float = 0.0
        self.missing: list[float] = []
        self.saturated: list[float] = []
        self.signals: Any = [np.zeros(1) for _ in range(4)]
        self._trim(0)

    def reset(self) -> None:
        """Discard all samples."""
        self.count, self.limited, self.latest = 0, NEVER_LIMITED, 0.0
        self._trim(0)

    def push(self, desired: float, measured: float, force: float, drive: float) -> None:
        """Add a sample; `measured` is NaN if missing, infinite if its sensor was saturated."""
        if math.isfinite(measured):
            self.latest = measured
        elif math.isnan(measured):
            self.missing.append(self.count)
        else:
            self.saturated.append(self.count)
        at: int = self.stored
        self.desired[at] = desired
        self.measured[at] = self.latest
        self.force[at] = force
        self.drive[at] = drive
        self.stored = at + 1
        self.count += 1
        if self.count >= self.full:
            self._trim(self.kept)

    def _trim(self, kept: int) -> None:
        """Discard all but the latest samples, and allocate memory for as many as must remain."""
        import numpy as np

        stored, before = min(self.stored, kept), self.signals
        if len(before[DESIRED]) < stored + self.kept:
            self.signals = [np.zeros(2 * self.kept) for _ in before]
        for old, new in zip(before, self.signals, strict=True):
            new[:stored] = old[self.stored - stored : self.stored]
        self.desired: FloatArray = self.signals[DESIRED]
        self.measured: FloatArray = self.signals[MEASURED]
        self.force: FloatArray = self.signals[FORCE]
        self.drive: FloatArray = self.signals[DRIVE]
        # The number of gaps cannot exceed the number of remaining samples.
        for each in (self.missing, self.saturated):
            del each[: max(0, len(each) - kept)]
        self.stored, self.full = stored, self.count + self.kept

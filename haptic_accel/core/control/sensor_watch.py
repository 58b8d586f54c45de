# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of a broken accelerometer or cable from the samples themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from haptic_accel.core.control.response_estimation import latest
from haptic_accel.core.outliers import LARGEST_SHARE, outliers
from haptic_accel.core.tick.watching import DESIRED, FORCE, MEASURED, Trace

PERIOD = 0.5
"""Time between two checks, s."""

SEARCHED = 512
"""Number of latest samples that are searched for spikes and for changes."""

UNUSABLE_SHARE = 0.1
"""Fraction of unusable samples above which a warning is reported; a busy computer loses fewer
(assumed)."""


class SensorWatch:
    """Check of the accelerometers of tool and handle, once per `PERIOD`.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    traces : sequence of Trace
        Samples of each coil.

    Attributes
    ----------
    warning : str
        Accelerometer and its defect; empty if none is detected.
    """

    def __init__(self, rate: float, traces: Sequence[Trace]) -> None:
        self._period, self._traces, self._unusable = round(PERIOD * rate), traces, [0, 0]
        for trace in traces:
            trace.kept = max(trace.kept, SEARCHED)
        self.reset()

    def reset(self) -> None:
        """Discard the results; the counts of unusable samples continue."""
        self._count, self.warning = 0, ""

    def update(self, tool: int, handle: int) -> int:
        """Check the sensors if this is due; return the number of samples to the next check.

        Parameters
        ----------
        tool, handle : int
            Number of missing, saturated and non-numeric samples of each accelerometer since the
            start.
        """
        passed = self._traces[0].count - self._count
        if passed < self._period:
            return self._period - passed
        self.warning = ""
        for name, row, unusable in (("tool", DESIRED, tool), ("handle", MEASURED, handle)):
            share = (unusable - self._unusable[row]) / passed
            self._unusable[row] = unusable
            self.warning = self.warning or self._defect(name, row, share)
        self._count += passed
        return self._period

    def _defect(self, name: str, row: int, unusable: float) -> str:
        """Return the defect of an accelerometer; empty if there is none."""
        signals = [latest(trace, row, SEARCHED) for trace in self._traces]
        is_still = row == MEASURED and not np.any(np.ptp(signals, axis=1))
        if is_still and any(latest(trace, FORCE, SEARCHED).any() for trace in self._traces):
            return f"the {name}'s accelerometer does not change while a force acts"
        if unusable >= UNUSABLE_SHARE:
            return f"{unusable:.0%} of the {name}'s samples are missing, saturated or not numbers"
        spikes = max(np.mean(outliers(signal)) for signal in signals)
        if spikes > LARGEST_SHARE:
            return f"{spikes:.0%} of the {name}'s samples are spikes, as from a broken connection"
        return ""

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Statistics of durations, and a trace of samples, for supervision and learning."""

from __future__ import annotations

import math
from bisect import bisect_left
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from haptic_accel.core.tick.kernels import UNKNOWN

if TYPE_CHECKING:
    from haptic_accel.core.model import FloatArray

SHORTEST: float = 1.0e-6
"""Lower limit, s; shorter durations share a bin."""

LONGEST_DURATION: float = 100.0
"""Approximate upper limit, s; longer durations share a bin."""

QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p99_9": 0.999}
"""Reported quantiles by label; the maximum is reported as ``max``."""

_BINS_PER_NEPER: float = 1.0 / math.log(1.01)  # each bin is 1 % wider than the previous one
_BINS: int = math.ceil(math.log(LONGEST_DURATION / SHORTEST) * _BINS_PER_NEPER)
_OFFSET: float = 1.0 - math.log(SHORTEST) * _BINS_PER_NEPER  # bin 0: below the lower limit
_HIGHEST_EDGE: float = SHORTEST * math.exp(_BINS / _BINS_PER_NEPER)


class DurationHistogram:
    """Histogram of durations in logarithmic bins, with quantiles accurate to 1 %.

    It has about 1850 bins from 1 us to 100 s, and one each for shorter and longer durations.
    Adding takes a fraction of a microsecond, and the memory is constant. One thread may add while
    another reads; the reader then sees part of an addition.

    Attributes
    ----------
    maximum : float
        The longest duration, s, exactly; NaN if there is none.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Remove all durations."""
        self._counts: list[int] = [0] * (_BINS + 2)
        self.maximum: float = UNKNOWN

    def add(self, seconds: float) -> None:
        """Add a duration.

        Parameters
        ----------
        seconds : float
            Duration, s. Zero and negative ones (after a clock was set back) count as shorter than
            `SHORTEST`, infinity as longer than `LONGEST_DURATION`.

        Raises
        ------
        ValueError
            The duration is NaN.
        """
        if SHORTEST <= seconds < _HIGHEST_EDGE:
            index: int = int(math.log(seconds) * _BINS_PER_NEPER + _OFFSET)
            self._counts[index] += 1
        elif seconds < SHORTEST:
            self._counts[0] += 1
        elif seconds >= _HIGHEST_EDGE:
            self._counts[_BINS + 1] += 1
        else:
            raise ValueError(f"seconds = {seconds}: must be a number")
        if not seconds <= self.maximum:  # NaN at first
            self.maximum = seconds

    @property
    def count(self) -> int:
        """Number of durations added since the last reset."""
        return sum(self._counts)

    def summary(self) -> dict[str, float]:
        """Return the reported quantiles and the maximum by label, s; NaN without durations."""
        found = {label: self.quantile(q) for label, q in QUANTILES.items()}
        return {**found, "max": self.maximum}

    def diagnostics(self, name: str) -> dict[str, str]:
        """Return the summary for diagnostics, in us; empty without durations."""
        if not self.count:
            return {}
        found = self.summary().items()
        return {f"{name} {label} (us)": f"{value * 1e6:.1f}" for label, value in found}

    def quantile(self, q: float) -> float:
        """Return the duration that a fraction of all durations does not exceed.

        Parameters
        ----------
        q : float
            Fraction, 0 to 1: 0.99 for the 99th percentile.

        Returns
        -------
        float
            Smallest duration, s, with at least ``q * count`` durations up to it, within 1 %.
            `SHORTEST` if it is below `SHORTEST`, the maximum if it is above `LONGEST_DURATION`,
            NaN without durations.

        Raises
        ------
        ValueError
            `q` is not from 0 to 1.
        """
        if not 0.0 <= q <= 1.0:
            raise ValueError(f"q = {q}: must be from 0 to 1")
        reached = list(accumulate(self._counts))
        total = reached[_BINS + 1]
        if total == 0:
            return math.nan
        rank = max(math.ceil(q * total), 1)
        if rank == total:
            return self.maximum
        return min(_centre(bisect_left(reached, rank)), self.maximum)


def _centre(index: int) -> float:
    """Return the geometric centre of a bin; for an open bin at the ends, its edge."""
    if index == 0:
        return SHORTEST
    if index > _BINS:
        return math.inf
    return math.exp((index + 0.5 - _OFFSET) / _BINS_PER_NEPER)


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

        self.stored = 0
        self.kept = self.full = 1
        self.missing: list[float] = []
        self.saturated: list[float] = []
        self.signals: Any = [np.zeros(1) for _ in range(4)]
        self.reset()

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

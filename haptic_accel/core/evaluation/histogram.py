# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Statistics of durations in memory that does not grow."""

from __future__ import annotations

import math
from bisect import bisect_left
from itertools import accumulate

SHORTEST = 1.0e-6
"""Durations below this, s, are counted together."""

LONGEST = 100.0
"""Durations from about this, s, are counted together."""

QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p99_9": 0.999}
"""Reported quantiles by label; the maximum is added as ``max``."""

_BINS_PER_NEPER = 1.0 / math.log(1.01)  # each bin is 1 % wider than the one before
_BINS = math.ceil(math.log(LONGEST / SHORTEST) * _BINS_PER_NEPER)
_OFFSET = 1.0 - math.log(SHORTEST) * _BINS_PER_NEPER  # bin 0 is for what is too short
_HIGHEST_EDGE = SHORTEST * math.exp(_BINS / _BINS_PER_NEPER)

# The name is looked up for every sample.
_log = math.log


class DurationHistogram:
    """Counts durations in logarithmic bins, for quantiles right within 1 %.

    About 1850 bins from 1 us to 100 s, and one each for what is shorter and longer. Adding
    costs a fraction of a microsecond and the memory stays the same, however many there are.
    One thread adds; another may read, and then sees some of what is being added.

    Attributes
    ----------
    maximum : float
        The longest duration, s, exactly; NaN while there is none.
    """

    __slots__ = ("_counts", "maximum")

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._counts = [0] * (_BINS + 2)
        self.maximum = math.nan

    def add(self, seconds: float) -> None:
        """Count one duration.

        Parameters
        ----------
        seconds : float
            The duration, s. Zero and negative ones (a clock set back) count as shorter than
            `SHORTEST`, infinity as longer than `LONGEST`.

        Raises
        ------
        ValueError
            NaN.
        """
        if SHORTEST <= seconds < _HIGHEST_EDGE:
            self._counts[int(_log(seconds) * _BINS_PER_NEPER + _OFFSET)] += 1
        elif seconds < SHORTEST:
            self._counts[0] += 1
        elif seconds >= _HIGHEST_EDGE:
            self._counts[-1] += 1
        else:
            raise ValueError(f"seconds = {seconds}: must be a number")
        if not seconds <= self.maximum:  # which is NaN at first
            self.maximum = seconds

    @property
    def count(self) -> int:
        """Number of durations added since the last reset."""
        return sum(self._counts)

    def summary(self) -> dict[str, float]:
        """Return the reported quantiles and the maximum by label, s; NaN while there are none."""
        reached = list(accumulate(self._counts))
        found = {label: self._quantile(reached, q) for label, q in QUANTILES.items()}
        return {**found, "max": self.maximum}

    def status(self, name: str) -> dict[str, str]:
        """Return the summary for diagnostics, in us; nothing while there are no durations."""
        if not self.count:
            return {}
        found = self.summary().items()
        return {f"{name} {label} (us)": f"{value * 1e6:.1f}" for label, value in found}

    def quantile(self, q: float) -> float:
        """Return the duration that a share of all durations does not exceed.

        Parameters
        ----------
        q : float
            The share, 0 to 1: 0.99 for the 99th percentile.

        Returns
        -------
        float
            The smallest duration, s, with at least ``q * count`` durations up to it, within
            1 %. `SHORTEST` or less if that one was shorter than `SHORTEST`; the maximum if it
            was longer than `LONGEST`; NaN while there is none.

        Raises
        ------
        ValueError
            `q` is not from 0 to 1.
        """
        if not 0.0 <= q <= 1.0:
            raise ValueError(f"q = {q}: must be from 0 to 1")
        return self._quantile(list(accumulate(self._counts)), q)

    def _quantile(self, reached: list[int], q: float) -> float:
        """Return a quantile from the numbers of durations up to each bin."""
        total = reached[-1]
        if total == 0:
            return math.nan
        rank = max(math.ceil(q * total), 1)
        if rank == total:
            return self.maximum
        return min(_centre(bisect_left(reached, rank)), self.maximum)


def _centre(index: int) -> float:
    """Geometric middle of a bin; the edges of the open bins at both ends."""
    if index == 0:
        return SHORTEST
    if index > _BINS:
        return math.inf
    return math.exp((index + 0.5 - _OFFSET) / _BINS_PER_NEPER)

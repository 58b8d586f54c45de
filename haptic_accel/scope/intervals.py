# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measures of the signals in an interval of time, such as a stimulus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.fallback import LEAST_DESIRED
from haptic_accel.core.control.filters import comparable
from haptic_accel.core.evaluation.metrics import evaluate, lengths
from haptic_accel.core.model import FloatArray
from haptic_accel.core.sampling import NANOSECONDS, IntArray, grid_indices
from haptic_accel.core.tick.device_side import LATE_TIME
from haptic_accel.scope.windows import Windows, paired

INTERVAL_MARGIN = 0.25
"""Time before and after an interval that is filtered together with it, s: a period of the filter's
corner frequency (5 Hz), to remove the hand's motion from short intervals, too."""

AT_LIMIT = 0.999
"""Fraction of the peak force from which a force counts as limited."""


@dataclass(frozen=True)
class IntervalMeasures:
    """Measures of the signals in an interval; for several axes, of the vectors' magnitudes.

    Attributes
    ----------
    begin, end : int
        System times of the first and last sample, ns.
    rms, peak : float
        RMS and peak of the handle's acceleration without hand motion, m/s^2.
    desired_rms : float
        RMS of the desired acceleration, m/s^2.
    error : float or None
        NRMSE, with the handle shifted by latency and granted delay, %; None below `LEAST_DESIRED`.
    clipped, lost : float
        Shares of forces at the limit of a coil, and of missing samples, %.
    """

    begin: int
    end: int
    rms: float
    peak: float
    desired_rms: float
    error: float | None
    clipped: float
    lost: float


def measure(windows: Windows, begin: int, end: int, rate: float) -> IntervalMeasures | None:
    """Return the measures of an interval; None without samples.

    Parameters
    ----------
    windows : Windows
        Signals from `INTERVAL_MARGIN` before the interval to `INTERVAL_MARGIN` after it.
    begin, end : int
        System times, ns.
    rate : float
        Samples per second.
    """
    settings, margin = windows.settings, round(INTERVAL_MARGIN * NANOSECONDS)
    stamps, handle = _signal(windows, "handle", begin - margin, end + margin)
    desired_stamps, desired_values = _signal(windows, "desired", begin - margin, end + margin)
    _, forces = _signal(windows, "force", begin, end)
    handle_indices = np.arange(float(len(stamps)))
    shift = settings.after
    desired, found = paired(desired_stamps, desired_values, stamps, handle_indices, shift, rate)
    index = found.astype(int)
    moments = stamps[index]
    within = (moments >= begin) & (moments <= end)
    if np.count_nonzero(within) < 2:
        return None
    strength = _rms(lengths(desired[within]))
    compared, actual = comparable(desired, handle[index], settings.high_pass_frequency, rate)
    compared, actual, moments = compared[within], actual[within], moments[within]
    evaluated = strength >= LEAST_DESIRED
    error = evaluate(compared, actual, rate, delay=0.0).nrmse_percent if evaluated else None
    largest = np.abs(forces).reshape(len(forces), -1).max(axis=1, initial=0.0)
    limited = largest >= AT_LIMIT * settings.actuator.peak_force
    return IntervalMeasures(
        begin=int(moments[0]),
        end=int(moments[-1]),
        rms=_rms(lengths(actual)),
        peak=float(lengths(actual).max()),
        desired_rms=strength,
        error=error,
        clipped=100.0 * float(np.mean(limited)) if len(limited) else 0.0,
        lost=max(lost_percent(each, begin, end, rate) for each in (stamps, desired_stamps)),
    )


def lost_percent(stamps: IntArray, begin: int, end: int, rate: float) -> float:
    """Return the share of missing samples between two times in ns, %.

    Examples
    --------
    >>> stamps = np.delete(np.arange(0, 100_000_000, 1_000_000), [7, 8])
    >>> lost_percent(stamps, 0, 99_000_000, 1000.0)
    2.0
    """
    within = stamps[(stamps >= begin) & (stamps <= end)]
    expected = 1 + int((end - begin) * rate / NANOSECONDS)
    found = len(np.unique(grid_indices(within, begin, rate))) if len(within) else 0
    return 100.0 * max(0, expected - found) / expected


def late_percent(before: Mapping[str, str], after: Mapping[str, str], rate: float) -> float:
    """Return the share of time with a late force of the actuator between two counts, %.

    Parameters
    ----------
    before, after : mapping
        Counts of a device, by their names in diagnostics.
    rate : float
        Samples per second.

    Examples
    --------
    >>> names = "actuator force due", "actuator force late (s)"
    >>> before, after = (dict(zip(names, them)) for them in (("0", "0.0"), ("2000", "0.02")))
    >>> late_percent(before, after, 1000.0)
    1.0
    """
    names = "actuator force due", f"actuator force {LATE_TIME}"
    due, late = (float(after.get(name, 0)) - float(before.get(name, 0)) for name in names)
    return min(100.0, 100.0 * late * rate / due) if due > 0 else 0.0


def _signal(windows: Windows, name: str, begin: int, end: int) -> tuple[IntArray, FloatArray]:
    """Return stamps and values of a signal; a column for each of several axes."""
    columns = []
    for each in windows.by_axis.values():
        _, stamps, values = getattr(each, name).since(0)
        first, last = np.searchsorted(stamps, (begin, end))
        columns.append((stamps[first:last], values[first:last]))
    if len(columns) == 1:
        return columns[0]
    shortest = min(len(stamps) for stamps, _ in columns)
    together = np.column_stack([values[:shortest] for _, values in columns])
    return columns[0][0][:shortest], together


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))

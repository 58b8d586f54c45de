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

"""Sampling rate in a column of times, and contradictions between them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.resampling import RATE_TOLERANCE, checked_rate
from haptic_accel.core.warning import warn_once
from haptic_accel.materials.columns import TIME

TOLERANCE = 1e-3
"""Maximum relative difference between the stated rate and that of the times: stamps of a second
in whole milliseconds are as exact."""

USUAL_SHARE = 0.9
"""Minimum fraction of steps within half of the median step; otherwise the stamps are coarse or the
sampling is uneven."""

MOST_UNEVEN = 0.01
"""Maximum fraction of uneven steps, and maximum distance of a sample from an even grid relative to
the recording's length."""

JITTER = 0.1
"""Standard deviation of the steps relative to their mean above which the user is told."""

LOWEST, HIGHEST = 100.0, 1e5
"""Range of rates of which only one unit is possible for times without unit, Hz: three decades, as
between s, ms, us and ns."""


def rate_of_times(
    location: str,
    times: FloatArray,
    where: Callable[[int], str],
    unit: str,
    stated: float,
    argument: str,
) -> float:
    """Return the sampling rate of a recording with times.

    Parameters
    ----------
    location : str
        File and column in messages.
    times : ndarray, shape (n,)
        Time of each sample, in the unit.
    where : callable
        Returns the line, or the like, of a sample by its index.
    unit : str
        Unit of the times; empty if the file states none.
    stated : float
        Sampling rate stated by the user, Hz; 0 if it is not stated.
    argument : str
        Name of the stated rate in messages.

    Returns
    -------
    float
        Samples per second: the stated rate, if the times agree with it.

    Raises
    ------
    ParameterError
        The times go back, are uneven, contradict the stated rate, or do not determine a rate.
    """
    if len(times) < 2:
        return stated
    if not np.all(np.isfinite(times)):
        raise ParameterError(f"{location}: must be finite numbers")
    period, uncertainty = _period(location, times, where)
    factors = {unit: TIME.units[unit]} if unit else {each: TIME.units[each] for each in _SCALES}
    rates = {name: 1.0 / (period * factor) for name, factor in factors.items()}
    if stated:
        if any(abs(rate / stated - 1) <= TOLERANCE + uncertainty for rate in rates.values()):
            return stated
        likely = [rate for rate in rates.values() if unit or LOWEST <= rate < HIGHEST]
        says = f"says {_whole(likely[0]):g} Hz" if likely else f"has steps of {period:g}"
        raise ParameterError(f"{location} {says}, {argument} = {stated:g}: must agree")
    rate = rates[unit or TIME.unit]
    if not unit and not LOWEST <= rate < HIGHEST:
        raise ParameterError(
            f"{location} has steps of {period:g} without a unit: must state it, such as"
            f" time_ms, or {argument} must be given"
        )
    if uncertainty > TOLERANCE:
        raise ParameterError(
            f"{location} is too coarse to tell the rate: {argument} must be given"
        )
    return checked_rate(f"{location}: sampling rate", _whole(rate))


_SCALES = ("s", "ms", "us", "ns")


def _whole(rate: float) -> float:
    """Return a rate rounded to whole hertz, if that is as exact as other rates are met."""
    whole = float(round(rate))
    return whole if math.isclose(rate, whole, rel_tol=RATE_TOLERANCE) else rate


def _period(location: str, times: FloatArray, where: Callable[[int], str]) -> tuple[float, float]:
    """Return the mean step of even times, and its relative uncertainty."""
    steps = np.diff(times)
    back = np.flatnonzero(steps < 0)
    if len(back):
        at = int(back[0])
        raise ParameterError(
            f"{location} goes back at {where(at + 1)}, from {times[at]:.15g} to"
            f" {times[at + 1]:.15g}: must rise"
        )
    length = float(times[-1] - times[0])
    if length <= 0:
        raise ParameterError(f"{location} is always {times[0]:.15g}: must rise")
    usual = float(np.median(steps))
    ordinary = np.abs(steps - usual) <= 0.5001 * usual
    if np.mean(ordinary) < USUAL_SHARE:
        return _coarse_period(location, steps, times, where)
    period = float(steps[ordinary].mean())
    odd = np.flatnonzero(~ordinary)
    grid = times[0] + period * np.arange(len(times))
    apart = float(np.abs(times - grid).max())
    if len(odd) > MOST_UNEVEN * len(steps) or apart > max(MOST_UNEVEN * length, 1.5 * period):
        raise _uneven(location, steps, period, where)
    if len(odd):
        worst = int(odd[np.argmax(np.abs(steps[odd] - period))])
        warn_once(
            f"{location}: {len(odd)} of {len(steps)} steps are not {period:g}, such as"
            f" {steps[worst]:g} before {where(worst + 1)}: samples are taken as even"
        )
    elif (spread := float(steps.std())) > JITTER * period:
        warn_once(
            f"{location}: steps differ by {100 * spread / period:.0f} % RMS from {period:g}:"
            " samples are taken as even"
        )
    return period, 0.0


def _coarse_period(
    location: str, steps: FloatArray, times: FloatArray, where: Callable[[int], str]
) -> tuple[float, float]:
    """Return the period of even samples whose times are rounded to more than half of it."""
    length = float(times[-1] - times[0])
    period = length / len(steps)
    resolution = float(steps[steps > 0].min())
    apart = times - times[0] - period * np.arange(len(times))
    if np.ptp(apart) > 2.0 * resolution:  # rounding, of these times and of the first and the last
        raise _uneven(location, steps, period, where)
    return period, resolution / length


def _uneven(
    location: str, steps: FloatArray, period: float, where: Callable[[int], str]
) -> ParameterError:
    worst = int(np.argmax(np.abs(steps - period)))
    return ParameterError(
        f"{location} is uneven: steps are {period:g} on average, {steps[worst]:g} before"
        f" {where(worst + 1)}: samples must have a constant rate"
    )

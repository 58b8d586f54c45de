# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Outliers in recorded signals: single false samples, and codes at which a sensor is stuck.

The rule is a Hampel identifier (Hampel, J. Am. Stat. Assoc. 69(346), 1974; Pearson, Neuvo, Astola
and Gabbouj, EURASIP J. Adv. Signal Process. 2016:87), restricted to events that are impossible in
a mechanical signal: it leaves the range of its neighbours within one sample, stays at one value,
and returns within one sample. Impacts ring, scratches and bumps have neighbours of similar size,
and after a step the signal does not return.

A run of up to `LONGEST_OUTLIER` equal samples is an outlier if its deviation from the median of
the `SPAN` samples on either side exceeds

1. `THRESHOLD` times their scaled median absolute deviation (Hampel's rule), and `THRESHOLD`
   times the resolution of the signal,
2. `RATIO` times the deviation of these samples without the `COMPANIONS` most distant ones, and
3. `RATIO` times half the range of the `NEAR` samples on either side, from its middle.

At the ends of a recording, an outlier cannot be distinguished from the start of an impact. A run
with fewer than `NEAR` samples beyond it is an outlier if its deviation from the median of the
recording is `RATIO` times that of any sample that is not an outlier.

Limits of the rule: an impact shorter than three samples that does not ring looks like a glitch,
and a glitch below `RATIO` times the peaks around it is not found. White noise with heavy tails
loses some samples; with a Laplace distribution, 1 in 20,000.
"""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import BoolArray, IntArray

LONGEST_OUTLIER = 8
"""Maximum number of equal samples in an outlier; a sensor that sticks for longer is defective."""

SPAN = 16
"""Number of samples on either side with which an outlier is compared."""

NEAR = 3
"""Number of samples on either side that must all be ordinary. The ringing of an impact crosses
zero between two samples, but not for three of them."""

COMPANIONS = 2
"""Number of further outliers permitted among the samples around an outlier."""

THRESHOLD = 5.0
"""Minimum deviation of an outlier in scaled median absolute deviations, which are standard
deviations for normal noise. In such noise, Hampel's threshold of 3 marks one sample in 400; this
threshold marks one in 2 million. The other conditions reduce this number further."""

RATIO = 5.0
"""Minimum deviation of an outlier relative to samples nearby. Taps that decay with a time constant
of 3 ms have ratios up to 4 at 1 kHz, and thus need this margin."""

NORMAL = 1.4826
"""Standard deviation of normal noise divided by its median absolute deviation."""

LARGEST_SHARE = 0.01
"""Maximum fraction of outliers in a recording. With more of them the sensor or its connection is
defective, and interpolation changes the spectrum."""


def outliers(samples: FloatArray) -> BoolArray:
    """Return a mask of the outliers in a signal.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        Finite samples at a constant rate, in any unit.

    Returns
    -------
    ndarray, shape (n,)
        True for outliers.

    Examples
    --------
    >>> force = np.sin(np.arange(100) / 20)
    >>> force[40] = 36870.0
    >>> np.flatnonzero(outliers(force))
    array([40])
    """
    found = np.zeros(len(samples), dtype=bool)
    if len(samples) <= 2 * SPAN:
        return found
    begins = np.flatnonzero(np.diff(samples, prepend=np.nan))
    ends = np.append(begins[1:], len(samples))
    short = ends - begins <= LONGEST_OUTLIER
    inside = short & (begins >= NEAR) & (ends <= len(samples) - NEAR)
    for begin, end in _departures(samples, begins[inside], ends[inside]).tolist():
        found[begin:end] = True
    outer = short & ~inside
    _judge_ends(samples, begins[outer], ends[outer], found)
    return found


def without_outliers(name: str, samples: FloatArray) -> tuple[FloatArray, int]:
    """Replace the outliers in a signal by linear interpolation between their neighbours.

    Parameters
    ----------
    name : str
        Name of the signal in an error message.
    samples : ndarray, shape (n,)
        Finite samples at a constant rate, in any unit.

    Returns
    -------
    samples : ndarray, shape (n,)
        The same array if there are no outliers.
    rejected : int
        Number of outliers.

    Raises
    ------
    ParameterError
        More than `LARGEST_SHARE` of the samples are outliers.

    Examples
    --------
    >>> speed = np.linspace(0.0, 99.0, 100)
    >>> speed[50] = -1e6
    >>> cleaned, rejected = without_outliers("speed", speed)
    >>> float(cleaned[50]), rejected
    (50.0, 1)
    """
    found = outliers(samples)
    rejected = int(np.count_nonzero(found))
    if not rejected:
        return samples, 0
    if rejected > LARGEST_SHARE * len(samples):
        raise ParameterError(
            f"{name}: {rejected} of {len(samples)} samples are outliers:"
            f" must be at most {100 * LARGEST_SHARE:g} %"
        )
    cleaned = samples.copy()
    cleaned[found] = np.interp(np.flatnonzero(found), np.flatnonzero(~found), samples[~found])
    return cleaned, rejected


def _departures(samples: FloatArray, begins: IntArray, ends: IntArray) -> IntArray:
    """Return start and end of the runs that are outliers, shape (m, 2)."""
    low = samples[: -NEAR + 1].copy()  # minimum of the next NEAR samples, like `high`
    high = low.copy()
    for ahead in range(1, NEAR):
        shifted = samples[ahead : len(low) + ahead]
        np.minimum(low, shifted, out=low)
        np.maximum(high, shifted, out=high)
    lowest = np.minimum(low[begins - NEAR], low[ends])
    highest = np.maximum(high[begins - NEAR], high[ends])
    half = (highest - lowest) / 2
    apart = np.abs(samples[begins] - lowest - half) > RATIO * half
    begins, ends = begins[apart], ends[apart]
    indices = np.concatenate(
        [begins[:, None] - 1 - np.arange(SPAN), ends[:, None] + np.arange(SPAN)], axis=1
    )
    neighbours = samples[np.clip(indices, 0, len(samples) - 1)]
    median = np.median(neighbours, axis=1)
    deviations = np.sort(np.abs(neighbours - median[:, None]), axis=1)
    own = np.abs(samples[begins] - median)
    scale = np.maximum(NORMAL * np.median(deviations, axis=1), _resolution(samples, begins, ends))
    far = (own > THRESHOLD * scale) & (own > RATIO * deviations[:, -1 - COMPANIONS])
    return np.column_stack([begins[far], ends[far]])


def _resolution(samples: FloatArray, begins: IntArray, ends: IntArray) -> float:
    """Return the smallest step of a signal, 0 if it is constant apart from some runs.

    A quiet sensor toggles between two codes. Such steps are not outliers.
    """
    steps = np.abs(np.diff(samples))
    steps[begins - 1] = 0.0
    steps[ends - 1] = 0.0
    return float(np.min(steps, where=steps > 0, initial=np.inf)) if steps.any() else 0.0


def _judge_ends(samples: FloatArray, begins: IntArray, ends: IntArray, found: BoolArray) -> None:
    """Mark outliers at the ends of a recording, once all others are known."""
    outer = np.zeros(len(samples), dtype=bool)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        outer[begin:end] = True
    deviations = np.abs(samples - np.median(samples))
    ordinary = deviations[~(outer | found)]
    if len(ordinary):
        found |= outer & (deviations > RATIO * ordinary.max())

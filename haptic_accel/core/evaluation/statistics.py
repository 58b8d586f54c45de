# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Confidence intervals of metrics, and paired tests of differences between conditions.

Student (1908) for means, on a logarithmic or logit scale if their range has ends; Efron (1979) for
the bootstrap, Wilcoxon (1945) for signed ranks; distributions from `scipy.stats`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Literal, TypeAlias

import numpy as np

from haptic_accel.core.model import FloatArray

Alternative: TypeAlias = Literal["two-sided", "greater", "less"]
"""Alternative hypothesis: a value differs from another, or is greater or less."""

CONFIDENCE = 0.95
"""Confidence level of every interval."""

SEGMENT = 1.0
"""Length of the pieces of a trial that count as independent, s: a few strokes of a hand, and many
times the correlation time of handle and texture."""

FEWEST_SEGMENTS = 5
"""Minimum number of pieces for a trial's own interval."""

RESAMPLES = 2000
"""Number of bootstrap draws; quantiles are then accurate to about a tenth of the interval."""

FEWEST = 3
"""Minimum number of values for an interval, and of pairs for a test. For two values Student's
interval is 13 times as wide as for very many, and is useless."""

FEWEST_RANKED = 6
"""Minimum number of pairs for which Wilcoxon's test can give less than 5 %: 2 / 2^6 is 3 %."""

EXACT = 15
"""Largest number of values for which all 2^n flips of signs are tried."""

FLIPS = 9999
"""Number of random flips of signs for more values; a probability of 5 % is then exact to 0.2 %."""

_HIGHEST_EXPONENT = 300.0  # maximum exponent of e without overflow

_SEED = 0  # fixed, so that an analysis always has the same result


@dataclass(frozen=True)
class Interval:
    """Value with its confidence interval.

    Attributes
    ----------
    value : float
        Estimate.
    low, high : float
        Ends of the interval of `CONFIDENCE`; NaN if there is none.
    n : int
        Number of values or pieces in the interval.
    method : str
        Description of the interval's method.
    """

    value: float
    low: float
    high: float
    n: int
    method: str


@dataclass(frozen=True)
class PairedDifference:
    """Paired test of the difference between two conditions.

    Attributes
    ----------
    n : int
        Number of pairs.
    mean : Interval
        Mean of second minus first, with Student's interval.
    effect : float
        Mean over standard deviation of the differences, Cohen's d_z; NaN where undefined.
    t, p_t : float
        Statistic and probability of the paired t-test; NaN where not tested.
    p_wilcoxon : float
        Probability of Wilcoxon's signed-rank test; NaN where not tested.
    verdict : str
        Description of the result, with the reason for each test that was not possible.
    """

    n: int
    mean: Interval
    effect: float
    t: float
    p_t: float
    p_wilcoxon: float
    verdict: str


def mean_interval(
    values: Sequence[float],
    confidence: float = CONFIDENCE,
    within: tuple[float, float] = (-math.inf, math.inf),
) -> Interval:
    """Return the mean of independent values with an interval that stays within their range.

    The interval is Student's for the logarithm of the mean's distance from one end of the range,
    or for its logit between two ends; the standard error is transformed by the derivative (delta
    method). Without ends it is Student's own interval. Unlike this, it has nearly the nominal
    coverage also for skewed values. Values that are not finite are ignored. Fewer than `FEWEST`
    values have no interval; the mean of no values is NaN.

    Parameters
    ----------
    values : sequence of float
    confidence : float
    within : tuple of float
        Ends of the range of possible values; the first is finite if the second is.
    """
    finite = np.array([value for value in values if math.isfinite(value)])
    n = len(finite)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, 0, "no value")
    mean = float(np.mean(finite))
    if n < FEWEST:
        few = f"{n} {'trial' if n == 1 else 'trials'}: too few for an interval"
        return Interval(mean, math.nan, math.nan, n, few)
    from scipy import stats

    reach = float(stats.t.ppf((1 + confidence) / 2, n - 1)) * float(np.std(finite, ddof=1))
    reach /= math.sqrt(n)
    low, high = within
    if not low < mean < high or math.isinf(low):
        ends = max(low, mean - reach), min(high, mean + reach)
        return Interval(mean, *ends, n, f"t over {n} trials")
    if math.isinf(high):
        factor = math.exp(min(reach / (mean - low), _HIGHEST_EXPONENT))
        ends = low + (mean - low) / factor, low + (mean - low) * factor
        return Interval(mean, *ends, n, f"t of the logarithm over {n} trials")
    below, above = mean - low, high - mean
    factor = math.exp(min(reach * (below + above) / (below * above), _HIGHEST_EXPONENT))
    odds = below / above
    first, last = (low + (high - low) * o / (1 + o) for o in (odds / factor, odds * factor))
    return Interval(mean, first, last, n, f"t of the logit over {n} trials")


def nrmse_interval(desired: FloatArray, actual: FloatArray, rate: float) -> Interval:
    """Return a trial's NRMSE with a bootstrap interval from its pieces.

    The trial is divided into pieces of `SEGMENT`, which are drawn with replacement `RESAMPLES`
    times. The interval lies between quantiles of the NRMSE of the draws. It covers the variation
    within the trial, not between trials.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Aligned signals, m/s^2.
    rate : float
        Samples per second.

    Returns
    -------
    Interval
        Ratio; without ends for fewer than `FEWEST_SEGMENTS` pieces.
    """
    power, error_power = _squares(desired), _squares(actual - desired)
    reference = float(np.sum(power))
    value = math.sqrt(float(np.sum(error_power)) / reference) if reference else math.nan
    n = round(len(desired) / rate / SEGMENT)
    if n < FEWEST_SEGMENTS:
        return Interval(value, math.nan, math.nan, n, f"{n} pieces of {SEGMENT:g} s: too few")
    edges = np.linspace(0, len(desired), n + 1).astype(int)[:-1]
    errors = np.add.reduceat(error_power, edges)
    references = np.add.reduceat(power, edges)
    drawn = np.random.default_rng(_SEED).integers(0, n, (RESAMPLES, n))
    below = np.sum(references[drawn], axis=1)
    ratios = np.sqrt(np.sum(errors[drawn], axis=1)[below > 0] / below[below > 0])
    low, high = np.quantile(ratios, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]).tolist()
    return Interval(value, low, high, n, f"bootstrap over {n} pieces of {SEGMENT:g} s")


def _squares(values: FloatArray) -> FloatArray:
    """Return the square of each sample, or of the length of each vector."""
    return np.asarray(np.sum(values.reshape(len(values), -1) ** 2, axis=1))


def paired_difference(
    first: Sequence[float], second: Sequence[float], alternative: Alternative = "two-sided"
) -> PairedDifference:
    """Test whether two conditions differ, from paired values.

    Parameters
    ----------
    first, second : sequence of float, the same length
        Values of each pair under the two conditions; finite.
    alternative : str
        Alternative hypothesis for second minus first.

    Returns
    -------
    PairedDifference
        Without probabilities for fewer than `FEWEST` pairs, and without Wilcoxon's for
        fewer than `FEWEST_RANKED`.

    Raises
    ------
    ValueError
        The sequences differ in length.
    """
    if len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} values: must be pairs")
    differences = np.asarray(second, dtype=float) - np.asarray(first, dtype=float)
    n = len(differences)
    mean = mean_interval(differences.tolist())
    spread = float(np.std(differences, ddof=1)) if n > 1 else math.nan
    # Equal differences may still differ by rounding errors.
    varies = spread > 1e-12 * max(float(np.max(np.abs(differences))), 1e-300) if n > 1 else False
    effect = mean.value / spread if varies else math.nan
    t = p_t = p_wilcoxon = math.nan
    if n >= FEWEST and varies:
        from scipy import stats

        tested = stats.ttest_rel(second, first, alternative=alternative)
        t, p_t = float(tested.statistic), float(tested.pvalue)
        if n >= FEWEST_RANKED:
            p_wilcoxon = _signed_ranks(differences, alternative)
    verdict = _verdict(n, varies, p_t, p_wilcoxon)
    return PairedDifference(n, mean, effect, t, p_t, p_wilcoxon, verdict)


def flipped_signs(differences: FloatArray, alternative: Alternative = "two-sided") -> float:
    """Return the share of sign flips whose sum is at least as extreme as the observed sum.

    Up to `EXACT` differences all flips are tried, otherwise `FLIPS` random ones (Fisher, "The
    Design of Experiments", 1935). NaN for fewer than `FEWEST` differences.
    """
    if len(differences) < FEWEST:
        return math.nan
    sums = _signs(len(differences)) @ differences
    if alternative == "two-sided":
        sums = np.abs(sums)
    elif alternative == "less":
        sums = -sums
    # Equal sums differ by rounding errors.
    return float(np.mean(sums >= sums[0] - 1e-9 * float(np.sum(np.abs(differences)))))


@cache
def _signs(n: int) -> FloatArray:
    """Return sign patterns of n values, in rows; the first row flips no sign."""
    if n <= EXACT:
        return np.array(list(product((1.0, -1.0), repeat=n)))
    drawn = np.random.default_rng(_SEED).choice((1.0, -1.0), (FLIPS, n))
    return np.vstack([np.ones(n), drawn])


def _signed_ranks(differences: FloatArray, alternative: Alternative) -> float:
    """Return the probability of Wilcoxon's test; differences of zero are omitted.

    For few differences all flips are tried here, because scipy takes a second per test with ties.
    """
    from scipy import stats

    # Equal differences of proportions may differ by rounding errors.
    rounded = np.round(differences / np.max(np.abs(differences)), 9)
    varied = rounded[rounded != 0]
    if not FEWEST <= len(varied) <= EXACT:
        return float(stats.wilcoxon(rounded, alternative=alternative).pvalue)
    return flipped_signs(np.sign(varied) * stats.rankdata(np.abs(varied)), alternative)


def _verdict(n: int, varies: bool, p_t: float, p_wilcoxon: float) -> str:
    if n == 0:
        return "no pair: nothing can be compared"
    if n < FEWEST:
        pairs = "1 pair" if n == 1 else f"{n} pairs"
        return f"{pairs}: too few to test, at least {FEWEST} are needed"
    if not varies:
        return f"{n} pairs differ by the same amount: there is no scatter to test against"
    words = f"paired t-test over {n} pairs, p = {p_t:.2g}"
    if math.isnan(p_wilcoxon):
        return f"{words}; Wilcoxon's test needs {FEWEST_RANKED} pairs"
    return f"{words}; Wilcoxon's signed ranks, p = {p_wilcoxon:.2g}"

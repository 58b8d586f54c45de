# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sensitivity d' by task, with intervals, and the exact binomial test.

A stimulus causes a normally distributed sensation of standard deviation 1; d' is the distance
between the means of two stimuli (Macmillan, Creelman, "Detection Theory: A User's Guide", 2nd ed.,
2005). A participant decides by the rule of the task:

- ``2ifc``: chooses the interval with the stronger sensation.
- ``odd_one_out``: of three, names the one that is farthest from the other two (triangle test;
  Frijters, Kooistra, Vereijken, Perception & Psychophysics 27, 1980).
- ``abx``: names the one of two that is closer to the third (differencing, as in duo-trio tests).
- ``same_different``: answers "different" if two sensations differ by more than a criterion
  (differencing; Kaplan, Macmillan, Creelman, Behavior Research Methods 10, 1978).

Below chance, d' is negative by symmetry: if it were 0, the mean of participants who guess would be
positive. In all tasks but ``2ifc`` the proportion correct is flat at d' = 0, so that d' of few
trials near chance scatters widely. Test the proportion correct there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from haptic_accel import FloatArray
from haptic_accel.core.evaluation.statistics import CONFIDENCE, Alternative, Interval

LARGEST_D_PRIME = 20.0
"""Largest finite d'; errors are below 1e-14 in all tasks."""

CHANCE: Mapping[str, float] = {"2ifc": 1 / 2, "odd_one_out": 1 / 3, "abx": 1 / 2}
"""Proportion correct of guesses, in the tasks whose d' follows from the proportion correct."""

_Count: TypeAlias = tuple[float, float]  # number of answers, number of trials

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(60)
_REFINEMENTS = 3  # each 30 times finer; only one maximum over the criterion exists


@dataclass(frozen=True)
class Proportion:
    """Proportion of one participant's independent trials, with its exact test.

    Attributes
    ----------
    interval : Interval
        Proportion with the interval of Clopper and Pearson (1934), whose coverage is at least the
        nominal one.
    chance : float
        Proportion of the null hypothesis.
    p : float
        Probability of the exact binomial test; NaN without trials.
    """

    interval: Interval
    chance: float
    p: float


def exact_binomial(
    correct: int, trials: int, chance: float, alternative: Alternative = "two-sided"
) -> Proportion:
    """Test a proportion of one participant against chance.

    Trials of several participants are not independent: test the participants' proportions by
    `hypotheses.mean_test`.

    Raises
    ------
    ValueError
        `correct` is negative, or greater than `trials`.

    Examples
    --------
    The least number that is significant at 5 % in 30 triangle tests is 15 (ISO 4120).

    >>> exact_binomial(15, 30, 1 / 3, "greater").p < 0.05
    True
    >>> exact_binomial(14, 30, 1 / 3, "greater").p < 0.05
    False
    """
    _check(correct, trials)
    if not trials:
        return Proportion(Interval(math.nan, math.nan, math.nan, 0, "no trial"), chance, math.nan)
    from scipy import stats

    tested = stats.binomtest(correct, trials, chance, alternative=alternative)
    found = tested.proportion_ci(CONFIDENCE, "exact")
    method = f"exact binomial over {trials} trials"
    interval = Interval(correct / trials, float(found.low), float(found.high), trials, method)
    return Proportion(interval, chance, float(tested.pvalue))


def proportion_correct(task: str, d_prime: FloatArray) -> FloatArray:
    """Return the proportion correct of an unbiased participant.

    Parameters
    ----------
    task : str
        One of `CHANCE`.
    d_prime : ndarray, any shape

    Examples
    --------
    >>> proportion_correct("odd_one_out", np.array([0.0, 1.0, 2.0])).round(3)
    array([0.333, 0.418, 0.605])
    """
    d_prime = np.asarray(d_prime, dtype=float)
    above = _CORRECT[task](np.minimum(np.abs(d_prime), LARGEST_D_PRIME)) - CHANCE[task]
    return np.clip(CHANCE[task] + np.sign(d_prime) * above, 0.0, 1.0)


def sensitivity(task: str, proportion: float) -> float:
    """Return the d' of an unbiased participant with a proportion correct.

    Parameters
    ----------
    task : str
        One of `CHANCE`.
    proportion : float
        From 0 to 1. The result is infinite at 1, and negative below chance.

    Examples
    --------
    >>> round(sensitivity("2ifc", 0.76), 2), round(sensitivity("abx", 0.75), 2)
    (1.0, 2.02)
    """
    above = abs(proportion - CHANCE[task])
    highest = float(proportion_correct(task, np.array(LARGEST_D_PRIME))) - CHANCE[task]
    if above >= highest:
        return math.copysign(math.inf, proportion - CHANCE[task])
    from scipy.optimize import brentq

    def excess(d_prime: float) -> float:
        return float(proportion_correct(task, np.array(d_prime))) - CHANCE[task] - above

    return math.copysign(float(brentq(excess, 0.0, LARGEST_D_PRIME)), proportion - CHANCE[task])


def d_prime(task: str, correct: int, trials: int) -> Interval:
    """Return d' from a participant's number of correct answers.

    A preference for one of the answers lowers d'. To make d' finite and nearly unbiased, the
    chance proportion is added to the correct answers, and one to the trials: for two answers, the
    log-linear rule (Hautus, Behavior Research Methods 27, 1995).

    Parameters
    ----------
    task : str
        One of `CHANCE`.
    correct, trials : int

    Returns
    -------
    Interval
        d' with limits from the exact binomial interval, whose coverage is at least the nominal
        one. The upper limit is infinite without an error.

    Raises
    ------
    ValueError
        `correct` is negative, or greater than `trials`.
    """
    found = exact_binomial(correct, trials, CHANCE[task]).interval
    if not trials:
        return found
    value = sensitivity(task, (correct + CHANCE[task]) / (trials + 1))
    low, high = (sensitivity(task, limit) for limit in (found.low, found.high))
    return Interval(value, low, high, trials, found.method)


def d_prime_by_answers(hits: int, different: int, false_alarms: int, same: int) -> Interval:
    """Return d' of ``same_different`` from a participant's answers.

    The participant's criterion does not change d'. Rates are corrected by the log-linear rule
    (Hautus 1995). The interval contains two intervals of the profile likelihood over the
    criterion, from the counts and from the corrected counts: the former alone is too narrow near
    the ceiling.

    Parameters
    ----------
    hits, different : int
        Number of answers "different" in trials with a difference, and of these trials.
    false_alarms, same : int
        Number of answers "different" in trials without a difference, and of these trials.

    Returns
    -------
    Interval
        d' with limits, which are infinite if the answers set no bound.

    Raises
    ------
    ValueError
        A number of answers is negative, or greater than its number of trials.
    """
    _check(hits, different)
    _check(false_alarms, same)
    n = different + same
    if not different or not same:
        return Interval(math.nan, math.nan, math.nan, n, "no trial of one of the two kinds")
    corrected = ((hits + 0.5, different + 1.0), (false_alarms + 0.5, same + 1.0))
    value = _by_rates(*(chosen / trials for chosen, trials in corrected))
    limits = [
        _limits(value, *counts)
        for counts in (corrected, ((hits, different), (false_alarms, same)))
    ]
    low, high = min(low for low, _ in limits), max(high for _, high in limits)
    return Interval(value, low, high, n, f"profile likelihood over {n} trials")


def _check(chosen: int, trials: int) -> None:
    if not 0 <= chosen <= trials:
        raise ValueError(f"{chosen} answers of {trials} trials: must be from 0 to {trials}")


def _phi(z: FloatArray) -> FloatArray:
    from scipy.special import ndtr

    return np.asarray(ndtr(z))


def _two_intervals(d: FloatArray) -> FloatArray:
    return _phi(d / math.sqrt(2))


def _triangle(d: FloatArray) -> FloatArray:
    """Integrate over the distance of the two equal stimuli, from 0 to 9 standard deviations."""
    x = 4.5 * (_NODES + 1)
    density = 4.5 * _WEIGHTS * np.exp(-(x**2) / 2) * math.sqrt(2 / math.pi)
    middle = d[..., np.newaxis] * math.sqrt(2 / 3)
    return np.asarray(
        (_phi(middle - math.sqrt(3) * x) + _phi(-middle - math.sqrt(3) * x)) @ density
    )


def _abx(d: FloatArray) -> FloatArray:
    ends, middle = d / math.sqrt(2), d / math.sqrt(6)
    return _phi(ends) * _phi(middle) + _phi(-ends) * _phi(-middle)


_CORRECT: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "2ifc": _two_intervals,
    "odd_one_out": _triangle,
    "abx": _abx,
}


def _by_rates(hit: float, false_alarm: float) -> float:
    """Return d' from rates between 0 and 1."""
    from scipy.optimize import brentq
    from scipy.special import ndtri

    if math.isclose(hit, false_alarm):
        return 0.0
    if hit < false_alarm:
        return -_by_rates(false_alarm, hit)
    criterion = np.array(-math.sqrt(2) * ndtri(false_alarm / 2))
    return float(brentq(lambda d: float(_rates(d, criterion)[0]) - hit, 0, LARGEST_D_PRIME))


def _rates(d: float, criterion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rates of hits and false alarms."""
    width = criterion / math.sqrt(2)
    shift = d / math.sqrt(2)
    return _phi(shift - width) + _phi(-shift - width), 2 * _phi(-width)


def _log_likelihood(rate: FloatArray, chosen: float, trials: float) -> FloatArray:
    from scipy.special import xlog1py, xlogy

    return np.asarray(xlogy(chosen, rate) + xlog1py(trials - chosen, -rate))


def _limits(inside: float, first: _Count, second: _Count) -> tuple[float, float]:
    """Return the ends of the interval, beyond which the likelihood is below its threshold."""
    from scipy import stats
    from scipy.optimize import brentq

    best = sum(_log_likelihood(np.array(k / n), k, n) for k, n in (first, second))
    least = float(best) - float(stats.chi2.ppf(CONFIDENCE, 1)) / 2

    def beyond(d_prime: float) -> float:
        return least - _profile(d_prime, first, second)

    low, high = (
        float(brentq(beyond, inside, end, xtol=1e-6))
        if beyond(end) > 0
        else math.copysign(math.inf, end)
        for end in (-LARGEST_D_PRIME / 2, LARGEST_D_PRIME / 2)
    )
    return low, high


def _profile(d: float, first: _Count, second: _Count) -> float:
    """Return the log-likelihood of d' at the criterion that fits best."""
    if d < 0:
        return _profile(-d, second, first)
    low, high = 0.0, d + 9.0
    for _ in range(_REFINEMENTS):
        criterion = np.linspace(low, high, 60)
        hit, false_alarm = _rates(d, criterion)
        likelihood = _log_likelihood(hit, *first) + _log_likelihood(false_alarm, *second)
        best = int(np.argmax(likelihood))
        low, high = criterion[max(best - 1, 0)], criterion[min(best + 1, 59)]
    return float(likelihood[best])

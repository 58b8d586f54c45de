# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sensitivity d' by task, with intervals, the exact binomial test, and psychometric functions.

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

A psychometric function has threshold, slope and lapses of one participant. The proportion correct
at a distance x from the reference is

    chance + (1 - chance - lapse) F(slope (ln x - ln threshold)).

The guess rate, chance, depends on the task; `SIGMOIDS` are the shapes of F. Parameters are the
most probable ones, under priors that stabilise a fit to insufficient data (as in psignifit 4:
Schütt, Harmeling, Macke, Wichmann, Vision Research 122, 2016). Intervals follow from the posterior
on a grid. They are also valid for staircases and QUEST+, whose levels depend on earlier answers; a
bootstrap would have to repeat the procedure, with a fit for each draw. `benchmarks/studies.py`
measures both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from haptic_accel import FloatArray
from haptic_accel.core.evaluation.statistics import CONFIDENCE, Alternative, Interval

LARGEST_D_PRIME = 20.0
"""Largest finite d'; errors are below 1e-14 in all tasks."""

CHANCE: Mapping[str, float] = {"2ifc": 1 / 2, "odd_one_out": 1 / 3, "abx": 1 / 2}
"""Proportion correct of guesses, in the tasks whose d' follows from the proportion correct."""

_Count: TypeAlias = tuple[float, float]  # number of answers, number of trials

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(60)
_FINER = 3  # refinements, each 30 times finer; only one maximum over the criterion exists


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
    "2ifc": lambda d: _phi(d / math.sqrt(2)),
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
    for _ in range(_FINER):
        criterion = np.linspace(low, high, 60)
        hit, false_alarm = _rates(d, criterion)
        likelihood = _log_likelihood(hit, *first) + _log_likelihood(false_alarm, *second)
        best = int(np.argmax(likelihood))
        low, high = criterion[max(best - 1, 0)], criterion[min(best + 1, 59)]
    return float(likelihood[best])


SLOPES = (0.5, 4.0)
"""Range of slopes that are equally probable a priori. d' grows about as the distance from a
reference, and as its power of 2 to 3 near a detection threshold (Pelli, Vision Research 27,
1987)."""

SLOPE_MARGIN = math.log(2.5)
"""Distance beyond `SLOPES`, as a logarithm, at which a slope is impossible."""

LEAST_MARGIN = 1.0
"""Minimum distance beyond the levels, as a logarithm, at which a threshold is impossible; the
distance is the levels' range if that is larger."""

LAPSE = 50.0
"""Exponent of the lapses' prior, (1 - lapse)^(LAPSE - 1), of mean 2 %. The prior makes lapses
above 6 % improbable, which Wichmann and Hill exclude (Perception & Psychophysics 63, 2001)."""

_SHAPE = (25, 21, 11)  # grid over log threshold, log slope, lapse: limits within 3 %
_LARGEST_LAPSE = 0.2
_STAGES = (100.0, 1500.0, math.inf)  # trial counts while the grid shrinks to the support
_REFINEMENTS = 3  # number of shrinkages to the cells at the maximum
_PLAUSIBLE = 1.92  # plausible fall of the log-likelihood: chi-square / 2
_NEGLIGIBLE = 1e-5  # fraction of the maximum of a marginal posterior

_Sigmoid: TypeAlias = Callable[[FloatArray], FloatArray]
_Axes: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Psychometric:
    """Psychometric function of a participant.

    Attributes
    ----------
    task : str
    sigmoid : str
        One of `SIGMOIDS`.
    threshold : Interval
        Distance from the reference at which d' is 1, or for ``normal`` the proportion is halfway
        between chance and its largest value, in the level's unit. Outside the levels the value
        depends on the prior. A limit is 0 or infinite where the answers exclude no threshold on
        that side.
    slope : Interval
        Exponent of d' over the distance, or for ``normal`` the inverse of the standard deviation
        of the logarithm.
    lapse : Interval
        Share of wrong answers at large distances; the interval is one-sided.
    """

    task: str
    sigmoid: str
    threshold: Interval
    slope: Interval
    lapse: Interval

    def proportion(self, distances: ArrayLike) -> FloatArray:
        """Return the proportion correct at some distances from the reference."""
        steps = np.log(np.asarray(distances, dtype=float) / self.threshold.value)
        shape = SIGMOIDS[self.sigmoid](self.task)(self.slope.value * steps)
        chance = CHANCE[self.task]
        return np.asarray(chance + (1 - chance - self.lapse.value) * shape)


def fit_psychometric(
    distances: ArrayLike,
    correct: ArrayLike,
    trials: ArrayLike,
    task: str,
    sigmoid: str = "d_prime",
) -> Psychometric:
    """Fit the psychometric function of a participant.

    Parameters
    ----------
    distances : array-like, shape (n,)
        Distances of the levels from the reference, all positive; equal ones are pooled.
    correct, trials : array-like, shape (n,)
        Number of correct answers, and of trials, at each distance.
    task : str
        One of `CHANCE`.
    sigmoid : str
        One of `SIGMOIDS`.

    Raises
    ------
    ValueError
        The trials are empty, a distance is not positive, or `correct` exceeds `trials`.

    Examples
    --------
    >>> levels, trials = np.array([0.5, 1.0, 2.0, 4.0]), 200
    >>> correct = np.round(trials * proportion_correct("2ifc", levels / 1.5))
    >>> fit = fit_psychometric(levels, correct, [trials] * 4, "2ifc")
    >>> round(fit.threshold.value, 1), round(fit.slope.value, 1)
    (1.5, 1.0)
    """
    levels, indices = np.unique(np.asarray(distances, dtype=float), return_inverse=True)
    counts, totals = (
        np.bincount(indices, np.asarray(each, dtype=float)).astype(float)
        for each in (correct, trials)
    )
    n = int(np.sum(totals))
    if not n or levels[0] <= 0 or np.any(counts > totals) or np.any(counts < 0):
        raise ValueError(
            "a psychometric function needs trials at positive distances from the reference, and at"
            " most as many correct answers as trials"
        )
    data = _Data(np.log(levels), counts, totals, task, sigmoid)
    axes = _grid(*data.ends())
    profile = np.max(data.log_posterior(axes, informed=False), axis=(1, 2))
    unbounded = profile[[0, -1]] > np.max(profile) - _PLAUSIBLE
    # The posterior of many trials is narrower than a coarse grid's spacing; of few trials, wider.
    for counted in _STAGES:
        weight = min(1.0, counted / n)
        axes = _grid(*map(_support, axes, _marginals(weight * data.log_posterior(axes))))
    limits = list(map(_quantiles, axes, _marginals(data.log_posterior(axes))))
    for _ in range(_REFINEMENTS):
        axes = _grid(*map(_around, axes, _best(data.log_posterior(axes))))
    values = [
        float(axis[at]) for axis, at in zip(axes, _best(data.log_posterior(axes)), strict=True)
    ]
    limits[0] = (
        -math.inf if unbounded[0] else limits[0][0],
        math.inf if unbounded[1] else limits[0][1],
    )
    limits[2] = (0.0, limits[2][1])
    scales: tuple[Callable[[float], float], ...] = (math.exp, math.exp, float)
    threshold, slope, lapse = (
        Interval(
            scale(value),
            scale(min(low, value)),
            scale(max(high, value)),
            n,
            f"posterior of {n} trials",
        )
        for scale, value, (low, high) in zip(scales, values, limits, strict=True)
    )
    return Psychometric(task, sigmoid, threshold, slope, lapse)


@dataclass(frozen=True)
class _Data:
    """Answers at each level x, the logarithm of the distance from the reference."""

    x: FloatArray
    correct: FloatArray
    trials: FloatArray
    task: str
    sigmoid: str

    @property
    def margin(self) -> float:
        return max(float(self.x[-1] - self.x[0]), LEAST_MARGIN)

    def ends(self) -> tuple[tuple[float, float], ...]:
        """Return the possible ranges of log threshold, log slope and lapse."""
        return (
            (float(self.x[0]) - self.margin, float(self.x[-1]) + self.margin),
            (math.log(SLOPES[0]) - SLOPE_MARGIN, math.log(SLOPES[1]) + SLOPE_MARGIN),
            (0.0, _LARGEST_LAPSE),
        )

    def log_posterior(self, axes: _Axes, informed: bool = True) -> FloatArray:
        """Return the log posterior on a grid, up to a constant, with or without the prior."""
        threshold, slope, lapse = axes
        shape = SIGMOIDS[self.sigmoid](self.task)(
            np.exp(slope)[:, None, None] * (self.x - threshold[:, None, None, None])
        )
        chance = CHANCE[self.task]
        p = np.clip(chance + (1 - chance - lapse[:, None]) * shape, 1e-12, 1 - 1e-12)
        prior = _box(slope, math.log(SLOPES[0]), math.log(SLOPES[1]), SLOPE_MARGIN)[:, None]
        if informed:
            ends = float(self.x[0]), float(self.x[-1])
            prior = prior + _box(threshold, *ends, self.margin)[:, None, None]
        likelihood = np.log(p) @ self.correct + np.log1p(-p) @ (self.trials - self.correct)
        return np.asarray(likelihood + prior + (LAPSE - 1) * np.log1p(-lapse))


@cache
def _d_prime(task: str) -> _Sigmoid:
    """Return F of d' = exp(u), from a table whose error is below 1e-5."""
    known = np.linspace(-10.0, 4.0, 3000)
    values = (proportion_correct(task, np.exp(known)) - CHANCE[task]) / (1 - CHANCE[task])
    return lambda u: np.interp(u, known, values)


def _normal(task: str) -> _Sigmoid:
    from scipy.special import ndtr

    return lambda u: np.asarray(ndtr(u))


SIGMOIDS: Mapping[str, Callable[[str], _Sigmoid]] = {"d_prime": _d_prime, "normal": _normal}
"""Shapes by name: d' as a power of the distance, as for `protocol.Observer`, and the cumulative
normal distribution over the logarithm of the distance, as in most papers."""


def _box(x: FloatArray, low: float, high: float, margin: float) -> FloatArray:
    """Return the logarithm of a flat prior with cosine-shaped falls, as psignifit's."""
    beyond = np.clip(np.maximum(low - x, x - high) / margin, 0, 1)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log((1 + np.cos(np.pi * beyond)) / 2))


def _grid(*ends: tuple[float, float]) -> _Axes:
    first, second, third = (np.linspace(*end, n) for end, n in zip(ends, _SHAPE, strict=True))
    return first, second, third


def _marginals(log_posterior: FloatArray) -> list[FloatArray]:
    """Return the marginal posterior of each axis, of sum 1, by the trapezoidal rule."""
    weights = np.exp(log_posterior - np.max(log_posterior))
    for axis in range(3):
        np.moveaxis(weights, axis, 0)[[0, -1]] /= 2
    weights /= np.sum(weights)
    return [weights.sum(axis=others) for others in ((1, 2), (0, 2), (0, 1))]


def _support(axis: FloatArray, marginal: FloatArray) -> tuple[float, float]:
    """Return the ends of the part of an axis whose posterior is not negligible."""
    indices = np.flatnonzero(marginal > _NEGLIGIBLE * np.max(marginal))
    return float(axis[max(indices[0] - 1, 0)]), float(axis[min(indices[-1] + 1, len(axis) - 1)])


def _around(axis: FloatArray, index: int) -> tuple[float, float]:
    return float(axis[max(index - 2, 0)]), float(axis[min(index + 2, len(axis) - 1)])


def _best(log_posterior: FloatArray) -> tuple[int, ...]:
    return tuple(map(int, np.unravel_index(int(np.argmax(log_posterior)), log_posterior.shape)))


def _quantiles(axis: FloatArray, marginal: FloatArray) -> tuple[float, float]:
    """Return the limits, interpolated on the normal scale, where tails are nearly straight."""
    from scipy.special import ndtri

    known = ndtri(np.clip(np.cumsum(marginal) - marginal / 2, 1e-12, 1 - 1e-12))
    reach = float(ndtri((1 + CONFIDENCE) / 2))
    return float(np.interp(-reach, known, axis)), float(np.interp(reach, known, axis))

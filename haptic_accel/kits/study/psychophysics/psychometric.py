# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Psychometric function: threshold, slope and lapses of one participant.

The proportion correct at a distance x from the reference is

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
from haptic_accel.core.evaluation.statistics import CONFIDENCE, Interval
from haptic_accel.kits.study.psychophysics.detection import CHANCE, proportion_correct

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
        One of `detection.CHANCE`.
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

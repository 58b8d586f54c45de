# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Preferences, confusions and similarities of conditions, estimated from choices.

Bradley, Terry, Biometrika 39, 1952; Miller, Nicely, J. Acoust. Soc. Am. 27, 1955; Torgerson,
Psychometrika 17, 1952; de Leeuw, 1977 (SMACOF: scaling by majorizing a complicated function).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from haptic_accel import FloatArray
from haptic_accel.core.evaluation.statistics import CONFIDENCE, Interval, mean_interval

_ITERATIONS = 100
_CLOSE = 1e-10  # step of a log worth below which the fit has converged
_STEPS = 3000  # maximum number of steps of the majorization
_GAIN = 1e-10  # relative decrease of the stress at convergence


@dataclass(frozen=True)
class Transfer:
    """Information that answers transfer about the stimuli.

    Attributes
    ----------
    bits : float
        Transferred information, corrected for its bias; never negative.
    uncorrected : float
        Information without correction, which is too large with few trials: even guesses seem to
        transfer some.
    categories : float
        Number of stimuli that can be identified without error at this information.
    trials : int
        Number of trials. Below about five per cell of the matrix, the correction is too small
        (Miller 1955); near perfect answers it is too large.
    """

    bits: float
    uncorrected: float
    categories: float
    trials: int


@dataclass(frozen=True)
class Scaling:
    """Conditions as points, whose distances resemble their dissimilarities.

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        Centred coordinates along the principal axes, in the unit of the dissimilarities.
        Directions are arbitrary.
    stress : float
        Kruskal's stress 1: root of the sum of squared errors divided by that of squared distances.
    """

    points: FloatArray
    stress: float


def bradley_terry(wins: ArrayLike) -> list[Interval]:
    """Return the log worth of each condition from paired preferences.

    The odds that i is preferred to j are exp(worth i - worth j). The fit reduces the bias of small
    samples and stays finite if a condition always wins (Firth, Biometrika 80, 1993).

    Parameters
    ----------
    wins : array-like, shape (k, k) or (participants, k, k)
        Number of times that the row's condition was preferred to the column's.

    Returns
    -------
    list of Interval
        Worths of mean 0, with intervals of the jackknife over participants or, for one
        participant, of Wald.

    Raises
    ------
    ValueError
        Comparisons do not connect all conditions.

    Examples
    --------
    >>> [round(each.value, 2) for each in bradley_terry([[0, 30], [10, 0]])]
    [0.53, -0.53]
    """
    counts = np.asarray(wins, dtype=float)
    groups = counts if counts.ndim == 3 else counts[np.newaxis]
    total, n = groups.sum(axis=0), len(groups)
    worths, covariance = _worths(total)
    if n == 1:
        from scipy.special import ndtri

        method = f"Wald over {int(np.sum(total))} choices"
        reach = float(ndtri((1 + CONFIDENCE) / 2)) * np.sqrt(np.diag(covariance))
    else:
        method = f"jackknife over {n} participants"
        without = np.array([_worths(total - own)[0] for own in groups])
        found = [
            mean_interval((n * w - (n - 1) * o).tolist())
            for w, o in zip(worths, without.T, strict=True)
        ]
        reach = np.array([(each.high - each.low) / 2 for each in found])
    return [
        Interval(float(w), float(w - r), float(w + r), n, method)
        for w, r in zip(worths, reach, strict=True)
    ]


def confusion_matrix(
    stimuli: Sequence[str], answers: Sequence[str], labels: Sequence[str]
) -> FloatArray:
    """Return the counts of each answer (column) to each stimulus (row), in order of labels."""
    pairs = list(zip(stimuli, answers, strict=True))
    return np.array([[pairs.count((row, column)) for column in labels] for row in labels], float)


def information_transfer(confusions: ArrayLike) -> Transfer:
    """Return the information that one participant's answers transfer about the stimuli.

    Parameters
    ----------
    confusions : array-like, shape (stimuli, answers)
        Number of trials with each stimulus and answer.

    Returns
    -------
    Transfer
        Information, NaN without trials. The bias (rows - 1) (columns - 1) / (2 trials ln 2) is
        subtracted, for the rows and columns that occur (Miller, in "Information Theory in
        Psychology", 1955).
    """
    counts = np.asarray(confusions, dtype=float)
    n = float(np.sum(counts))
    if not n:
        return Transfer(math.nan, math.nan, math.nan, 0)
    rows, columns = counts.sum(axis=1), counts.sum(axis=0)
    from scipy.special import xlogy

    entropies = [float(np.sum(xlogy(each / n, each / n))) for each in (rows, columns, counts)]
    uncorrected = (entropies[2] - entropies[0] - entropies[1]) / math.log(2)
    freedom = (np.count_nonzero(rows) - 1) * (np.count_nonzero(columns) - 1)
    bits = max(float(uncorrected - freedom / (2 * n * math.log(2))), 0.0)
    return Transfer(bits, uncorrected, 2.0**bits, int(n))


def scale_dissimilarities(dissimilarities: ArrayLike) -> Scaling:
    """Return points of the plane whose distances are close to dissimilarities (metric scaling).

    The fit starts with Torgerson's classical scaling, and reduces the stress by majorization.

    Parameters
    ----------
    dissimilarities : array-like, shape (k, k)
        Dissimilarity of each two conditions, not negative; the mean of both triangles is used.
    """
    given = np.asarray(dissimilarities, dtype=float)
    given = (given + given.T) / 2
    k = len(given)
    centring = np.eye(k) - 1 / k
    values, vectors = np.linalg.eigh(-centring @ given**2 @ centring / 2)
    points = vectors[:, ::-1][:, :2] * np.sqrt(np.maximum(values[::-1][:2], 0))
    errors = math.inf
    for _ in range(_STEPS):
        distances = _distances(points)
        before, errors = errors, float(np.sum((given - distances) ** 2))
        if errors >= before * (1 - _GAIN):
            break
        ratio = np.divide(given, distances, out=np.zeros_like(given), where=distances > 0)
        points = (np.diag(ratio.sum(axis=1)) - ratio) @ points / k
    distances = _distances(points)
    left, sizes, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    power = float(np.sum(distances**2))
    stress = math.sqrt(float(np.sum((given - distances) ** 2)) / power) if power else math.nan
    return Scaling(left * sizes, stress)


def _worths(wins: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return log worths and their covariance, by Newton steps on Firth's score."""
    compared = wins + wins.T
    k = len(wins)
    if np.linalg.matrix_rank(np.diag(compared.sum(axis=1)) - compared) < k - 1:
        raise ValueError("wins: comparisons must connect all conditions")
    worths = np.zeros(k)
    for _ in range(_ITERATIONS):
        p = 1 / (1 + np.exp(worths - worths[:, np.newaxis]))
        weights = compared * p * (1 - p)
        covariance = np.linalg.pinv(np.diag(weights.sum(axis=1)) - weights)
        variances = np.diag(covariance)
        leverage = weights * (variances + variances[:, np.newaxis] - 2 * covariance)
        # The correction adds half a choice to each side; without it, steps are too large.
        weights = weights + leverage * p * (1 - p)
        score = np.sum(wins - compared * p + leverage * (0.5 - p), axis=1)
        step = np.linalg.pinv(np.diag(weights.sum(axis=1)) - weights) @ score
        worths = worths + np.clip(step, -1, 1)
        if np.max(np.abs(step)) < _CLOSE:
            break
    return worths - worths.mean(), np.asarray(covariance, dtype=float)


def _distances(points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(points[:, np.newaxis] - points, axis=2))

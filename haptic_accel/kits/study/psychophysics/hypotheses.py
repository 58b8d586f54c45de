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

"""Tests of a study: one value of each participant, never the trials of all together.

Trials of one participant resemble each other. To count them as independent makes any study
significant (pseudoreplication); the participants are the sample. Student's t-test is the planned
one; signed ranks and flipped signs show whether its result hangs on a normal distribution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np

from haptic_accel.core.evaluation import statistics
from haptic_accel.core.model import FloatArray

_QUANTILES = 400  # of the chi-distribution, for the noncentral t-distribution


@dataclass(frozen=True)
class MeanTest:
    """Test of the participants' mean against a number.

    Attributes
    ----------
    n : int
        Participants with a finite value.
    mean : Interval
        Mean of the differences with Student's interval: of `CONFIDENCE`, or for equivalence of
        1 - 2 alpha, which lies within the margin exactly if equivalence is shown.
    effect : Interval
        Standardised mean difference g_z: Cohen's d_z, corrected for bias (Hedges 1981), with the
        limits of the noncentral t-distribution.
    t, p_t : float
        Statistic and probability of Student's t-test.
    p_ranks, p_signs : float
        Probability of Wilcoxon's signed ranks, and of flipped signs (Fisher 1935).
    p : float
        Planned probability: of Student's t-test, or of flipped signs if all differences are equal.
    significant : bool
        True if it is below alpha.
    """

    n: int
    mean: statistics.Interval
    effect: statistics.Interval
    t: float
    p_t: float
    p_ranks: float
    p_signs: float
    p: float
    significant: bool


def mean_test(
    values: Sequence[float],
    against: float = 0.0,
    alternative: statistics.Alternative | Literal["equivalent"] = "two-sided",
    margin: float = 0.0,
    alpha: float = 0.05,
) -> MeanTest:
    """Test the participants' mean against a number.

    Equivalence is shown by two one-sided tests (Schuirmann, J. Pharmacokinetics and
    Biopharmaceutics 15, 1987): the difference is greater than -margin, and less than margin.

    Parameters
    ----------
    values : sequence of float
        Value of each participant.
    against : float
    alternative : str
        Alternative for value minus `against`: ``two-sided``, ``greater``, ``less`` or
        ``equivalent``.
    margin : float
        Largest difference that counts as equivalent.
    alpha : float
        Probability of an error of the first kind.

    Returns
    -------
    MeanTest
        Without probabilities for fewer than `FEWEST` participants.

    Raises
    ------
    ValueError
        Equivalence has no margin.

    Examples
    --------
    >>> found = mean_test([0.70, 0.62, 0.81, 0.55, 0.74], 0.5, "greater")
    >>> found.significant, round(found.mean.value, 3)
    (True, 0.184)
    """
    if alternative == "equivalent" and not margin > 0:
        raise ValueError(f"margin = {margin:g}: must be positive to test equivalence")
    differences = np.asarray(values, dtype=float) - against
    differences = differences[np.isfinite(differences)]
    n = len(differences)
    sides: tuple[tuple[statistics.Alternative, float], ...] = (
        (("greater", -margin), ("less", margin))
        if alternative == "equivalent"
        else ((alternative, 0.0),)
    )
    confidence = 1 - 2 * alpha if alternative == "equivalent" else statistics.CONFIDENCE
    zero = np.zeros(n).tolist()
    tested = [
        statistics.paired_difference(zero, (differences - at).tolist(), to) for to, at in sides
    ]
    worst = max(tested, key=lambda each: each.p_t)
    p_ranks = max(each.p_wilcoxon for each in tested)
    p_signs = max(statistics.flipped_signs(differences - at, to) for to, at in sides)
    p = p_signs if math.isnan(worst.p_t) else worst.p_t
    mean = statistics.mean_interval(differences.tolist(), confidence)
    mean = replace(mean, method=f"Student's t, {n} participants")
    if math.isnan(worst.p_t):
        # Differences that happen to be equal leave the interval unknown, not empty.
        mean = replace(mean, low=math.nan, high=math.nan, method="no scatter of participants")
    effect = standardised(differences.tolist())
    return MeanTest(n, mean, effect, worst.t, worst.p_t, p_ranks, p_signs, p, p < alpha)


def standardised(differences: Sequence[float]) -> statistics.Interval:
    """Return the standardised mean difference g_z with its interval.

    The mean over the standard deviation, corrected for bias (Hedges, J. Educational Statistics 6,
    1981); limits by inverting the noncentral t-distribution, exact without that correction. NaN
    without scatter.
    """
    found = statistics.paired_difference([0.0] * len(differences), differences)
    n, d = found.n, found.effect
    if n < statistics.FEWEST or math.isnan(d):
        return statistics.Interval(math.nan, math.nan, math.nan, n, "no scatter of participants")
    from scipy.optimize import brentq
    from scipy.special import gammaln, ndtr

    correction = math.exp(gammaln((n - 1) / 2) - gammaln((n - 2) / 2)) / math.sqrt((n - 1) / 2)
    t, tail = d * math.sqrt(n), (1 - statistics.CONFIDENCE) / 2
    spreads = _spreads(n)

    def limit(level: float) -> float:
        def excess(shift: float) -> float:
            return float(np.mean(ndtr(t * spreads - shift))) - level

        found = brentq(excess, -10 - 10 * abs(t), 10 + 10 * abs(t), xtol=1e-4)
        return float(found) / math.sqrt(n)

    return statistics.Interval(d * correction, limit(1 - tail), limit(tail), n, "noncentral t")


@cache
def _spreads(n: int) -> FloatArray:
    """Return quantiles of the estimated over the true standard deviation of n values.

    The mean over them is an integral over its distribution; scipy's own noncentral t-distribution
    fails for large t.
    """
    from scipy.special import chdtri

    return np.sqrt(chdtri(n - 1, (np.arange(_QUANTILES) + 0.5) / _QUANTILES) / (n - 1))

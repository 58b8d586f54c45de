# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sensitivities against published numbers and simulated decisions; intervals by enumeration."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from haptic_accel.core.evaluation.statistics import Interval
from haptic_accel.kits.study import sensitivity
from nightly import rest_slow

# By sensR 1.5-3 (R; Christensen, Brockhoff), twoAFC, triangle and duotrio, as published in
# aigorahub/sensR, tests/fixtures/golden_sensr.json. The duo-trio test is abx with the reference as
# X. For the triangle test, Frijters et al. 1980 and Ennis 1993 have 0.418 at d' = 1, too.
D_PRIMES = [0, 0.5, 1, 1.5, 2, 2.5, 3]
PROPORTIONS = {
    "2ifc": [0.5, 0.6382, 0.7602, 0.8556, 0.9214, 0.9615, 0.9831],
    "odd_one_out": [0.3333, 0.3558, 0.418, 0.5065, 0.6048, 0.6993, 0.7814],
    "abx": [0.5, 0.5223, 0.5825, 0.6635, 0.7468, 0.8196, 0.8765],
}
INVERSE = {
    "2ifc": ([0.55, 0.65, 0.75, 0.85, 0.95], [0.1777, 0.5449, 0.9539, 1.4657, 2.3262]),
    "odd_one_out": (
        [0.3833, 0.4833, 0.5833, 0.6833, 0.7833, 0.8833],
        [0.7551, 1.3779, 1.8912, 2.4114, 3.0129, 3.8408],
    ),
    "abx": ([0.55, 0.65, 0.75, 0.85, 0.95], [0.7614, 1.4206, 2.02, 2.7493, 4.0724]),
}
INTERVALS = [
    ("odd_one_out", 80, (2.5498, 3.7386)),
    ("odd_one_out", 60, (1.4516, 2.4853)),
    ("2ifc", 75, (0.5581, 1.3562)),
    ("abx", 70, (1.1164, 2.2676)),
]

# Least number of correct answers that is significant at 10, 5, 1 and 0.1 % in triangle tests:
# FAO, Guidelines for sensory evaluation, V7180E, appendix A (also ISO 4120).
TRIANGLE_TABLE = {
    10: (6, 7, 8, 9),
    20: (10, 11, 13, 14),
    30: (14, 15, 17, 19),
    60: (26, 27, 30, 33),
    96: (39, 41, 44, 48),
}


@pytest.mark.parametrize("task", sensitivity.CHANCE)
def test_proportions_are_those_of_sensr(task: str) -> None:
    found = sensitivity.proportion_correct(task, np.array(D_PRIMES))
    assert found == pytest.approx(PROPORTIONS[task], abs=1.1e-4)


@pytest.mark.parametrize("task", sensitivity.CHANCE)
def test_sensitivities_are_those_of_sensr(task: str) -> None:
    # Proportions are stated to four digits, which move d' by up to a thousandth.
    proportions, expected = INVERSE[task]
    found = [sensitivity.sensitivity(task, each) for each in proportions]
    assert found == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("task", "correct", "limits"), INTERVALS)
def test_limits_are_those_of_sensr(task: str, correct: int, limits: tuple[float, float]) -> None:
    found = sensitivity.d_prime(task, correct, 100)
    assert (found.low, found.high) == pytest.approx(limits, abs=1e-4)


def test_a_triangle_follows_the_noncentral_f_distribution() -> None:
    # Ura 1960, Brockhoff and Christensen 2010: P(correct) = P(F > 3), 1 and 1 degrees of freedom.
    d = np.linspace(0.1, 6.0, 30)
    expected = stats.ncf.sf(3, 1, 1, 2 * d**2 / 3)
    assert sensitivity.proportion_correct("odd_one_out", d) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("d", "criterion"), [(0.5, 1.0), (1.0, 2.0), (2.5, 1.5)])
def test_same_different_finds_the_d_prime_of_simulated_decisions(
    d: float, criterion: float
) -> None:
    n = 1_000_000
    a, b = np.random.default_rng(2).normal(size=(2, n))
    hits = int(np.sum(abs(a - b - d) > criterion))
    false_alarms = int(np.sum(abs(a - b) > criterion))
    found = sensitivity.d_prime_by_answers(hits, n, false_alarms, n)
    assert found.value == pytest.approx(d, abs=0.015)
    assert found.low <= d <= found.high
    swapped = sensitivity.d_prime_by_answers(false_alarms, n, hits, n)
    assert swapped.value == pytest.approx(-found.value)


@pytest.mark.parametrize("trials", TRIANGLE_TABLE)
def test_exact_binomial_gives_the_table_of_triangle_tests(trials: int) -> None:
    def least(alpha: float) -> int:
        p = [sensitivity.exact_binomial(k, trials, 1 / 3, "greater").p for k in range(trials + 1)]
        return next(k for k in range(trials + 1) if p[k] <= alpha)

    assert tuple(least(alpha) for alpha in (0.1, 0.05, 0.01, 0.001)) == TRIANGLE_TABLE[trials]


@pytest.mark.parametrize(
    ("n", "task"),
    rest_slow(product((10, 30, 100), sensitivity.CHANCE), 2 * len(sensitivity.CHANCE)),
)
def test_d_prime_covers_at_least_as_it_claims(n: int, task: str) -> None:
    found = [sensitivity.d_prime(task, correct, n) for correct in range(n + 1)]
    for d in (0.0, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0):
        weights = stats.binom.pmf(
            range(n + 1), n, sensitivity.proportion_correct(task, np.array(d))
        )
        held = sum(w for w, each in zip(weights, found, strict=True) if each.low <= d <= each.high)
        assert held >= 0.95, d


@pytest.mark.parametrize("n", rest_slow([5, 12, 20], now=2))
def test_d_prime_by_answers_covers_for_each_criterion(n: int) -> None:
    counts = range(n + 1)
    found = [[sensitivity.d_prime_by_answers(h, n, f, n) for f in counts] for h in counts]
    low = np.array([[each.low for each in row] for row in found])
    high = np.array([[each.high for each in row] for row in found])
    for d, criterion in product((0.0, 0.5, 1.0, 2.0, 3.0), (0.5, 1.5, 2.5)):
        normal = stats.norm(scale=math.sqrt(2))
        rates = normal.sf([criterion - d, criterion]) + normal.cdf([-criterion - d, -criterion])
        hit, false_alarm = (stats.binom.pmf(counts, n, rate) for rate in rates)
        assert np.outer(hit, false_alarm)[(low <= d) & (d <= high)].sum() >= 0.94, (d, criterion)


def mean_over_all_outcomes(task: str, d: float, n: int) -> float:
    weights = stats.binom.pmf(range(n + 1), n, sensitivity.proportion_correct(task, np.array(d)))
    return sum(w * sensitivity.d_prime(task, k, n).value for k, w in enumerate(weights))


@pytest.mark.parametrize("d", [0.0, 0.5, 1.0, 2.0])
def test_d_prime_of_2ifc_is_unbiased(d: float) -> None:
    assert mean_over_all_outcomes("2ifc", d, 40) == pytest.approx(d, abs=0.03)


@pytest.mark.parametrize("task", ["odd_one_out", "abx"])
def test_d_prime_of_flat_tasks_is_unbiased_at_chance_and_above_two(task: str) -> None:
    for d in (0.0, 2.0, 3.0):
        assert mean_over_all_outcomes(task, d, 60) == pytest.approx(d, abs=0.03)
    # Between, the proportion is flat: this bias is stated, not hidden.
    assert mean_over_all_outcomes(task, 1.0, 60) == pytest.approx(0.88, abs=0.02)


@given(st.sampled_from(sorted(sensitivity.CHANCE)), st.integers(1, 80), st.data())
def test_d_prime_is_finite_and_within_its_limits(task: str, n: int, data: st.DataObject) -> None:
    found = sensitivity.d_prime(task, data.draw(st.integers(0, n)), n)
    assert math.isfinite(found.value)
    assert found.low <= found.value <= found.high


@given(st.integers(1, 30), st.integers(1, 30), st.data())
def test_d_prime_by_answers_is_finite_and_within_its_limits(
    different: int, same: int, data: st.DataObject
) -> None:
    hits, false_alarms = data.draw(st.integers(0, different)), data.draw(st.integers(0, same))
    found = sensitivity.d_prime_by_answers(hits, different, false_alarms, same)
    assert math.isfinite(found.value)
    assert found.low <= found.value <= found.high


def test_an_upper_limit_is_infinite_without_an_error() -> None:
    assert sensitivity.d_prime("2ifc", 20, 20).high == math.inf
    assert sensitivity.d_prime_by_answers(20, 20, 0, 20).high == math.inf


EMPTY = [sensitivity.d_prime("abx", 0, 0), sensitivity.d_prime_by_answers(0, 0, 1, 2)]


@pytest.mark.parametrize("found", [*EMPTY, sensitivity.exact_binomial(0, 0, 0.5).interval])
def test_without_trials_there_is_no_number(found: Interval) -> None:
    assert math.isnan(found.value)
    assert math.isnan(found.low)
    assert "no trial" in found.method


def test_more_answers_than_trials_are_refused() -> None:
    with pytest.raises(ValueError, match="11 answers of 10 trials"):
        sensitivity.d_prime("2ifc", 11, 10)
    with pytest.raises(ValueError, match="-1 answers"):
        sensitivity.d_prime_by_answers(-1, 10, 0, 10)

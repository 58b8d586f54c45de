# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Intervals and tests against numbers that tables and scipy have."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from haptic_accel.core.evaluation import statistics
from haptic_accel.core.model import FloatArray
from nightly import rest_slow

# Student's own example, 1908: additional hours of sleep from two drugs, ten patients.
SLEEP = (
    [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0],
    [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4],
)


def test_students_sleep() -> None:
    found = statistics.paired_difference(*SLEEP)
    assert found.n == 10
    assert found.mean.value == pytest.approx(1.58)
    assert (found.mean.low, found.mean.high) == pytest.approx((0.7001142, 2.4598858))
    assert found.t == pytest.approx(4.062128, rel=1e-6)
    assert found.p_t == pytest.approx(0.00283289, rel=1e-5)
    assert found.effect == pytest.approx(4.062128 / math.sqrt(10), rel=1e-6)
    # Nine differences are positive, one is zero.
    assert found.p_wilcoxon == pytest.approx(2 / 2**9)
    assert "10 pairs" in found.verdict


@pytest.mark.parametrize("n", range(statistics.FEWEST))
def test_few_pairs_have_no_probability(n: int) -> None:
    found = statistics.paired_difference(SLEEP[0][:n], SLEEP[1][:n])
    assert math.isnan(found.p_t)
    assert math.isnan(found.p_wilcoxon)
    assert "too few" in found.verdict or "no pair" in found.verdict


def test_wilcoxon_waits_for_enough_pairs() -> None:
    fewer = statistics.FEWEST_RANKED - 1
    found = statistics.paired_difference(SLEEP[0][:fewer], SLEEP[1][:fewer])
    assert math.isfinite(found.p_t)
    assert math.isnan(found.p_wilcoxon)
    assert f"needs {statistics.FEWEST_RANKED} pairs" in found.verdict


def test_signed_ranks_are_those_of_scipy_without_ties() -> None:
    for n in (6, 9, 15, 30):
        second = np.random.default_rng(n).normal(0.4, 1.0, n)
        found = statistics.paired_difference([0.0] * n, second.tolist())
        assert found.p_wilcoxon == pytest.approx(stats.wilcoxon(second).pvalue)


def test_equal_proportions_are_ties_in_spite_of_rounding() -> None:
    # Ranks 3.5 of all six, all positive but one of the least possible: by hand, 14 of 2^6 flips.
    first, second = [0.3, 0.6, 0.1, 0.7, 0.2, 0.5], [0.4, 0.7, 0.2, 0.8, 0.3, 0.4]
    assert statistics.paired_difference(first, second).p_wilcoxon == pytest.approx(14 / 64)


@pytest.mark.parametrize(("alternative", "flips"), [("greater", 1), ("less", 8), ("two-sided", 2)])
def test_flips_of_signs_are_counted(alternative: statistics.Alternative, flips: int) -> None:
    assert statistics.flipped_signs(np.array([1.0, 2.0, 4.0]), alternative) == flips / 8


def test_equal_differences_are_not_tested() -> None:
    found = statistics.paired_difference([1.0, 2.0, 3.0], [1.1, 2.1, 3.1])
    assert found.mean.value == pytest.approx(0.1)
    assert math.isnan(found.p_t)
    assert "scatter" in found.verdict


def test_sides_must_be_pairs() -> None:
    with pytest.raises(ValueError, match="pairs"):
        statistics.paired_difference([1.0], [])


@given(st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=30))
def test_a_mean_lies_within_its_interval(values: list[float]) -> None:
    found = statistics.mean_interval(values)
    assert found.low <= found.value <= found.high
    assert found.n == len(values)


@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=30), st.sampled_from([1.0, math.inf]))
def test_an_interval_stays_within_the_range_of_its_values(
    values: list[float], highest: float
) -> None:
    found = statistics.mean_interval(values, within=(0.0, highest))
    assert 0.0 <= found.low <= found.value * (1 + 1e-9)
    assert found.value <= found.high * (1 + 1e-9) <= highest * (1 + 1e-9)


def test_far_from_the_ends_of_a_range_an_interval_is_students() -> None:
    values = [100.0, 101.0, 99.0, 100.5]
    free = statistics.mean_interval(values)
    for highest in (math.inf, 1000.0):
        found = statistics.mean_interval(values, within=(0.0, highest))
        assert (found.low, found.high) == pytest.approx((free.low, free.high), rel=2e-4)


@pytest.mark.parametrize("n", rest_slow([3, 5, 20]))
@pytest.mark.parametrize(
    ("draw", "mean", "highest"),
    [
        (lambda r, n: r.gamma(100.0, 0.01, n), 1.0, math.inf),  # nearly normal
        (lambda r, n: r.exponential(1.0, n), 1.0, math.inf),
        (lambda r, n: r.uniform(0.0, 1.0, n), 0.5, 1.0),
        (lambda r, n: r.beta(2.0, 0.5, n), 0.8, 1.0),
    ],
)
def test_intervals_hold_the_mean_nearly_as_often_as_they_say(
    n: int, draw: Callable[[np.random.Generator, int], FloatArray], mean: float, highest: float
) -> None:
    generator, draws = np.random.default_rng(n), 2000
    found = [
        statistics.mean_interval(draw(generator, n).tolist(), within=(0.0, highest))
        for _ in range(draws)
    ]
    share = sum(each.low <= mean <= each.high for each in found) / draws
    # Three standard errors of the simulation are 0.015.
    assert statistics.CONFIDENCE - 0.03 - 0.015 <= share <= statistics.CONFIDENCE + 0.02


def test_a_mean_leaves_out_what_is_no_number() -> None:
    assert statistics.mean_interval([1.0, math.nan, 3.0]).value == 2.0
    assert statistics.mean_interval([math.nan]).n == 0


@pytest.mark.parametrize("values", [[5.0], [1.0, 3.0], [1.0, 3.0, math.nan]])
def test_below_three_values_there_is_no_interval(values: list[float]) -> None:
    found = statistics.mean_interval(values)
    assert found.value == np.nanmean(values)
    assert math.isnan(found.low)
    assert math.isnan(found.high)
    assert "too few" in found.method


def test_the_bootstrap_holds_the_true_error() -> None:
    generator = np.random.default_rng(4)
    held = []
    for _ in range(40):
        desired = generator.normal(size=4000)
        actual = desired + 0.5 * generator.normal(size=4000)
        found = statistics.nrmse_interval(desired, actual, 200.0)
        assert found.low <= found.value <= found.high
        assert "20 pieces" in found.method
        held.append(found.low <= 0.5 <= found.high)
    assert np.mean(held) > 0.8


def test_a_short_trial_has_no_interval() -> None:
    found = statistics.nrmse_interval(np.ones(2000), 0.5 * np.ones(2000), 1000.0)
    assert found.value == 0.5
    assert math.isnan(found.low)
    assert "too few" in found.method
    assert math.isnan(statistics.nrmse_interval(np.zeros(10), np.ones(10), 1000.0).value)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Planned tests: which value each participant has, and what it is tested against."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kits.study.study_sessions import (
    ADAPTIVE,
    MASS,
    NONE,
    Answering,
    paired,
    protocol,
    session,
    single,
)
from scipy import stats

from haptic_accel.kits.study.folder import templates
from haptic_accel.kits.study.planned_tests import (
    PlannedResult,
    counted,
    mean_test,
    planned_tests,
    standardised,
    values,
)
from haptic_accel.kits.study.protocol import PlannedTest, Protocol, Rules
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.sensitivity import d_prime
from haptic_accel.kits.study.session import simulate_study
from haptic_accel.kits.study.trials import CATCH, PlannedTrial, SessionRecord

# Student 1908: hours of sleep gained by ten patients from two drugs (R's data set "sleep").
SLEEP = np.subtract(
    [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0],
    [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4],
).tolist()

# Darwin's maize, Fisher, "The Design of Experiments", 1935, chapter III: differences in height of
# 15 pairs, eighths of an inch. 863 of the 2^15 flips of signs have a sum of at least 314.
MAIZE = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]


def test_students_sleep() -> None:
    found = mean_test(SLEEP)
    assert found.n == 10
    assert found.mean.value == pytest.approx(-1.58)
    assert (found.mean.low, found.mean.high) == pytest.approx((-2.4598858, -0.7001142))
    assert (found.t, found.p_t) == pytest.approx((-4.062128, 0.00283289), rel=1e-5)
    assert found.p == found.p_t
    assert found.significant


def test_sides_of_students_sleep() -> None:
    less, greater = mean_test(SLEEP, 0.0, "less"), mean_test(SLEEP, 0.0, "greater")
    assert less.p_t == pytest.approx(0.001416445, rel=1e-4)
    assert greater.p_t == pytest.approx(1 - less.p_t)
    assert not greater.significant


def test_equivalence_of_students_sleep() -> None:
    # As two t-tests against a shifted mean, in scipy.
    found = mean_test(SLEEP, 0.0, "equivalent", margin=2.5)
    sides = {"greater": -2.5, "less": 2.5}
    expected = [stats.ttest_1samp(SLEEP, sides[each], alternative=each).pvalue for each in sides]
    assert found.p_t == pytest.approx(max(expected))
    assert found.significant
    # The interval of 90 % lies within the margin exactly if equivalence is shown.
    assert -2.5 < found.mean.low < found.mean.high < 2.5
    assert found.mean.low == pytest.approx(-1.58 - 1.833113 * 1.229995 / math.sqrt(10), rel=1e-5)
    assert not mean_test(SLEEP, 0.0, "equivalent", margin=2.2).significant


def test_fishers_flipped_signs() -> None:
    assert mean_test(MAIZE, 0.0, "greater").p_signs == pytest.approx(863 / 2**15)
    assert mean_test(MAIZE).p_signs == pytest.approx(1726 / 2**15)


def test_signed_ranks_are_those_of_scipy() -> None:
    found = mean_test(MAIZE, 1.5, "greater")
    expected = stats.wilcoxon(np.array(MAIZE) - 1.5, alternative="greater").pvalue
    assert found.p_ranks == pytest.approx(expected)


def test_effect_size_of_students_sleep() -> None:
    found = mean_test(SLEEP).effect
    # d_z = t / sqrt(n) = 1.2846; Hedges' exact correction for 9 degrees of freedom is 0.9139.
    correction = math.gamma(4.5) / math.gamma(4) / math.sqrt(4.5)
    assert correction == pytest.approx(0.9139, abs=1e-4)
    assert found.value == pytest.approx(-1.2846 * correction, abs=1e-4)
    shift = np.array([found.low, found.high]) * math.sqrt(10)
    assert stats.nct.cdf(-4.062128, 9, shift) == pytest.approx([0.975, 0.025], abs=1e-3)


def test_few_participants_have_no_probability() -> None:
    for few in ([], [0.6], [0.6, 0.7]):
        found = mean_test(few, 0.5)
        assert math.isnan(found.p)
        assert not found.significant


def test_participants_without_a_value_are_left_out() -> None:
    found = mean_test([1.0, math.nan, 1.5, math.inf, 1.25])
    assert found.n == 3
    assert found.mean.value == pytest.approx((1.0 + 1.5 + 1.25) / 3)


def test_equal_participants_have_no_interval_but_flipped_signs() -> None:
    found = mean_test([1.0] * 6, 0.5, "greater")
    assert math.isnan(found.mean.low)
    assert math.isnan(found.effect.value)
    assert found.p == found.p_signs == pytest.approx(1 / 64)


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="margin = 0: must be positive"):
        mean_test([1.0, 2.0, 3.0], 0.0, "equivalent")


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=12))
def test_any_values_give_ordered_intervals(values: list[float]) -> None:
    found = mean_test(values)
    assert 0 <= found.p <= 1
    for each in (found.mean, found.effect):
        assert math.isnan(each.low) or each.low <= each.value <= each.high


def rejections(studies: int, draw: Callable[[int], list[float]], **how: Any) -> float:
    return float(np.mean([mean_test(draw(seed), **how).significant for seed in range(studies)]))


def guesses(seed: int, participants: int = 10, trials: int = 40) -> list[float]:
    """Return proportions correct of participants who guess between two answers."""
    rng = np.random.default_rng([seed, 1])
    return (rng.binomial(trials, 0.5, participants) / trials).tolist()


@pytest.mark.slow
def test_guessing_is_significant_as_often_as_alpha() -> None:
    # Of 1000 studies: 0.05 with a standard error of 0.007.
    assert rejections(1000, guesses, against=0.5) == pytest.approx(0.05, abs=0.021)


@pytest.mark.slow
@pytest.mark.parametrize("task", ["odd_one_out", "abx"])
def test_d_prime_of_guessing_is_significant_as_often_as_alpha(task: str) -> None:
    chance = 1 / 3 if task == "odd_one_out" else 1 / 2
    known = [d_prime(task, correct, 30).value for correct in range(31)]

    def draw(seed: int) -> list[float]:
        return [known[k] for k in np.random.default_rng([seed, 2]).binomial(30, chance, 10)]

    assert rejections(1000, draw, alternative="greater") <= 0.071


def normal(stream: int, mean: float, spread: float, number: int) -> Callable[[int], list[float]]:
    """Return a draw of normal values of participants, by the seed of a study."""
    return lambda seed: np.random.default_rng([seed, stream]).normal(mean, spread, number).tolist()


@pytest.mark.slow
def test_power_is_that_of_the_noncentral_t() -> None:
    critical = stats.t.ppf(0.975, 11)
    expected = stats.nct.sf(critical, 11, 0.9 * math.sqrt(12))
    assert rejections(1000, normal(3, 0.9, 1.0, 12)) == pytest.approx(expected, abs=0.04)


@pytest.mark.slow
def test_a_difference_as_large_as_the_margin_is_seldom_equivalent() -> None:
    found = rejections(1000, normal(4, 0.5, 0.3, 12), alternative="equivalent", margin=0.5)
    assert found == pytest.approx(0.05, abs=0.021)


@pytest.mark.slow
@pytest.mark.parametrize("effect", [0.0, 0.8, 2.0])
def test_effect_sizes_are_unbiased_and_covered(effect: float) -> None:
    found = [standardised(normal(5, effect, 1.0, 10)(seed)) for seed in range(1000)]
    assert np.mean([each.value for each in found]) == pytest.approx(effect, abs=0.07)
    held = np.mean([each.low <= effect <= each.high for each in found])
    assert held == pytest.approx(0.95, abs=0.021)


def unruled(task: str, **changes: object) -> Protocol:
    """Return a study without right answers, whose catch trials do not exclude."""
    return protocol(task, rules=Rules(catch_correct=0.0), **changes)


def with_test(study: Protocol, measure: str, condition: str = "", **changes: object) -> Protocol:
    given = {"name": "test", "measure": measure, "condition": condition, **changes}
    return replace(study, tests=(PlannedTest(**given),))  # type: ignore[arg-type]


def wrong_at(*numbers: int) -> Answering:
    """Return answers that are wrong at some main trials."""

    def answer(trial: PlannedTrial, _: np.random.Generator) -> str:
        wrong = [each for each in trial.answers if each != trial.right]
        return wrong[0] if trial.number in numbers and trial.kind != CATCH else trial.right

    return answer


def preferring(order: Mapping[str, float]) -> Answering:
    """Return the interval with the stronger condition."""

    def answer(trial: PlannedTrial, _: np.random.Generator) -> str:
        first, second = (order[str(each)] for each in trial.stimuli)
        return "1" if first > second else "2"

    return answer


def rated(ratings: Mapping[str, float], more: float = 0.0) -> Answering:
    return lambda trial, _: str(ratings[str(trial.stimuli[0])] + more)


def sessions(study: Protocol, *answers: Answering) -> list[SessionRecord]:
    trials = paired(study, 10) if study.pairs else single(study, 5)
    return [session(study, f"P{i}", trials, answer) for i, answer in enumerate(answers)]


def only_result(study: Protocol, *answers: Answering) -> PlannedResult:
    """Return the result of a study's only test."""
    (result,) = planned_tests(study, sessions(study, *answers))
    return result


def test_each_participant_has_one_value_whatever_the_number_of_trials() -> None:
    study = with_test(protocol("2ifc"), "correct")
    result = only_result(study, *[wrong_at(1), wrong_at(1, 2), wrong_at()] * 2)
    assert list(result.values.values()) == [0.95, 0.9, 1.0] * 2
    assert result.outcome.n == 6
    assert result.against == 0.5
    assert result.mean.value == pytest.approx(0.95)
    assert result.outcome.significant


def test_the_interval_of_a_share_ends_at_one() -> None:
    study = with_test(protocol("2ifc"), "correct")
    result = only_result(study, wrong_at(1, 2, 3, 4, 5), wrong_at(), wrong_at())
    assert result.outcome.mean.high + result.against > 1.0, "Student's own"
    assert (result.mean.low < result.mean.value, result.mean.high) == (True, 1.0)


def test_a_test_of_a_condition_has_the_trials_whose_comparison_it_is() -> None:
    # Odd trials compare adaptive, even ones mass, both with none.
    study = with_test(protocol("2ifc"), "correct", "controller=mass")
    assert only_result(study, wrong_at(2, 3)).values == {"P0": 0.9}
    against = "controller=adaptive"
    study = with_test(protocol("2ifc"), "correct", "controller=mass", against=against)
    result = only_result(study, wrong_at(2, 4), wrong_at(3), wrong_at(2))
    assert list(result.values.values()) == pytest.approx([-0.2, 0.1, -0.1])
    assert result.against == 0.0
    assert result.measured == "difference of proportion correct"


def test_excluded_participants_and_other_kinds_of_trials_do_not_count() -> None:
    study = with_test(protocol("2ifc"), "correct")
    found = sessions(study, wrong_at(0), wrong_at(1), wrong_at())
    (result,) = planned_tests(study, [*found[:2], replace(found[2], ended="stopped")])
    assert result.values == {"P0": 1.0, "P1": 0.95}
    assert len(counted(study, found)) == 3 * 20


def test_sensitivity_follows_the_task() -> None:
    """Of 20 trials, 15 right: d' of the log-linear proportion 15.5 / 21 (2IFC: sqrt 2 z)."""
    result = only_result(with_test(protocol("2ifc"), "d_prime"), wrong_at(1, 2, 3, 4, 5))
    assert result.values["P0"] == pytest.approx(math.sqrt(2) * 0.6372, abs=2e-3)


def test_same_and_different_answers_give_d_prime_by_their_rates() -> None:
    study = with_test(read_protocol(templates()["compensated_or_not"]), "d_prime")
    (result,) = planned_tests(study, simulate_study(study, 12, 5))
    assert result.mean.low < 2.0 < result.mean.high
    assert result.against == 0.0


def test_preference_is_a_share_of_the_trials_with_the_condition() -> None:
    study = unruled("preference")
    order = {str(NONE): 1.0, str(MASS): 0.0, str(ADAPTIVE): 2.0}
    expected = {
        ("controller=adaptive", ""): 1.0,
        ("controller=none", ""): 0.5,
        ("controller=none", "controller=adaptive"): 0.0,
        ("controller=none", "controller=mass"): 1.0,
        ("controller=none", "0.25"): 0.5,
    }
    for (condition, against), share in expected.items():
        asked = with_test(study, "preferred", condition, against=against)
        result = only_result(asked, preferring(order))
        assert result.values == {"P0": share}
        assert result.against == (0.25 if against == "0.25" else 0.5)


def test_a_condition_that_was_never_compared_has_no_value() -> None:
    given = {"against": "controller=adaptive"}
    study = with_test(unruled("preference"), "preferred", "controller=mass", **given)
    result = only_result(study, preferring(dict.fromkeys(map(str, (NONE, MASS, ADAPTIVE)), 0.0)))
    assert result.values == {}
    assert not result.outcome.significant


def test_ratings_of_two_conditions_are_paired_by_participant() -> None:
    study = unruled("rating", pairs=())
    ratings = {str(NONE): 20.0, str(MASS): 40.0, str(ADAPTIVE): 60.0}
    paired = with_test(study, "rating", "controller=adaptive", against="controller=mass")
    result = only_result(paired, *(rated(ratings, i) for i in range(3)))
    assert list(result.values.values()) == [20.0] * 3
    assert only_result(with_test(study, "rating"), rated(ratings)).values == {"P0": 40.0}


def test_thresholds_of_simulated_observers_are_found() -> None:
    study = read_protocol(templates()["network_delay"])
    observer = replace(study.observer, threshold=60.0, spread=0.0)
    study = replace(study, observer=observer, procedure=replace(study.procedure, repeats=60))
    (result,) = planned_tests(study, simulate_study(study, 8, 2))
    assert float(np.median(list(result.values.values()))) == pytest.approx(60.0, rel=0.2)
    assert result.outcome.significant


def test_equivalence_is_tested_within_its_margin() -> None:
    study = unruled("rating", pairs=())
    ratings = {str(NONE): 20.0, str(MASS): 41.0, str(ADAPTIVE): 40.0}
    given = {"alternative": "equivalent", "against": "controller=mass"}
    answers = [rated(ratings | {str(MASS): 39.0 + i / 2}) for i in range(5)]
    for margin, shown in ((5.0, True), (0.5, False)):
        asked = with_test(study, "rating", "controller=adaptive", margin=margin, **given)
        assert only_result(asked, *answers).outcome.significant is shown


def test_a_study_without_sessions_has_results_without_values() -> None:
    study = with_test(protocol("2ifc"), "correct")
    (result,) = planned_tests(study, [])
    assert result.values == values(study, [], study.tests[0], "") == {}
    assert math.isnan(result.mean.value)

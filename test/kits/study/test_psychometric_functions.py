# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Psychometric functions of simulated participants, and beside psignifit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kits.study.protocol_maker import make_levels
from kits.study.study_runs import asking, run
from scipy import stats

from haptic_accel.core.model import FloatArray
from haptic_accel.kits.study.procedures import Plan
from haptic_accel.kits.study.protocol import Extras, Observer, Procedure
from haptic_accel.kits.study.sensitivity import (
    CHANCE,
    LAPSE,
    SIGMOIDS,
    SLOPE_MARGIN,
    SLOPES,
    Psychometric,
    fit_psychometric,
    proportion_correct,
)
from haptic_accel.kits.study.session import SimulatedParticipant

LEVELS: FloatArray = np.array([0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8])
Curve = Callable[[FloatArray], FloatArray]


def observer(
    task: str = "2ifc", threshold: float = 1.0, slope: float = 1.0, lapse: float = 0.02
) -> Curve:
    """Return the proportion correct of `protocol.Observer` over the distance."""

    def proportion(distances: FloatArray) -> FloatArray:
        known = proportion_correct(task, (distances / threshold) ** slope)
        return (1 - lapse) * known + lapse * CHANCE[task]

    return proportion


def constant_stimuli(
    proportion: Curve, repeats: int, rng: np.random.Generator, task: str = "2ifc"
) -> Psychometric:
    trials = [repeats] * len(LEVELS)
    return fit_psychometric(LEVELS, rng.binomial(trials, proportion(LEVELS)), trials, task)


def staircase(proportion: Curve, rng: np.random.Generator, trials: int = 60) -> Psychometric:
    """Fit two interleaved tracks of one up, two down, with steps of 1.41."""
    levels, rows, right = [2.8, 1.4], [], [0, 0]
    for trial in range(trials):
        track = trial % 2
        correct = bool(rng.random() < proportion(np.array(levels[track])))
        rows.append((levels[track], correct, 1))
        right[track] = right[track] + 1 if correct else 0
        if not correct or right[track] == 2:
            step = 1 / 1.41 if correct else 1.41
            levels[track] = min(max(levels[track] * step, 0.1), 10.0)
            right[track] = 0
    distances, answers, ones = zip(*rows, strict=True)
    return fit_psychometric(distances, answers, ones, "2ifc")


@pytest.mark.parametrize("task", CHANCE)
@pytest.mark.parametrize(("threshold", "slope"), [(0.8, 1.0), (1.5, 1.0), (1.0, 2.5)])
def test_a_long_study_finds_the_observer(task: str, threshold: float, slope: float) -> None:
    levels, n = np.array([0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 20.0]), 5000
    right = np.round(n * observer(task, threshold, slope)(levels))
    found = fit_psychometric(levels, right, [n] * 8, task)
    assert found.threshold.value == pytest.approx(threshold, rel=0.01)
    assert found.slope.value == pytest.approx(slope, rel=0.02)
    assert found.lapse.value == pytest.approx(0.02 * (1 - CHANCE[task]), abs=0.002)
    assert found.proportion(levels) == pytest.approx(right / n, abs=2e-3)


def logarithmic_priors(x: FloatArray) -> dict[str, Callable[[FloatArray], FloatArray]]:
    """Return the priors of the fit as functions of psignifit's parameters."""
    per_width = stats.norm.ppf(0.95) - stats.norm.ppf(0.05)
    lowest, highest = np.log(SLOPES)

    def falling(beyond: FloatArray) -> FloatArray:
        return (1 + np.cos(np.pi * np.clip(beyond, 0, 1))) / 2

    def threshold(m: FloatArray) -> FloatArray:
        return falling(np.maximum(x[0] - m, m - x[-1]) / (x[-1] - x[0]))

    def width(w: FloatArray) -> FloatArray:
        slope = np.log(per_width / w)
        return falling(np.maximum(lowest - slope, slope - highest) / SLOPE_MARGIN)

    lapses = stats.beta(1, LAPSE)
    return {"threshold": threshold, "width": width, "lambda": lapses.pdf}


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_is_that_of_psignifit(seed: int) -> None:
    psignifit = pytest.importorskip("psignifit")
    x, n = np.log(LEVELS), 40
    right = np.random.default_rng(seed).binomial(n, 0.5 + 0.49 * stats.norm.cdf(1.2 * x))
    ours = fit_psychometric(LEVELS, right, [n] * len(x), "2ifc", sigmoid="normal")

    priors = logarithmic_priors(x)
    options = {
        "experiment_type": "2AFC",
        "sigmoid": "norm",
        "priors": priors,
        "verbose": False,
        "fixed_parameters": {"eta": 0},  # no overdispersion
        # psignifit's own bound on the width is three times the range.
        "bounds": {"width": (0.33, 16), "threshold": (x[0] - 2, x[-1] + 2), "lambda": (0, 0.2)},
        "grid_steps": {"threshold": 60, "width": 60, "lambda": 40},
    }
    data = np.stack([x, right, np.full(len(x), n)], axis=1)
    best = psignifit.psignifit(data, **options).parameter_estimate
    per_width = stats.norm.ppf(0.95) - stats.norm.ppf(0.05)
    assert math.log(ours.threshold.value) == pytest.approx(best["threshold"], abs=0.01)
    assert ours.slope.value == pytest.approx(per_width / best["width"], rel=0.02)
    assert ours.lapse.value == pytest.approx(best["lambda"], abs=0.002)

    # Ours is a density over the logarithm of the slope, psignifit's is one over the width.
    options["priors"] = {**priors, "width": lambda w: priors["width"](w) / w}
    limits = psignifit.psignifit(data, **options).confidence_intervals
    low, high = limits["threshold"]["0.95"]
    found = np.log([ours.threshold.low, ours.threshold.high])
    # A grid of 60 thresholds shifts psignifit's limits down by 0.02; ours is within 0.03.
    assert found == pytest.approx([low, high], abs=0.06)
    low, high = limits["width"]["0.95"]
    slope = ours.slope
    assert [slope.low, slope.high] == pytest.approx([per_width / high, per_width / low], rel=0.08)


TRUTHS = [{}, {"lapse": 0.0}, {"lapse": 0.1}]
TRUTHS += [{"slope": 2.0}, {"threshold": 0.5}, {"threshold": 2.0}]
"""Observers that differ from one of threshold 1, slope 1 and 2 % of random answers."""


def study(method: str, truth: dict[str, float], seed: int) -> Psychometric:
    rng = np.random.default_rng([seed, 7])
    if method == "staircase":
        return staircase(observer(**truth), rng)
    return constant_stimuli(observer(**truth), 20, rng)


def check(method: str, truth: dict[str, float], studies: int) -> None:
    """Check bias and coverage of threshold and slope; bounds allow for three standard errors."""
    found = [study(method, truth, seed) for seed in range(studies)]
    noise = 3 * math.sqrt(0.05 * 0.95 / studies)
    for name in ("threshold", "slope"):
        intervals, true = [getattr(each, name) for each in found], truth.get(name, 1.0)
        assert np.mean([each.low <= true <= each.high for each in intervals]) >= 0.94 - noise, name
    thresholds = [each.threshold.value for each in found]
    bias = np.mean(np.log(thresholds)) - math.log(truth.get("threshold", 1.0))
    assert abs(bias) < 0.06 + (0.1 if truth.get("lapse", 0) == 0.1 else 0)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["constant", "staircase"])
def test_thresholds_of_1000_studies_are_unbiased_and_covered(method: str) -> None:
    check(method, {}, 1000)


@pytest.mark.parametrize("truth", TRUTHS, ids=str)
def test_other_observers_are_found_and_covered(truth: dict[str, float]) -> None:
    check("constant", truth, 100)


def test_a_participant_who_guesses_or_makes_no_errors_has_no_limit() -> None:
    assert fit_psychometric(LEVELS, [10] * 7, [20] * 7, "2ifc").threshold.high == math.inf
    assert fit_psychometric(LEVELS, [20] * 7, [20] * 7, "2ifc").threshold.low == 0.0


def test_equal_levels_are_pooled() -> None:
    single = fit_psychometric([1, 2, 1, 2, 1], [1, 1, 0, 1, 1], [1] * 5, "abx")
    assert single == fit_psychometric([1, 2], [2, 2], [3, 2], "abx")


WRONG = [([1.0], [0], [0]), ([0.0, 1.0], [1, 1], [2, 2]), ([1.0], [3], [2]), ([1.0], [-1], [2])]


@pytest.mark.parametrize(("distances", "correct", "trials"), WRONG)
def test_impossible_counts_are_refused(
    distances: list[float], correct: list[int], trials: list[int]
) -> None:
    with pytest.raises(ValueError, match="needs trials at positive distances"):
        fit_psychometric(distances, correct, trials, "2ifc")


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(CHANCE)),
    st.sampled_from(sorted(SIGMOIDS)),
    st.lists(
        st.tuples(st.floats(1e-3, 1e3), st.integers(0, 12), st.integers(0, 12)),
        min_size=1,
        max_size=9,
    ).filter(lambda rows: any(right + wrong for _, right, wrong in rows)),
)
def test_any_answers_give_an_ordered_result(
    task: str, sigmoid: str, rows: list[tuple[float, int, int]]
) -> None:
    distances, right, wrong = map(np.array, zip(*rows, strict=True))
    found = fit_psychometric(distances, right, right + wrong, task, sigmoid)
    for each in (found.threshold, found.slope, found.lapse):
        assert math.isfinite(each.value)
        assert each.low <= each.value <= each.high
    curve = found.proportion(np.geomspace(1e-3, 1e3, 50))
    assert np.all(np.diff(curve) >= 0)
    assert curve[0] >= CHANCE[task] - 1e-9
    assert curve[-1] <= 1


@pytest.mark.parametrize("kind", ["constant", "staircase", "quest_plus"])
def test_thresholds_of_simulated_participants_are_covered_by_each_procedure(kind: str) -> None:
    procedure = Procedure(kind, repeats=10, trials=60, step_up=1.4, step_down=1.4)
    given = {"procedure": procedure, "extras": Extras(practice=0)}
    values, observed = (1.1, 1.2, 1.3, 1.4, 1.6, 1.8, 2.2), Observer(threshold=0.4)
    protocol = make_levels(values, "log", observer=observed, **given)
    found = []
    for seed in range(10):
        records = list(run(Plan(protocol, seed, 0), asking(SimulatedParticipant(protocol, seed))))
        distances = [abs((each.trial.level or math.nan) - 1.0) for each in records]
        correct = [bool(each.correct) for each in records]
        found.append(fit_psychometric(distances, correct, [1] * len(records), "2ifc").threshold)
    assert sum(each.low <= 0.4 <= each.high for each in found) >= 8
    assert np.median([each.value for each in found]) == pytest.approx(0.4, rel=0.35)

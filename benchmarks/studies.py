# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bias of the statistics of a study, and coverage of their intervals.

``python benchmarks/studies.py`` prints, for many observers,

- d' of each task: mean of the estimates and share of intervals that hold the true value, by
  counting all outcomes;
- thresholds and slopes by constant stimuli and by a staircase, from simulated studies, with the
  coverage of parametric bootstrap intervals of the same fit beside it.
"""

from __future__ import annotations

import argparse
from itertools import product

import numpy as np

from haptic_accel import FloatArray
from haptic_accel.kits.study.sensitivity import (
    CHANCE,
    Psychometric,
    d_prime,
    fit_psychometric,
    proportion_correct,
)

LEVELS: FloatArray = np.array([0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8])
OBSERVERS = (
    # threshold, slope, share of random answers
    (1.0, 1.0, 0.02),
    (1.0, 1.0, 0.0),
    (1.0, 1.0, 0.1),
    (1.0, 2.0, 0.02),
    (0.5, 1.0, 0.02),
    (2.0, 1.0, 0.02),
    (4.0, 1.0, 0.02),
)
BOOTSTRAP = 200
"""Draws of a bootstrap interval; each costs a fit."""

BOOTSTRAPPED = 50
"""Studies with bootstrap intervals."""


def print_sensitivities() -> None:
    """Print mean and coverage of d' by task, number of trials and true value."""
    from scipy import stats

    print(f"{'task':12} {'trials':>6} {'d prime':>8} {'mean':>6} {'covered':>8}")
    for task, n in product(CHANCE, (10, 30, 60, 200)):
        found = [d_prime(task, correct, n) for correct in range(n + 1)]
        for true in (0.0, 0.5, 1.0, 2.0, 3.0, 4.0):
            rate = float(proportion_correct(task, np.array(true)))
            weights = stats.binom.pmf(np.arange(n + 1), n, rate)
            mean = sum(w * each.value for w, each in zip(weights, found, strict=True))
            held = [each.low <= true <= each.high for each in found]
            print(f"{task:12} {n:6} {true:8.1f} {mean:6.2f} {float(weights @ held):8.3f}")


def proportion(distances: FloatArray, observer: tuple[float, float, float]) -> FloatArray:
    """Return the proportion correct of an observer in comparisons."""
    threshold, slope, lapse = observer
    known = proportion_correct("2ifc", (distances / threshold) ** slope)
    return np.asarray((1 - lapse) * known + lapse / 2)


def constant_stimuli(
    observer: tuple[float, float, float], repeats: int, rng: np.random.Generator
) -> Psychometric:
    """Fit a study with the same number of trials at each level."""
    trials = np.full(len(LEVELS), repeats)
    return fit_psychometric(
        LEVELS, rng.binomial(trials, proportion(LEVELS, observer)), trials, "2ifc"
    )


def staircase(
    observer: tuple[float, float, float], trials: int, rng: np.random.Generator
) -> Psychometric:
    """Fit two interleaved tracks of one up, two down, with steps of 1.41."""
    levels, right = [2.8, 1.4], [0, 0]
    rows: list[tuple[float, bool]] = []
    for trial in range(trials):
        track = trial % 2
        level = levels[track]
        correct = bool(rng.random() < float(proportion(np.array(level), observer)))
        rows.append((level, correct))
        right[track] = right[track] + 1 if correct else 0
        if not correct or right[track] == 2:
            levels[track] = float(np.clip(level / 1.41 if correct else level * 1.41, 0.1, 10.0))
            right[track] = 0
    distances, answers = np.array(rows).T
    return fit_psychometric(distances, answers, np.ones(trials), "2ifc")


def bootstrap_holds(
    fit: Psychometric, repeats: int, true: float, rng: np.random.Generator
) -> bool:
    """Return whether the percentile interval of a parametric bootstrap holds the threshold."""
    rates, trials = fit.proportion(LEVELS), np.full(len(LEVELS), repeats)
    drawn = [
        fit_psychometric(LEVELS, rng.binomial(trials, rates), trials, "2ifc").threshold.value
        for _ in range(BOOTSTRAP)
    ]
    low, high = np.quantile(drawn, (0.025, 0.975))
    return bool(low <= true <= high)


def print_thresholds(studies: int, bootstrap: bool) -> None:
    """Print bias and coverage of thresholds and slopes by observer and procedure."""
    print(
        f"\n{'procedure':12} {'trials':>6} {'threshold':>9} {'slope':>6} {'random':>7}"
        f" {'bias':>6} {'covered':>8} {'slope covered':>14} {'bootstrap':>10}"
    )
    for observer, (name, n) in product(
        OBSERVERS, (("constant", 70), ("constant", 140), ("staircase", 60))
    ):
        rng = np.random.default_rng(1)
        repeats = n // len(LEVELS)
        found = [
            staircase(observer, n, rng)
            if name == "staircase"
            else constant_stimuli(observer, repeats, rng)
            for _ in range(studies)
        ]
        threshold, slope, lapse = observer
        bias = np.exp(np.mean(np.log([each.threshold.value for each in found])))
        held = np.mean([each.threshold.low <= threshold <= each.threshold.high for each in found])
        slopes = np.mean([each.slope.low <= slope <= each.slope.high for each in found])
        boot = ""
        if bootstrap and name == "constant":
            holds = [
                bootstrap_holds(each, repeats, threshold, rng) for each in found[:BOOTSTRAPPED]
            ]
            boot = f"{np.mean(holds):.2f}"
        print(
            f"{name:12} {n:6} {threshold:9.1f} {slope:6.1f} {lapse:7.2f}"
            f" {bias / threshold - 1:+6.0%} {held:8.3f} {slopes:14.3f} {boot:>10}",
            flush=True,
        )


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--studies", type=int, default=1000, help="simulated studies of each kind")
    parser.add_argument("--bootstrap", action="store_true", help="also bootstrap: takes an hour")
    arguments = parser.parse_args()
    print_sensitivities()
    print_thresholds(arguments.studies, arguments.bootstrap)


if __name__ == "__main__":
    main()

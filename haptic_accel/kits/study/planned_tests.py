# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Planned tests of a study, on one value per participant; trials are never pooled.

Trials of one participant are not independent; counting them as such would make any study
significant (pseudoreplication). The participants are the sample. The planned test is Student's
t-test; signed ranks and flipped signs show whether its result depends on a normal distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from statistics import fmean
from typing import Literal, TypeAlias, cast

import numpy as np

from haptic_accel import FloatArray, GraphArguments
from haptic_accel.core.evaluation import statistics
from haptic_accel.core.evaluation.statistics import Alternative, Interval
from haptic_accel.core.parameters import schema
from haptic_accel.kits.study.procedures import DIFFERENT, TASKS, Item, distance, family
from haptic_accel.kits.study.protocol import Condition, Levels, PlannedTest, Protocol
from haptic_accel.kits.study.reading import matching
from haptic_accel.kits.study.sensitivity import (
    CHANCE,
    Psychometric,
    d_prime,
    d_prime_by_answers,
    fit_psychometric,
)
from haptic_accel.kits.study.tables import exclusions
from haptic_accel.kits.study.trials import SessionRecord, TrialRecord

_QUANTILES = 400  # of the chi-distribution, for the noncentral t-distribution


@dataclass(frozen=True)
class MeanTest:
    """Test of the participants' mean against a number.

    Attributes
    ----------
    n : int
        Number of participants with a finite value.
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
        True if `p` is below alpha.
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
        Result, without probabilities for fewer than `FEWEST` participants.

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
        # For equal differences, the interval is unknown, not of zero length.
        mean = replace(mean, low=math.nan, high=math.nan, method="no scatter of participants")
    effect = standardised(differences.tolist())
    return MeanTest(n, mean, effect, worst.t, worst.p_t, p_ranks, p_signs, p, p < alpha)


def standardised(differences: Sequence[float]) -> statistics.Interval:
    """Return the standardised mean difference g_z with its interval.

    g_z is the mean divided by the standard deviation, corrected for bias (Hedges, J. Educational
    Statistics 6, 1981). Its limits follow from inverting the noncentral t-distribution, and are
    exact without that correction. The result is NaN if all differences are equal.
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

    A mean over these quantiles is an integral over the distribution; scipy's noncentral
    t-distribution fails for large t.
    """
    from scipy.special import chdtri

    return np.sqrt(chdtri(n - 1, (np.arange(_QUANTILES) + 0.5) / _QUANTILES) / (n - 1))


Values: TypeAlias = dict[str, float]
"""Value of each participant."""

RANGES = {"correct": (0.0, 1.0), "preferred": (0.0, 1.0), "threshold": (0.0, math.inf)}
"""Range of a measure's values; other measures have no limits."""


@dataclass(frozen=True)
class CountedTrial:
    """Trial that counts in the analysis.

    Attributes
    ----------
    participant : str
    family : str
        Pair or condition, without its level; trials of one family are analysed together.
    condition : Condition
        Comparison or only condition, at its level.
    record : TrialRecord
    answer : str
    """

    participant: str
    family: str
    condition: Condition
    record: TrialRecord
    answer: str


Trials: TypeAlias = Sequence[CountedTrial]


def counted(protocol: Protocol, sessions: Sequence[SessionRecord]) -> list[CountedTrial]:
    """Return the counted trials of included participants, in the order of the protocol."""
    excluded = exclusions(protocol, sessions)
    items = {family(item): item for item in TASKS[protocol.task].items(protocol)}
    found = []
    for session in sessions:
        for record in session.counted if session.participant not in excluded else ():
            name = record.trial.track.partition(" #")[0]
            condition = _condition(protocol, items[name], record.trial.level)
            answer = record.answer.value if record.answer else ""
            found.append(CountedTrial(session.participant, name, condition, record, answer))
    indices = {name: index for index, name in enumerate(items)}
    return sorted(found, key=lambda each: indices[each.family])


def _condition(protocol: Protocol, item: Item, level: float | None) -> Condition:
    """Return the only condition, or the comparison, which names a pair, at its level."""
    if isinstance(item, Condition):
        return item
    settings = dict(item.comparison.settings)
    if protocol.levels and level is not None:
        settings[protocol.levels.factor] = level
    return Condition(tuple(settings.items()))


def grouped(
    trials: Iterable[CountedTrial], key: Callable[[CountedTrial], str]
) -> dict[str, list[CountedTrial]]:
    """Return trials by a key."""
    groups: dict[str, list[CountedTrial]] = {}
    for trial in trials:
        groups.setdefault(key(trial), []).append(trial)
    return groups


def by_participant(trials: Iterable[CountedTrial]) -> dict[str, list[CountedTrial]]:
    """Return trials by participant."""
    return grouped(trials, lambda trial: trial.participant)


def right(trials: Trials) -> tuple[int, int]:
    """Return the number of right answers, and of trials."""
    return sum(each.record.correct or False for each in trials), len(trials)


def sensitivity(protocol: Protocol, trials: Trials) -> Interval:
    """Return d' of one participant's trials."""
    if protocol.task in CHANCE:
        return d_prime(protocol.task, *right(trials))
    hits = [each.answer == DIFFERENT for each in trials if each.record.trial.right == DIFFERENT]
    alarms = [each.answer == DIFFERENT for each in trials if each.record.trial.right != DIFFERENT]
    return d_prime_by_answers(sum(hits), len(hits), sum(alarms), len(alarms))


def psychometric_function(levels: Levels, task: str, trials: Trials) -> Psychometric:
    """Return the psychometric function of one participant's trials."""
    distances = [distance(levels, each.condition) for each in trials]
    correct = [bool(each.record.correct) for each in trials]
    return fit_psychometric(distances, correct, [1] * len(trials), task)


def preference(trials: Trials, words: str, against: str = "") -> float:
    """Return the share of one participant's trials in which a condition is preferred.

    Parameters
    ----------
    trials : sequence of CountedTrial
    words : str
        Condition, as ``factor=value`` texts.
    against : str
        Condition of the other stimulus; empty for any other.
    """
    wins = []
    for each in trials:
        chosen = each.record.trial.stimuli[int(each.answer) - 1]
        others = [other for other in each.record.trial.stimuli if other != chosen]
        winners, losers = (matching(pair, words) for pair in ([chosen], others))
        other = others if winners else [chosen]
        if bool(winners) != bool(losers) and matching(other, against):
            wins.append(bool(winners))
    return fmean(wins) if wins else math.nan


def _threshold(protocol: Protocol, trials: Trials) -> float:
    if protocol.levels is None:
        return math.nan
    return psychometric_function(protocol.levels, protocol.task, trials).threshold.value


MEASURES: Mapping[str, Callable[[Protocol, Trials], float]] = {
    "correct": lambda protocol, trials: fmean(each.record.correct or False for each in trials),
    "d_prime": lambda protocol, trials: sensitivity(protocol, trials).value,
    "threshold": _threshold,
    "rating": lambda protocol, trials: fmean(float(each.answer) for each in trials),
}
"""Functions that compute a measure of one participant's trials, by the measure's name."""

NAMES = {
    "correct": "proportion correct",
    "d_prime": "d'",
    "threshold": "threshold",
    "preferred": "share of preference",
    "rating": "mean rating",
}
"""Names of the measures, for readers."""


def distance_name(levels: Levels) -> str:
    """Return the name of the distances from the reference, with their unit."""
    units = {"gain": "1", "network": "ms"}
    unit = units.get(levels.factor) or schema(GraphArguments)[levels.factor][1].unit or "1"
    return f"distance of {levels.factor} from {levels.reference:g} ({unit})"


def values(protocol: Protocol, trials: Trials, test: PlannedTest, words: str) -> Values:
    """Return the finite values of a planned test's measure in a condition."""
    if test.measure == "preferred":
        against = "" if _number(test.against) is not None else test.against
        found = {p: preference(own, words, against) for p, own in by_participant(trials).items()}
    else:
        own_trials = [each for each in trials if matching([each.condition], words)]
        measure = MEASURES[test.measure]
        found = {p: measure(protocol, own) for p, own in by_participant(own_trials).items()}
    return {participant: value for participant, value in found.items() if math.isfinite(value)}


@dataclass(frozen=True)
class PlannedResult:
    """Result of a planned test.

    Attributes
    ----------
    test : PlannedTest
    values : dict of float
        Value of each participant; for two conditions, their difference.
    measured : str
        Name of the values, for readers.
    against : float
        Number that the values are tested against; 0 for differences.
    outcome : MeanTest
        Test whose mean is that of the values minus `against`.
    within : tuple of float
        Ends of the range of possible values.
    """

    test: PlannedTest
    values: Values
    measured: str
    against: float
    outcome: MeanTest
    within: tuple[float, float]

    @property
    def mean(self) -> Interval:
        """Mean of the values, with the test's interval limited to possible values."""
        mean, at = self.outcome.mean, self.against
        # In this argument order, an unknown (NaN) end stays unknown.
        low, high = max(mean.low + at, self.within[0]), min(mean.high + at, self.within[1])
        return replace(mean, value=mean.value + at, low=low, high=high)


def planned_tests(protocol: Protocol, sessions: Sequence[SessionRecord]) -> list[PlannedResult]:
    """Return the results of a study's planned tests, in their order."""
    trials = counted(protocol, sessions)
    return [_result(protocol, trials, test) for test in protocol.tests]


def _result(protocol: Protocol, trials: Trials, test: PlannedTest) -> PlannedResult:
    found, measured = values(protocol, trials, test, test.condition), NAMES[test.measure]
    if protocol.levels and test.measure == "threshold":
        measured = f"{measured}: {distance_name(protocol.levels)}"
    within = RANGES.get(test.measure, (-math.inf, math.inf))
    against = _number(test.against) if test.against else chance(protocol, test.measure)
    if against is None and test.measure == "preferred":
        against = chance(protocol, test.measure)
    elif against is None:
        other = values(protocol, trials, test, test.against)
        found = {name: value - other[name] for name, value in found.items() if name in other}
        against, measured = 0.0, f"difference of {measured}"
        within = within[0] - within[1], within[1] - within[0]
    alternative = cast("Alternative", test.alternative)
    numbers = list(found.values())
    outcome = mean_test(numbers, against, alternative, test.margin, test.alpha)
    return PlannedResult(test, found, measured, against, outcome, within)


def chance(protocol: Protocol, measure: str) -> float:
    """Return the value of a measure for guessing participants, or 0."""
    guess = TASKS[protocol.task].chance or 1 / max(len(protocol.conditions), 1)
    return {"correct": guess, "preferred": 0.5}.get(measure, 0.0)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None

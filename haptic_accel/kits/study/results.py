# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of a study for its task, each as a table and a figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from haptic_accel import FloatArray
from haptic_accel.analysis import plots
from haptic_accel.analysis.plots import FittedCurve, Strip
from haptic_accel.commands import ResultTable, Row
from haptic_accel.core import DASH
from haptic_accel.core.evaluation.statistics import Interval, mean_interval
from haptic_accel.kits.study import choices, planned_tests
from haptic_accel.kits.study.procedures import distance, labels
from haptic_accel.kits.study.protocol import Condition, Levels, Protocol
from haptic_accel.kits.study.sensitivity import CHANCE, exact_binomial
from haptic_accel.kits.study.tables import COLUMNS, MEASURED, Tables

PLANNED, EXPLORATORY, DELIVERED = "planned", "exploratory", "delivered"
"""Kinds of results."""

LEAST_P = 0.001
"""Probability below which tables for readers state only an upper bound."""

_RANGES = {"share_of_preference": (0.0, 1.0), "bits": (0.0, math.inf), "rms": (0.0, math.inf)}
"""Ranges of the values in strip plots; other values have no limits."""

UNITS = {"_m_s2": " (m/s²)", "_percent": " (%)", "_s": " (s)"}
"""Units for readers, by the suffix of a value's name."""


@dataclass(frozen=True)
class Result:
    """Table of results, and perhaps a figure.

    Attributes
    ----------
    name : str
        Name of the result's files, and key in the JSON file.
    title, text : str
    rows : list of dict
        Texts, numbers and intervals by name.
    figure : Figure or None
    kind : str
        `PLANNED`, `EXPLORATORY` or `DELIVERED`.
    """

    name: str
    title: str
    text: str
    rows: list[Row]
    figure: Figure | None = None
    kind: str = EXPLORATORY

    @property
    def plain(self) -> list[Row]:
        """Rows for files, with the ends of an interval as separate values."""
        return [_plain(row) for row in self.rows]

    @property
    def table(self) -> ResultTable:
        """Table for readers."""
        return reading_table(self.rows, self.title)


def reading_table(rows: Sequence[Row], title: str) -> ResultTable:
    """Return rows as a table for readers, with intervals next to their values."""
    headings = [_heading(name) for name in rows[0]] if rows else []
    return ResultTable(headings, [[_cell(*item) for item in row.items()] for row in rows], title)


def frame_rows(frame: pd.DataFrame) -> list[Row]:
    """Return the rows of a table."""
    names = [str(each) for each in frame.columns]
    return [dict(zip(names, row, strict=True)) for row in frame.astype(object).to_numpy().tolist()]


def _heading(name: str) -> str:
    ending = next((each for each in UNITS if name.endswith(each)), "")
    return name.removesuffix(ending).replace("_", " ") + UNITS.get(ending, "")


def _cell(name: str, value: object) -> str:
    if isinstance(value, Interval):
        return f"{_short(value.value)} [{_short(value.low)}, {_short(value.high)}]"
    if not isinstance(value, float):
        return str(value)
    return f"< {LEAST_P:g}" if name.split("_")[0] == "p" and value < LEAST_P else _short(value)


def _short(value: float) -> str:
    """Return a number with three digits, or a dash if it is undefined."""
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}") if math.isfinite(value) else DASH


def _plain(row: Row) -> Row:
    found: Row = {}
    for name, value in row.items():
        if isinstance(value, Interval):
            found |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
        else:
            found[name] = value
    return found


def planned_results(planned: Sequence[planned_tests.PlannedResult]) -> Iterator[Result]:
    """Yield the results of planned tests, grouped by measure and reference number."""
    groups = groupby(planned, lambda each: (each.measured, each.against))
    for number, ((measured, against), group) in enumerate(groups, 1):
        own = list(group)
        strips = {each.test.name: Strip(each.values.values(), each.mean) for each in own}
        yield Result(
            f"planned_{number}",
            f"Tests of {measured}",
            "Student's t-test of the mean of the participants (p); Wilcoxon's signed ranks and"
            " flipped signs show whether its result hangs on a normal distribution. A dot is a"
            " participant, the diamond their mean, and the dashed line what it is tested against.",
            [_tested(each) for each in own],
            plots.strips(strips, measured, against),
            PLANNED,
        )


def _tested(result: planned_tests.PlannedResult) -> Row:
    test, outcome = result.test, result.outcome
    within = f" within {test.margin:g}" if test.margin else ""
    return {
        "test": test.name,
        "mean": result.mean,
        "against": test.against or result.against,
        "alternative": test.alternative + within,
        "p": outcome.p,
        "significant": f"{'yes' if outcome.significant else 'no'}, at {test.alpha:g}",
        "effect_size": outcome.effect,
        "participants": len(result.values),
        "condition": test.condition or "all",
        "p_ranks": outcome.p_ranks,
        "p_signs": outcome.p_signs,
    }


def exploratory_results(protocol: Protocol, trials: planned_tests.Trials) -> Iterator[Result]:
    """Yield the exploratory results of a task."""
    for results in _EXPLORED[protocol.task] if trials else ():
        yield from results(protocol, trials)


def _by_both(
    trials: planned_tests.Trials,
    value: Callable[[list[planned_tests.CountedTrial]], Row],
    name: str,
) -> tuple[list[Row], dict[str, Strip]]:
    """Return a row for each comparison or condition and participant, and strips of a value."""
    rows = [
        {"analysed": family, "participant": participant, "trials": len(one), **value(one)}
        for family, own in planned_tests.grouped(trials, lambda each: each.family).items()
        for participant, one in planned_tests.by_participant(own).items()
    ]
    return rows, _strips(rows, name)


def _strips(rows: Sequence[Row], name: str) -> dict[str, Strip]:
    """Return the values of participants and their mean by comparison or condition."""
    found: dict[str, list[float]] = {}
    for row in rows:
        value = row[name].value if isinstance(row[name], Interval) else row[name]
        found.setdefault(row["analysed"], []).append(value)
    within = _RANGES.get(name, (-math.inf, math.inf))
    return {each: Strip(own, mean_interval(own, within=within)) for each, own in found.items()}


def _sensitivities(protocol: Protocol, trials: planned_tests.Trials) -> Iterator[Result]:
    if protocol.levels and protocol.task in CHANCE:
        yield _thresholds(protocol, protocol.levels, trials)
        return

    def found(own: list[planned_tests.CountedTrial]) -> Row:
        right = sum(bool(each.record.correct) for each in own)
        tested = exact_binomial(right, len(own), planned_tests.chance(protocol, "correct"))
        d_prime = planned_tests.sensitivity(protocol, own)
        return {"proportion_correct": tested.interval, "p": tested.p, "d'": d_prime}

    rows, strips = _by_both(trials, found, "d'")
    yield Result(
        "sensitivity",
        "Sensitivity of each participant",
        "Proportion of right answers with its exact binomial interval and its probability under"
        " guessing, and d' of the task. A dot is a participant.",
        rows,
        plots.strips(strips, planned_tests.NAMES["d_prime"], 0.0),
    )


def _thresholds(protocol: Protocol, levels: Levels, trials: planned_tests.Trials) -> Result:
    curves = {}
    several = len({each.family for each in trials}) > 1

    def found(own: list[planned_tests.CountedTrial]) -> Row:
        fitted = planned_tests.psychometric_function(levels, protocol.task, own)
        distances = [distance(levels, each.condition) for each in own]
        points = pd.Series([float(each.record.correct or 0) for each in own]).groupby(distances)
        x = np.geomspace(min(distances) / 1.5, max(distances) * 1.2, 200)
        y, threshold = fitted.proportion(x), fitted.threshold.value
        name = own[0].participant + f", {own[0].family}" * several
        curves[name] = FittedCurve(points.agg(["mean", "size"]), x, y, threshold)
        return {"threshold": fitted.threshold, "slope": fitted.slope, "lapse": fitted.lapse}

    return Result(
        "thresholds",
        "Threshold of each participant",
        "Psychometric function of each participant: distance from the reference at which d' is 1"
        " (dashed), with the interval of its posterior. The area of a dot grows with its trials.",
        _by_both(trials, found, "threshold")[0],
        plots.fitted_curves(curves, planned_tests.distance_name(levels), levels.scale == "log"),
    )


def _ratings(protocol: Protocol, trials: planned_tests.Trials) -> Iterator[Result]:
    def found(own: list[planned_tests.CountedTrial]) -> Row:
        return {"mean_rating": float(np.mean([float(each.answer) for each in own]))}

    rows, strips = _by_both(trials, found, "mean_rating")
    yield Result(
        "ratings",
        "Ratings",
        "Mean rating of each participant, a dot; the diamond is their mean with its interval.",
        rows,
        plots.strips(strips, planned_tests.NAMES["rating"]),
    )


def _preferences(protocol: Protocol, trials: planned_tests.Trials) -> Iterator[Result]:
    names = labels(protocol)
    shares = [
        {"analysed": name, "participant": participant, "share_of_preference": share}
        for condition, name in names.items()
        for participant, own in planned_tests.by_participant(trials).items()
        if math.isfinite(share := planned_tests.preference(own, str(condition)))
    ]
    strips = _strips(shares, "share_of_preference")
    yield Result(
        "preferences",
        "Share of preference",
        "Share of the trials with a condition in which each participant preferred it.",
        shares,
        plots.strips(strips, planned_tests.NAMES["preferred"], 0.5),
    )
    try:
        worths = choices.bradley_terry(
            [_wins(list(names), own) for own in planned_tests.by_participant(trials).values()]
        )
    except ValueError:  # the compared pairs do not connect all conditions
        return
    named = [*zip(names.values(), worths, strict=True)]
    yield Result(
        "worths",
        "Worth of each condition",
        "Log worths by Bradley and Terry: the odds that one condition is preferred to another are"
        " the exponential of the difference of theirs. Intervals are of a jackknife over the"
        " participants.",
        [{"condition": name, "log_worth": worth} for name, worth in named],
        plots.strips({name: Strip((), worth) for name, worth in named}, "log worth", 0.0),
    )


def _wins(conditions: Sequence[Condition], trials: planned_tests.Trials) -> FloatArray:
    """Return the number of preferences of each row's condition over each column's."""
    wins = np.zeros((len(conditions), len(conditions)))
    for each in trials:
        stimuli, chosen = each.record.trial.stimuli, int(each.answer) - 1
        wins[conditions.index(stimuli[chosen]), conditions.index(stimuli[1 - chosen])] += 1
    return wins


def _confusions(protocol: Protocol, trials: planned_tests.Trials) -> Iterator[Result]:
    names = labels(protocol)
    shown = list(names.values())

    def confused(own: planned_tests.Trials) -> FloatArray:
        presented = [names[each.condition] for each in own]
        return choices.confusion_matrix(presented, [each.answer for each in own], shown)

    counts = pd.DataFrame(confused(trials), shown, shown).astype(int)
    yield Result(
        "confusions",
        "Confusions",
        "Answers of all participants by the presented condition.",
        frame_rows(counts.reset_index(names="presented")),
        plots.matrix(counts, ("answer", "presented", "answers")),
    )
    rows: list[Row] = []
    for participant, own in planned_tests.by_participant(trials).items():
        found = choices.information_transfer(confused(own))
        row = {"analysed": "all conditions", "participant": participant, **asdict(found)}
        rows.append({name: row[name] for name in _TRANSFER})
    yield Result(
        "information",
        "Transferred information",
        "Information of the answers about the conditions, corrected for the bias of few trials and"
        " as it is, and the number of conditions that can be told apart without error at it.",
        rows,
        plots.strips(_strips(rows, "bits"), "transferred information (bits)"),
    )


_TRANSFER = ("analysed", "participant", "trials", "bits", "uncorrected", "categories")


def _dissimilarities(protocol: Protocol, trials: planned_tests.Trials) -> Iterator[Result]:
    names, highest = labels(protocol), protocol.scale[1]
    shown = list(names.values())
    means = pd.DataFrame(math.nan, shown, shown)
    for name in shown:
        means.loc[name, name] = 0.0
    for own in planned_tests.grouped(trials, lambda each: each.family).values():
        first, second = (names[each] for each in own[0].record.trial.stimuli)
        ratings = [
            np.mean([highest - float(each.answer) for each in one])
            for one in planned_tests.by_participant(own).values()
        ]
        means.loc[first, second] = means.loc[second, first] = np.mean(ratings)
    yield Result(
        "dissimilarities",
        "Dissimilarities",
        "Mean over the participants of the distance of a rating from the highest, which is for two"
        " stimuli that feel the same.",
        frame_rows(means.reset_index(names="condition")),
        plots.matrix(means, ("condition", "condition", "dissimilarity")),
    )
    if means.isna().to_numpy().any():
        return
    scaling = choices.scale_dissimilarities(means.to_numpy())
    yield Result(
        "map",
        "Map of the conditions",
        "Points whose distances resemble the dissimilarities; directions are arbitrary. Stress:"
        f" {_short(scaling.stress)}.",
        [
            {"condition": name, "dimension_1": float(x), "dimension_2": float(y)}
            for name, (x, y) in zip(shown, scaling.points, strict=True)
        ],
        plots.scaling_map(scaling.points, shown),
    )


_EXPLORED: Mapping[
    str, tuple[Callable[[Protocol, planned_tests.Trials], Iterator[Result]], ...]
] = {
    **dict.fromkeys(("2ifc", "odd_one_out", "abx", "same_different"), (_sensitivities,)),
    "identification": (_confusions,),
    "rating": (_ratings,),
    "similarity": (_ratings, _dissimilarities),
    "preference": (_preferences,),
}


def delivered_results(found: Tables) -> Iterator[Result]:
    """Yield the delivered stimuli of the counted trials of the included participants."""
    included = found.sessions[found.sessions.excluded == ""].participant
    trials = found.trials[found.trials.participant.isin(included)] if len(found.trials) else None
    if trials is None or not trials.counted.any():
        return
    frame = found.stimuli.merge(trials[trials.counted][["participant", "trial", "attempt"]])
    factors = [name for name in frame.columns if name not in COLUMNS]
    frame = frame.astype(dict.fromkeys(MEASURED, float)).sort_values(factors, kind="stable")
    rows = [
        {"condition": str(condition), "stimuli": len(own)}
        | {name: _range(own[name]) for name in MEASURED}
        for condition, own in frame.groupby("condition", sort=False)
    ]
    means = frame.groupby(["condition", "participant"], sort=False).rms_m_s2.mean().reset_index()
    shown = [{"analysed": row.condition, "rms": row.rms_m_s2} for row in means.itertuples()]
    flaws = trials[trials.flaw != ""].flaw.value_counts()
    reasons = "".join(f" {count} times {flaw};" for flaw, count in flaws.items())
    yield Result(
        "delivered",
        "Stimuli of the counted trials",
        "Measured at the handle, without hand motion: mean [least, largest]. A dot is the mean of"
        f" a participant. Attempts that were not delivered within the bounds: {flaws.sum()} of"
        f" {len(trials)}.{reasons}",
        rows,
        plots.strips(_strips(shown, "rms"), "RMS of the handle acceleration (m/s²)"),
        DELIVERED,
    )


def _range(values: pd.Series[float]) -> Interval:
    return Interval(values.mean(), values.min(), values.max(), len(values), "range")

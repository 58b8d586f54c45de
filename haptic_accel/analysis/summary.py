"""Says in sentences what some bags show."""

from __future__ import annotations

import math
from collections.abc import Sequence

from haptic_accel.analysis.comparison import Comparison
from haptic_accel.analysis.loading import AnalysedTrial, Analysis
from haptic_accel.analysis.plots import number, percent
from haptic_accel.analysis.tables import FIGURES, MILLI, Group, groups, rank
from haptic_accel.core.evaluation.metrics import TABLE_II
from haptic_accel.core.evaluation.statistics import Interval, mean_interval

AVERAGE = "average"
"""The paper's average over its surfaces, as a surface of its table."""


def summary(analysis: Analysis, comparison: Comparison | None = None) -> list[str]:
    """Return what is worth knowing first, a sentence or two each."""
    trials = analysis.trials
    if not trials:
        return [f"Nothing can be said of {_many(analysis.bags, 'bag')}."]
    sentences = [
        _extent(analysis),
        *_errors(groups(trials)),
        *_delays(trials, analysis),
        *_latencies(trials),
        _losses(trials),
        *_forces(trials),
    ]
    if comparison:
        sentences.append(compared(comparison))
    if analysis.problems:
        sentences.append(
            f"Of {_many(len(analysis.problems), 'bag')} something cannot be said: see below."
        )
    return sentences


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _extent(analysis: Analysis) -> str:
    trials = analysis.trials
    seconds = sum(trial.measures.stretch.seconds for trial in trials)
    controllers = sorted({trial.controller for trial in trials}, key=rank)
    surfaces = sorted({trial.surface for trial in trials}, key=rank)
    return (
        f"{_many(len(trials), 'trial')} from {_many(analysis.bags, 'bag')}, {seconds:.0f} s in"
        f" all: {', '.join(controllers)} on {', '.join(surfaces)}."
    )


def averages(found: Sequence[Group]) -> dict[str, tuple[Interval, float | None]]:
    """Return each controller's error averaged over surfaces, in percent, and the paper's.

    Only over surfaces that all controllers were tried on, so that they compare; the paper's only
    where these are its own.
    """
    controllers = list(dict.fromkeys(group.controller for group in found))
    surfaces = [
        {g.surface for g in found if g.controller == controller} for controller in controllers
    ]
    common = set.intersection(*surfaces) if surfaces else set()
    paper = {surface for surface, _ in TABLE_II if surface != AVERAGE}
    return {
        controller: (
            mean_interval(
                [
                    group.interval("nrmse_percent").value
                    for group in found
                    if group.controller == controller and group.surface in common
                ]
            ),
            TABLE_II.get((AVERAGE, controller)) if common == paper else None,
        )
        for controller in controllers
    }


def _errors(found: Sequence[Group]) -> list[str]:
    """Say how far the handle was from what was desired, by controller."""
    words = []
    for controller, (interval, paper) in averages(found).items():
        if math.isfinite(interval.value):
            beside = f" (the paper's: {percent(paper)})" if paper is not None else ""
            words.append((interval.value, f"{controller} {percent(interval.value)}{beside}"))
    if not words:
        return ["No error can be told: desired or handle acceleration is missing."]
    over = "" if len({group.surface for group in found}) == 1 else ", averaged over surfaces"
    return [f"Error (NRMSE{over}): {', '.join(text for _, text in sorted(words))}."]


def _delays(trials: Sequence[AnalysedTrial], analysis: Analysis) -> list[str]:
    delays = _known("delay_ms", trials)
    if not delays:
        return [f"No delay stands out in any trial; the shift is {analysis.shift.words}."]
    low, high = number(min(delays), 2), number(max(delays), 2)
    between = f"{low} ms" if low == high else f"{low} to {high} ms"
    return [
        f"The handle follows what is desired by {between}, as their cross-correlation has it;"
        f" shifted back is {analysis.shift.words}."
    ]


def _latencies(trials: Sequence[AnalysedTrial]) -> list[str]:
    p50, p99, largest = (_known(f"latency_{name}_us", trials) for name in ("p50", "p99", "max"))
    sentences = []
    ages = _known("age_p50_us", trials), _known("age_p99_us", trials)
    if all(ages):
        middle, late = (max(found) / MILLI for found in ages)
        sentences.append(
            f"Where it was applied, a force was {middle:.2f} ms old in the middle of the slowest"
            f" trial, and 99 % were younger than {late:.2f} ms."
        )
    if p50:
        sentences.append(
            f"Forces were in the bag {max(p50) / MILLI:.2f} ms after the sample that caused them"
            f" in the middle of the slowest trial, 99 % within {max(p99) / MILLI:.2f} ms, all"
            f" within {max(largest) / MILLI:.2f} ms; the recorder's own delay is in it."
        )
    return sentences


def _losses(trials: Sequence[AnalysedTrial]) -> str:
    lost = sum(_known("lost", trials))
    missed = sum(sum(t.measures.stretch.delivery.missed.values()) for t in trials)
    if not lost and not missed:
        return "No sample was lost."
    return f"{lost:.0f} messages were lost and {missed} samples not taken."


def _forces(trials: Sequence[AnalysedTrial]) -> list[str]:
    peaks, travels = _known("force_peak_N", trials), _known("travel_mm", trials)
    if not peaks:
        return []
    sentence = f"The actuator gave {number(max(peaks), 1)} N at most"
    free = [MILLI * t.measures.force.free for t in trials if t.measures.force]
    if travels:
        sentence += (
            f" and used {number(max(travels), 1)} mm of the {number(min(free), 1)} mm it may move"
            " either way"
        )
        if max(travels) > min(free):
            sentence += ", by an estimate that knows no stops"
    return [sentence + "."]


def _known(name: str, trials: Sequence[AnalysedTrial]) -> list[float]:
    values = (FIGURES[name].of(trial.measures) for trial in trials)
    return [value for value in values if math.isfinite(value)]


def compared(comparison: Comparison) -> str:
    """Say whether two conditions differ."""
    found = comparison.overall
    if not found.n:
        return f"{comparison.second} and {comparison.first} have no trials that are pairs."
    words = f"{comparison.second} has {number(abs(found.mean.value), 1)} percentage points"
    words += " less" if found.mean.value < 0 else " more"
    words += f" error than {comparison.first}"
    if math.isfinite(found.mean.low):
        ends = f"{number(found.mean.low, 1)} to {number(found.mean.high, 1)}"
        words += f" (95 % interval of the difference: {ends})"
    return f"{words}: {found.verdict}."

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Summary of some bags in sentences."""

from __future__ import annotations

import math

import pandas as pd

from haptic_accel.analysis.comparison import Comparison
from haptic_accel.analysis.frames import Cell, groups, rank, table_two, trials
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.metrics import BEYOND_STOPS, CONTACT, MILLI
from haptic_accel.analysis.plots import number, percent
from haptic_accel.core.control.supervision import DEVIATES


def summary(analysis: Analysis, comparison: Comparison | None = None) -> list[str]:
    """Return the main results as sentences, one or two to each subject."""
    if not analysis.trials:
        return [f"Nothing could be determined from {_many(analysis.bags, 'bag')}."]
    frame = trials(analysis)
    sentences = [
        _extent(frame, analysis.bags),
        *_without_contact(frame),
        _errors(analysis),
        _delays(frame, analysis),
        *_ages(frame),
        _losses(frame, analysis),
        *_deadlines(analysis),
        *_forces(frame, analysis),
        *_deviations(analysis),
        *(each.sentence for each in analysis.across),
    ]
    if comparison:
        sentences.append(difference(comparison))
    if analysis.problems:
        sentences.append(
            f"{_many(len(analysis.problems), 'bag')} could not be analysed in full: see below."
        )
    return sentences


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _extent(frame: pd.DataFrame, bags: int) -> str:
    controllers, surfaces = (sorted(set(frame[c]), key=rank) for c in ("controller", "surface"))
    return (
        f"{_many(len(frame), 'trial')} from {_many(bags, 'bag')}, {frame.seconds.sum():.0f} s in"
        f" all: {', '.join(controllers)} on {', '.join(surfaces)}."
    )


def _without_contact(frame: pd.DataFrame) -> list[str]:
    """Return a sentence on the trials that means leave out."""
    count = int((~frame.contact).sum())
    if not count:
        return []
    return [
        f"{count} of {_many(len(frame), 'trial')} without contact, not in the errors and means:"
        f" the RMS of the desired acceleration is below {CONTACT:.2g} m/s², three times the noise"
        " of an accelerometer."
    ]


def _errors(analysis: Analysis) -> str:
    """Return a sentence on the error of each controller."""
    table = table_two(groups(analysis))
    over = f", averaged over {', '.join(table.common)}" if len(table.columns) > 1 else ""
    overall = [
        (cells[-1].value, f"{controller} {percent(cells[-1].value)}{_beside(cells[-1])}")
        for controller, cells in table.rows.items()
        if math.isfinite(cells[-1].value)
    ]
    if overall:
        each = ", ".join(text for _, text in sorted(overall))
        return f"Error (NRMSE{over}) after {analysis.after}: {each}."
    apart = [
        f"{controller} on {surface} {percent(cell.value)}"
        for controller, cells in table.rows.items()
        for surface, cell in zip(table.columns, cells, strict=True)
        if math.isfinite(cell.value)
    ]
    if not apart:
        return "No error could be determined."
    return (
        f"Error (NRMSE) after {analysis.after}: {', '.join(apart)}; no surface has an error of"
        " every controller, so that there is no average."
    )


def _beside(cell: Cell) -> str:
    return "" if cell.paper is None else f" (the paper's: {percent(cell.paper)})"


def _delays(frame: pd.DataFrame, analysis: Analysis) -> str:
    delays = frame.delay_ms.dropna()
    if delays.empty:
        return f"No delay stands out in any trial; the shift back is {analysis.after}."
    low, high = number(delays.min(), 2), number(delays.max(), 2)
    between = f"{low} ms" if low == high else f"{low} to {high} ms"
    return (
        f"The handle follows what is desired by {between}, according to their cross-correlation;"
        f" the shift back is {analysis.after}."
    )


def _ages(frame: pd.DataFrame) -> list[str]:
    slowest = frame.max(numeric_only=True) / MILLI
    if not math.isfinite(slowest.age_p50_us):
        return []
    return [
        f"Where it was applied, a force was {slowest.age_p50_us:.2f} ms old in the middle of"
        f" the slowest trial, and 99 % were younger than {slowest.age_p99_us:.2f} ms."
    ]


def _losses(frame: pd.DataFrame, analysis: Analysis) -> str:
    lost = int(frame.lost.sum())
    missed = sum(sum(trial.segment.delivery.missed.values()) for trial in analysis.trials)
    if not lost and not missed:
        return "No sample was lost."
    return f"{lost} messages were lost; of {missed} samples there is none at all."


def _deadlines(analysis: Analysis) -> list[str]:
    counts = [c for t in analysis.trials for c in t.segment.delivery.deadlines.values()]
    due, missed = (sum(count[name] for count in counts) for name in ("due", "missed"))
    if not due:
        return []
    return [f"{missed} of {due} forces missed their due time."]


def _forces(frame: pd.DataFrame, analysis: Analysis) -> list[str]:
    peak, travel = frame.force_peak_N.max(), frame.travel_mm.max()
    if not math.isfinite(peak):
        return []
    sentence = f"The actuator gave {number(peak, 1)} N at most"
    free = MILLI * min(trial.segment.actuator.travel for trial in analysis.trials)
    beyond = sum(BEYOND_STOPS in trial.notes for trial in analysis.trials)
    if beyond:
        sentence += (
            f" and came to its stops, {number(free, 1)} mm either way, in {beyond} of"
            f" {_many(len(frame), 'trial')}: there the estimate of its travel, which knows no"
            " stops, passes them and is left out"
        )
    elif math.isfinite(travel):
        sentence += (
            f" and used {number(travel, 1)} mm of the {number(free, 1)} mm it may move either way"
        )
    return [sentence + "."]


def _deviations(analysis: Analysis) -> list[str]:
    """Return a sentence on trials whose handle was not as the compensator was told."""
    said = ([*t.notes, *t.segment.delivery.warnings] for t in analysis.trials)
    found = [next((line for line in lines if DEVIATES in line), "") for lines in said]
    found = list(filter(None, found))
    if not found:
        return []
    where = found[0][found[0].index(DEVIATES) :].split(" (")[0]
    return [f"In {len(found)} of {_many(len(analysis.trials), 'trial')} {where}."]


def difference(comparison: Comparison) -> str:
    """Return the difference between two conditions in a sentence."""
    found = comparison.differences["all"]
    if not found.n:
        return f"{comparison.second} and {comparison.first} have no trials that are pairs."
    words = f"{comparison.second} has {number(abs(found.mean.value), 1)} percentage points"
    words += " less" if found.mean.value < 0 else " more"
    words += f" error than {comparison.first}"
    if math.isfinite(found.mean.low):
        ends = f"{number(found.mean.low, 1)} to {number(found.mean.high, 1)}"
        words += f" (95 % interval of the difference: {ends})"
    return f"{words}: {found.verdict}."

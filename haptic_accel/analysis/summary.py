# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Summary of the analysis of bags, in sentences and tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import pandas as pd

from haptic_accel.analysis import frames, metrics
from haptic_accel.analysis.frames import Comparison
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.segments import Segment
from haptic_accel.core.control.supervision import DEVIATES
from haptic_accel.core.evaluation.metrics import DIRECTION_SHARE
from haptic_accel.core.tables import ResultTable, number
from haptic_accel.core.tick.device_side import IN_TIME


def percent(value: float | None) -> str:
    """Return a percentage as text."""
    return number(value, 1, " %")


def summary(analysis: Analysis, comparison: Comparison | None = None) -> list[str]:
    """Return the main results as sentences, one or two per subject."""
    if not analysis.trials:
        return [f"Nothing could be determined from {_many(analysis.bags, 'bag')}."]
    frame = frames.trials(analysis)
    sentences = [
        _errors(analysis),
        _extent(frame, analysis.bags),
        *_runs(frame),
        *_without_contact(frame),
        *_lowest(analysis),
        *_directions(frame),
        *_reduced(frame),
        *_shares(frame),
        _delays(frame, analysis),
        *_ages(frame),
        _losses(frame, analysis),
        *_deadlines(frame, analysis),
        *_forces(frame, analysis),
        *_deviations(analysis),
        *(each.sentence for each in analysis.across),
    ]
    if comparison:
        sentences.append(difference(comparison))
    if analysis.problems:
        sentences.append(f"Remarks on {_many(len(analysis.problems), 'bag')}: see below.")
    return sentences


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _extent(frame: pd.DataFrame, bags: int) -> str:
    controllers, surfaces = (
        sorted(set(frame[c]), key=frames.rank) for c in ("controller", "surface")
    )
    return (
        f"{_many(len(frame), 'trial')} from {_many(bags, 'bag')}, {frame.seconds.sum():.0f} s in"
        f" all: {', '.join(controllers)} on {', '.join(surfaces)}."
    )


def _runs(frame: pd.DataFrame) -> list[str]:
    """Return a sentence on each mode of running trials."""
    counts = {str(run): int(count) for run, count in frame.run.value_counts(sort=False).items()}
    known = [f"{_many(count, 'trial')} ran {run}." for run, count in counts.items() if run]
    silent = counts.get("", 0)
    return known + [f"How {_many(silent, 'trial')} ran is not stated by the bags."] * bool(silent)


def _without_contact(frame: pd.DataFrame) -> list[str]:
    """Return a sentence on the trials excluded from means."""
    count = int((~frame.contact).sum())
    if not count:
        return []
    return [
        f"{count} of {_many(len(frame), 'trial')} had no contact and"
        f" {'counts' if count == 1 else 'count'} in no error or mean:"
        f" the desired acceleration has an RMS below {metrics.CONTACT:.2g} m/s², three times the"
        " noise of an accelerometer. Check that the tool touched the surface while the arms were"
        " engaged, and that its accelerometer works."
    ]


def _errors(analysis: Analysis) -> str:
    """Return a sentence on the error of each controller."""
    table = frames.table_two(frames.groups(analysis))
    over = f", averaged over {', '.join(table.common)}" if len(table.columns) > 1 else ""
    overall = [
        (cells[-1].value, f"{controller} {percent(cells[-1].value)}{_paper_text(cells[-1])}")
        for controller, cells in table.rows.items()
        if math.isfinite(cells[-1].value)
    ]
    if overall:
        each = ", ".join(text for _, text in sorted(overall))
        return f"Error (NRMSE{over}), shifted back by {analysis.shifted_by}: {each}."
    apart = [
        f"{controller} on {surface} {percent(cell.value)}"
        for controller, cells in table.rows.items()
        for surface, cell in zip(table.columns, cells, strict=True)
        if math.isfinite(cell.value)
    ]
    if not apart:
        return "No error could be determined."
    return (
        f"Error (NRMSE), shifted back by {analysis.shifted_by}: {', '.join(apart)}; there is no"
        " average, as no surface has an error of every controller."
    )


UNFOLLOWED = 25.0
"""Lowest possible error above which the handle cannot follow the input, %; about the just
noticeable difference of strength, 2.2 dB."""


def _lowest(analysis: Analysis) -> list[str]:
    """Return a sentence on the lowest possible error, to compare with the measured error."""
    table = frames.table_two(frames.groups(analysis))
    if not table.bounds:
        return []
    bounds = next(iter(table.bounds.values()))  # with the actuator's limits if known
    known = [
        (surface, bound)
        for surface, bound in zip(table.columns, bounds, strict=True)
        if math.isfinite(bound)
    ]
    sentences = [
        "Lowest error possible here, of any causal filter within the actuator's limits: "
        + ", ".join(f"{surface} {percent(bound)}" for surface, bound in known)
        + "."
    ]
    high = [
        surface for surface, bound in known if bound >= UNFOLLOWED and surface != frames.AVERAGE
    ]
    if high:
        sentences.append(
            f"The input itself cannot be followed on {', '.join(high)}: that part of the error is"
            " not the controller's."
        )
    return sentences


def _shares(frame: pd.DataFrame) -> list[str]:
    """Return a sentence on the vibration that a hand cannot distinguish from the desired one."""
    each = _each(frame, "indistinguishable_percent", " %")
    return each and [
        "Share of the vibration, by third octave and half second, whose strength a hand could not"
        f" tell from the desired one: {each[0]}."
    ]


def _directions(frame: pd.DataFrame) -> list[str]:
    """Return a sentence on the direction of the vibration, for several axes."""
    each = _each(frame, "direction_error_deg", "°")
    return each and [
        "Angle between actual and desired acceleration, median of the samples in which the desired"
        f" one has at least {DIRECTION_SHARE:g} of its root mean square: {each[0]}."
    ]


def _reduced(frame: pd.DataFrame) -> list[str]:
    """Return a sentence on the power that a single coil would keep, for three axes."""
    touching = frame[frame.contact]
    kept = [
        f"{key} {number(touching[name].mean(), 0, ' %')}"
        for key in metrics.KEPT.values()
        if (name := f"kept_{key}_percent") in frame and touching[name].notna().any()
    ]
    return kept and [
        "Power of the desired vibration that a single coil would have by each reduction to one"
        f" signal: {', '.join(kept)}."
    ]


def _each(frame: pd.DataFrame, name: str, unit: str) -> list[str]:
    """Return a text with the mean of a metric for each controller; empty list if unknown."""
    if name not in frame:
        return []
    means = frame[frame.contact].groupby("controller")[name].mean().dropna()
    ordered = sorted(
        ((str(key), mean) for key, mean in means.items()), key=lambda m: frames.rank(m[0])
    )
    each = ", ".join(f"{controller} {number(mean, 1, unit)}" for controller, mean in ordered)
    return [each] if each else []


def _paper_text(cell: frames.Cell) -> str:
    return "" if cell.paper is None else f" (the paper's: {percent(cell.paper)})"


def _delays(frame: pd.DataFrame, analysis: Analysis) -> str:
    delays = frame.delay_ms.dropna()
    if delays.empty:
        return (
            "No delay could be determined: in no trial does the actual acceleration correlate with"
            " the desired one."
        )
    low, high = number(delays.min(), 2), number(delays.max(), 2)
    between = f"{low} ms" if low == high else f"{low} to {high} ms"
    return (
        f"The actual acceleration lags the desired one by {between}, by their cross-correlation;"
        f" before they are compared, it is shifted back by {analysis.shifted_by}."
    )


def _ages(frame: pd.DataFrame) -> list[str]:
    slowest = frame.max(numeric_only=True) / metrics.MILLI
    if not math.isfinite(slowest.age_p50_us):
        return []
    return [
        "Age of the actuator's forces when applied, largest of all trials: median"
        f" {slowest.age_p50_us:.2f} ms, 99th percentile {slowest.age_p99_us:.2f} ms."
    ]


def _losses(frame: pd.DataFrame, analysis: Analysis) -> str:
    lost = int(frame.lost.sum())
    missed = sum(sum(trial.segment.delivery.missed.values()) for trial in analysis.trials)
    if not lost and not missed:
        return "No sample was lost."
    return (
        f"{_many(lost, 'message')} missing of samples that have others;"
        f" {_many(missed, 'sample')} without any message."
    )


def _deadlines(frame: pd.DataFrame, analysis: Analysis) -> list[str]:
    """Return sentences on late forces: by the device's clock, or from older counters."""
    found = [t.segment for t in analysis.trials if t.segment.delivery.deadlines]
    new = [segment for segment in found if segment.delivery.by_clock]
    old = [segment for segment in found if not segment.delivery.by_clock]
    sentences = []
    if new:
        due, missed = _sum("due", new), _sum("missed", new)
        longest = max(
            (c["longest_us"] for s in new for c in s.delivery.deadlines.values()),
            key=lambda late: -math.inf if math.isnan(late) else late,
        )
        share = frame.late_time_percent.max()
        actuator = (
            f"; the actuator's up to {number(share, 2)} % of a trial's time" * math.isfinite(share)
        )
        sentences.append(
            f"{missed} of {due} forces took effect more than {IN_TIME:g} periods after their due"
            f" time, the latest by {number(longest / metrics.MILLI, 1)} ms{actuator}."
        )
        still = [segment for segment in new if segment.waits]
        hidden = _sum("missed", still) - _sum("past_tick", still)
        if hidden > 0:
            sentences.append(
                f"For {hidden} of them the simulated world waited for its node, so that no error"
                " shows them; a real handle does not wait, and a hand would have felt each."
            )
    if old:
        latest = max(segment.delivery.ticks_late_us for segment in old)
        began = f"; ticks began up to {number(latest / metrics.MILLI, 1)} ms late" * math.isfinite(
            latest
        )
        sentences.append(
            f"{_sum('missed', old)} of {_sum('due', old)} forces came after the tick at which they"
            " were due, as older bags count them: where a device stood still itself, no force was"
            f" counted{began}."
        )
    return sentences


def _sum(name: str, segments: Sequence[Segment]) -> int:
    """Return the sum of a count over all kinds of forces."""
    return sum(int(c.get(name, 0)) for s in segments for c in s.delivery.deadlines.values())


def _forces(frame: pd.DataFrame, analysis: Analysis) -> list[str]:
    peak, travel = frame.force_peak_N.max(), frame.travel_mm.max()
    if not math.isfinite(peak):
        return []
    sentence = f"The actuator gave {number(peak, 1)} N at most"
    free = metrics.MILLI * min(trial.segment.actuator.travel for trial in analysis.trials)
    beyond = sum(metrics.BEYOND_STOPS in trial.notes for trial in analysis.trials)
    if beyond:
        sentence += (
            f" and reached its stops, {number(free, 1)} mm either way, in {beyond} of"
            f" {_many(len(frame), 'trial')}, which have no value of the travel"
        )
    elif math.isfinite(travel):
        sentence += (
            f" and moved up to {number(travel, 1)} mm from its middle, of {number(free, 1)} mm"
            " either way"
        )
    return [sentence + "."]


def _deviations(analysis: Analysis) -> list[str]:
    """Return a sentence on trials whose handle differed from the compensator's plant model."""
    said = ([*t.notes, *t.segment.delivery.warnings] for t in analysis.trials)
    found = [next((line for line in lines if DEVIATES in line), "") for lines in said]
    found = list(filter(None, found))
    if not found:
        return []
    where = found[0][found[0].index(DEVIATES) :].split(" (")[0]
    return [f"In {len(found)} of {_many(len(analysis.trials), 'trial')} {where}."]


def difference(comparison: Comparison) -> str:
    """Return a sentence on the difference between two conditions."""
    found = comparison.differences["all"]
    if not found.n:
        return f"{comparison.second} and {comparison.first} have no pair of trials in common."
    text = f"{comparison.second} has {number(abs(found.mean.value), 1)} percentage points"
    text += " less" if found.mean.value < 0 else " more"
    text += f" error than {comparison.first}"
    if math.isfinite(found.mean.low):
        ends = f"{number(found.mean.low, 1)} to {number(found.mean.high, 1)}"
        text += f" (95 % interval of the difference: {ends})"
    return f"{text}: {found.verdict}."


SHOWN = (
    "indistinguishable_percent",
    "slope_desired_on_actual",
    "slope_actual_on_desired",
    "r2",
    "delay_ms",
    "force_rms_N",
    "travel_mm",
    "deadlines_missed_percent",
    "late_time_percent",
)
"""Metrics of the second table, averaged over all trials of a controller."""


def tables(analysis: Analysis) -> Iterator[ResultTable]:
    """Yield Table II and the means of further metrics, if there are trials with contact."""
    table = frames.table_two(frames.groups(analysis))
    if not table.rows:
        return
    errors = [
        (controller, table.counts[controller], *map(_cell, cells))
        for controller, cells in table.rows.items()
    ]
    bounds = [
        (name, "", *(number(value, 1) for value in values))
        for name, values in table.bounds.items()
    ]
    yield ResultTable(
        ("controller", "trials per surface", *table.columns),
        errors + bounds,
        "Table II: error (NRMSE) of the handle's acceleration, shifted back by"
        f" {analysis.shifted_by}, % (paper's in brackets)",
        f"[95 % interval] ({table.methods})",
    )
    yield ResultTable(
        ("", *table.rows),
        list(_means(frames.trials(analysis), list(table.rows), frames.vector_metrics(analysis))),
        "regression over all surfaces, and other metrics: means (paper's in brackets)",
    )


def _cell(cell: frames.Cell) -> str:
    """Return a cell's text: error, interval, and the paper's value."""
    shown = number(cell.value, 1)
    if math.isfinite(cell.low):
        shown += f" [{number(cell.low, 1)}, {number(cell.high, 1)}]"
    return shown if cell.paper is None else f"{shown} ({cell.paper:.1f})"


def _means(
    frame: pd.DataFrame, controllers: Sequence[str], of_vectors: Sequence[str]
) -> Iterator[list[str]]:
    """Yield a row for each metric: its heading, and its mean under each controller."""
    frame = frame[frame.contact]
    # The paper's averages are over its own surfaces.
    paper = frames.PAPER_REGRESSION if set(frame.surface) == frames.PAPER_SURFACES else {}
    shown = [*of_vectors, *SHOWN]
    means = frame.groupby("controller")[shown].mean()
    columns = {**metrics.METRICS, **metrics.VECTOR_METRICS}
    for name in shown:
        published = paper.get(name, {})
        yield [columns[name].heading] + [
            columns[name].text(means[name][controller])
            + (f" ({published[controller]:.2f})" if controller in published else "")
            for controller in controllers
        ]

"""Writes the page of an analysis: one file with its plots and their data in it."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.analysis.comparison import Comparison, Pair
from haptic_accel.analysis.frames import comparison_rows
from haptic_accel.analysis.loading import AnalysedTrial, Analysis
from haptic_accel.analysis.measures import LATENCY_EDGES, PERCENT, Fidelity
from haptic_accel.analysis.plots import DASH, EXCERPT, number
from haptic_accel.analysis.summary import AVERAGE, averages, summary
from haptic_accel.analysis.tables import FIGURES, MILLI, Group, groups
from haptic_accel.analysis.thinning import around, some, thinned
from haptic_accel.analysis.traces import WHOLE_POINTS, Trace, Traces
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II
from haptic_accel.core.evaluation.statistics import CONFIDENCE, Interval
from haptic_accel.core.model import FloatArray
from haptic_accel.pages import asset, template

POINTS = 100_000
"""Points of time traces in a page, shared by its trials: about a megabyte with four signals."""

FEWEST_POINTS = 500
"""That each trial has all the same."""

CLOUD_POINTS = 1500
"""Of a trial's regression."""

FULL_SCALE = 32767
"""Of the whole numbers in which signals are stored: finer than any screen."""

PER_TRIAL = (
    "slope_desired_on_actual",
    "slope_actual_on_desired",
    "r2",
    "delay_ms",
    "st_sim",
    "spqi",
    "force_rms_N",
    "force_peak_N",
    "travel_mm",
    "latency_p50_us",
    "latency_p99_us",
    "age_p99_us",
    "lost",
    "late",
)
"""Columns of the table of trials behind the error."""

PER_GROUP = (
    "slope_desired_on_actual",
    "slope_actual_on_desired",
    "r2",
    "delay_ms",
    "delay_correlation",
    "st_sim",
    "spqi",
    "latency_p99_us",
)
"""Columns of the table of groups, each with its interval over trials."""


def write_page(
    analysis: Analysis,
    file: Path,
    comparison: Comparison | None = None,
    *,
    files: Sequence[str] = (),
    when: datetime | None = None,
) -> None:
    """Write an analysis as a page that needs no other file, nor the network.

    Parameters
    ----------
    analysis : Analysis
    file : Path
    comparison : Comparison, optional
    files : sequence of str
        Names of what lies beside it, to be linked to.
    when : datetime, optional
        Now by default.
    """
    found = groups(analysis.trials)
    trials = [trial for group in found for trial in group.trials]
    page = template("analysis.html.j2").render(
        title="Haptic display of tool contact: analysis",
        when=(when or datetime.now()).astimezone(),
        summary=summary(analysis, comparison),
        shift=analysis.shift.words,
        confidence=f"{PERCENT * CONFIDENCE:g} %",
        table=_table_two(found),
        headings=[_heading(name) for name in PER_TRIAL],
        trials=[_trial(trial) for trial in trials],
        group_headings=[_heading(name) for name in PER_GROUP],
        groups=[_group(group) for group in found],
        published={name: (number(slope), number(r2)) for name, (slope, r2) in REGRESSION.items()},
        bands=_bands(found),
        forces=_forces(found),
        losses=_losses(trials),
        comparison=_comparison(comparison) if comparison else None,
        problems=analysis.problems,
        notes=_notes(trials),
        files=files,
        figure=number,
        styles=asset("uPlot.min.css"),
        library=asset("uPlot.iife.min.js"),
        script=asset("analysis.js"),
        data=_embedded(_data(trials)),
    )
    file.write_text(page, encoding="utf-8", errors="replace")


# What is drawn


def _data(trials: Sequence[AnalysedTrial]) -> dict[str, Any]:
    """Return what the page's script draws."""
    share = max(POINTS // max(len(trials), 1), FEWEST_POINTS)
    return {
        "edges": (MILLI * LATENCY_EDGES).tolist(),
        "excerpt": EXCERPT,
        "first": _best(trials),
        "trials": [_drawn(trial, share) for trial in trials],
    }


def _best(trials: Sequence[AnalysedTrial]) -> int:
    """Return the place of the trial with the least error, which is shown first."""
    errors = [FIGURES["nrmse_percent"].of(trial.measures) for trial in trials]
    known = [error if math.isfinite(error) else math.inf for error in errors]
    return known.index(min(known)) if known else 0


def _drawn(trial: AnalysedTrial, points: int) -> dict[str, Any]:
    measures = trial.measures
    fidelity = measures.fidelity
    return {
        "name": trial.name,
        "controller": trial.controller,
        "surface": trial.surface,
        **_packed_traces(measures.traces, points),
        "begin": measures.traces.excerpt,
        "cloud": _cloud(fidelity) if fidelity else None,
        "spectra": _spectra(fidelity) if fidelity else None,
        "latency": measures.latency.counts.tolist() if measures.latency else None,
        "free": measures.force.free * MILLI if measures.force else None,
    }


def _packed_traces(traces: Traces, points: int) -> dict[str, Any]:
    whole, detail = traces.whole, traces.detail
    kept = min(points * 6 // 10, WHOLE_POINTS)
    thin = {name: thinned(values, kept) for name, values in whole.signals.items()}
    step = next((step for _, step in thin.values()), 1.0)
    begin = round((traces.excerpt - detail.begin) / detail.step)
    size = max(map(len, detail.signals.values()), default=0)
    excerpt = slice(begin, min(begin + round(EXCERPT / detail.step), size))
    window = around(excerpt, size, points * 4 // 10)
    return {
        "whole": _packed_trace(
            Trace(whole.begin, whole.step * step, {name: kept for name, (kept, _) in thin.items()})
        ),
        "detail": _packed_trace(
            Trace(
                detail.begin + window.start * detail.step,
                detail.step,
                {name: values[window] for name, values in detail.signals.items()},
            )
        ),
    }


def _packed_trace(trace: Trace) -> dict[str, Any]:
    scales = {"travel": MILLI}
    return {
        "begin": trace.begin,
        "step": trace.step,
        "signals": {
            name: _packed(values * scales.get(name, 1.0)) for name, values in trace.signals.items()
        },
    }


def _packed(values: FloatArray) -> dict[str, Any]:
    """Return a signal as whole numbers of 16 bits in base 64, and what one of them is worth."""
    scale = (float(np.max(np.abs(values))) if values.size else 0.0) / FULL_SCALE or 1.0
    numbers = np.round(values / scale).astype("<i2")
    return {"scale": scale, "data": base64.b64encode(numbers.tobytes()).decode("ascii")}


def _cloud(fidelity: Fidelity) -> dict[str, Any]:
    portrait, evaluation = fidelity.portrait, fidelity.evaluation
    points = some(portrait.cloud_actual.size, CLOUD_POINTS)
    points = points[np.argsort(portrait.cloud_actual[points])]
    return {
        "actual": _packed(portrait.cloud_actual[points]),
        "desired": _packed(portrait.cloud_desired[points]),
        "slope": evaluation.slope_desired_on_actual,
        "middle": [portrait.mean_actual, portrait.mean_desired],
        "r2": evaluation.r2,
    }


def _spectra(fidelity: Fidelity) -> dict[str, Any]:
    found = fidelity.spectra
    return {
        "step": float(found.frequency[1]),
        "desired": _rounded(found.desired),
        "actual": _rounded(found.actual),
        "coherence": [round(value, 4) for value in found.coherence.tolist()],
    }


def _rounded(values: FloatArray) -> list[float]:
    return [float(f"{value:.4g}") for value in values.tolist()]


def _embedded(data: Mapping[str, Any]) -> str:
    """Return data as JSON that cannot end the element it stands in."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


# Tables


@dataclass(frozen=True)
class _Cell:
    """A cell: what it is sorted by, its interval, and how long its bar is in percent of it."""

    text: str
    sort: str = ""
    ends: str = ""
    bar: float = 0.0


def _shown(value: float, digits: int) -> _Cell:
    return _Cell(number(value, digits), f"{value:.9g}" if math.isfinite(value) else "")


def _ends(interval: Interval, digits: int) -> str:
    """Return an interval in brackets, nothing where there is none."""
    if not math.isfinite(interval.low):
        return ""
    return f"[{number(interval.low, digits)}, {number(interval.high, digits)}]"


def _heading(name: str) -> str:
    figure = FIGURES[name]
    return f"{figure.label} ({figure.unit})" if figure.unit else figure.label


def _trial(trial: AnalysedTrial) -> dict[str, Any]:
    measures = trial.measures
    fidelity = measures.fidelity
    error = _Cell(DASH)
    if fidelity:
        own = fidelity.nrmse
        percent = Interval(
            PERCENT * own.value, PERCENT * own.low, PERCENT * own.high, own.n, own.method
        )
        error = _Cell(number(percent.value, 1), f"{percent.value:.9g}", _ends(percent, 1))
    return {
        "name": trial.name,
        "controller": trial.controller,
        "surface": trial.surface,
        "error": error,
        "cells": [_shown(FIGURES[n].of(measures), FIGURES[n].digits) for n in PER_TRIAL],
    }


def _group(group: Group) -> dict[str, Any]:
    cells = []
    for name in PER_GROUP:
        interval, digits = group.interval(name), FIGURES[name].digits
        sort = f"{interval.value:.9g}" if math.isfinite(interval.value) else ""
        cells.append(_Cell(number(interval.value, digits), sort, _ends(interval, digits)))
    return {
        "controller": group.controller,
        "surface": group.surface,
        "count": len(group.trials),
        "cells": cells,
    }


def _table_two(found: Sequence[Group]) -> dict[str, Any]:
    """Return surfaces, and a row for each controller of (here, its interval, the paper's)."""
    surfaces = list(dict.fromkeys(group.surface for group in found))
    means = averages(found)
    by_key = {(group.controller, group.surface): group for group in found}
    rows = []
    for controller in dict.fromkeys(group.controller for group in found):
        cells = []
        for surface in surfaces:
            group = by_key.get((controller, surface))
            paper = number(TABLE_II.get((surface, controller)), 1)
            if group is None:
                cells.append((DASH, "", paper))
                continue
            interval = group.interval("nrmse_percent")
            cells.append((number(interval.value, 1), _ends(interval, 1), paper))
        if len(surfaces) > 1:
            mean, published = means[controller]
            cells.append((number(mean.value, 1), "", number(published, 1)))
        count = sum(len(group.trials) for group in found if group.controller == controller)
        rows.append({"name": controller, "cells": cells, "count": count})
    methods = dict.fromkeys(group.interval("nrmse_percent").method for group in found)
    return {
        "columns": surfaces + [AVERAGE] * (len(surfaces) > 1),
        "rows": rows,
        "methods": "; ".join(methods),
    }


def _bands(found: Sequence[Group]) -> dict[str, Any]:
    """Return bands, and a row of errors for each group; bars end at twice the desired."""
    by_group = [(group, group.bands()) for group in found]
    names = list(dict.fromkeys(name for _, bands in by_group for name in bands))
    unknown = Interval(math.nan, math.nan, math.nan, 0, "")
    return {
        "names": names,
        "rows": [
            {
                "controller": group.controller,
                "surface": group.surface,
                "cells": [_bar(bands.get(name, unknown)) for name in names],
            }
            for group, bands in by_group
            if bands
        ],
    }


def _bar(interval: Interval) -> _Cell:
    length = min(interval.value / 2.0, PERCENT) if math.isfinite(interval.value) else 0.0
    sort = f"{interval.value:.9g}" if math.isfinite(interval.value) else ""
    return _Cell(number(interval.value, 0), sort, _ends(interval, 0), length)


def _forces(found: Sequence[Group]) -> list[dict[str, Any]]:
    rows = []
    for group in found:
        forces = [t.measures.force for t in group.trials if t.measures.force]
        if not forces:
            continue
        free = MILLI * min(force.free for force in forces)
        used = max(MILLI * force.travel for force in forces)
        share = PERCENT * used / free if math.isfinite(used) else 0.0
        rows.append(
            {
                "controller": group.controller,
                "surface": group.surface,
                "rms": _shown(group.interval("force_rms_N").value, 2),
                "peak": _shown(max(force.peak for force in forces), 2),
                "travel": _Cell(number(used, 2), f"{used:.6g}", bar=min(share, PERCENT)),
                "share": number(share, 0, " %") if share else DASH,
            }
        )
    return rows


def _losses(trials: Sequence[AnalysedTrial]) -> list[tuple[str, str, int, int]]:
    """Return trial, topic, lost and late of whatever lost or delayed a sample."""
    rows = []
    for trial in trials:
        delivery = trial.measures.stretch.delivery
        for topic in delivery.lost:
            lost, late = delivery.lost[topic], delivery.late.get(topic, 0)
            if lost or late:
                rows.append((trial.name, topic, lost, late))
        for arm, missed in delivery.missed.items():
            if missed:
                rows.append((trial.name, f"samples of the {arm} that were not taken", missed, 0))
    return rows


def _comparison(comparison: Comparison) -> dict[str, Any]:
    return {
        "first": comparison.first,
        "second": comparison.second,
        "rows": comparison_rows(comparison),
        "pairs": [
            (pair.key, *(number(error, 1) for error in pair.errors), number(_difference(pair), 1))
            for pair in comparison.pairs
        ],
        "unpaired": comparison.unpaired,
    }


def _difference(pair: Pair) -> float:
    first, second = pair.errors
    return second - first


def _notes(trials: Sequence[AnalysedTrial]) -> dict[str, list[str]]:
    """Return by trial what is missing, and what nodes complained of."""
    found = {}
    for trial in trials:
        lines = [*trial.measures.notes, *trial.measures.stretch.delivery.warnings]
        if lines:
            found[trial.name] = lines
    return found

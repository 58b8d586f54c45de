# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Output of an analysis to a folder: page, plots and tables; metrics as JSON.

The page is one file that contains its plots and their data.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from haptic_accel.analysis import frames, metrics, traces
from haptic_accel.analysis.description import page_provenance
from haptic_accel.analysis.frames import Comparison, csv_text
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.segments import Segment, read_segment
from haptic_accel.analysis.summary import summary
from haptic_accel.core import topics
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II
from haptic_accel.core.evaluation.statistics import CONFIDENCE, Interval, mean_interval
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import defined
from haptic_accel.core.tables import ResultTable, number
from haptic_accel.pages import write

POINTS = 100_000
"""Number of points for the time traces of a page, shared by all trials: about a megabyte for five
signals."""

FEWEST_POINTS = 500
"""Minimum number of points of the time traces of each trial."""

CLOUD_POINTS = 1500
"""Number of points in a trial's regression plot."""

FULL_SCALE = 32767
"""Maximum integer for stored signals; the resolution exceeds that of any screen."""

_OMITTED = "nrmse_percent delay_correlation shift_ms age_p50_us age_max_us"
PER_TRIAL = tuple(name for name in metrics.METRICS if name not in _OMITTED.split())
"""Columns that follow the error in the table of trials."""

PER_GROUP = (
    *("indistinguishable_percent", "slope_desired_on_actual", "slope_actual_on_desired", "r2"),
    *("delay_ms", "delay_correlation"),
    *("deadlines_missed_percent", "late_time_percent"),
)
"""Columns of the table of groups, each with its interval over trials."""

_UNITS = {"travel": metrics.MILLI}  # factors of signals over time, if not SI


@dataclass(frozen=True)
class Setting:
    """Text of a page in addition to the metrics.

    Attributes
    ----------
    title : str
        Heading of the page.
    notes : sequence of str
        Paragraphs below Table II.
    settings : mapping of str to str
        Arguments of the run, shown as a table.
    pictures : mapping of str to str
        Captions of picture files in the page's folder, by file name.
    lockstep : ResultTable, optional
        Errors of the same trials from another run.
    """

    title: str = "Haptic display of tool contact: analysis"
    notes: Sequence[str] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    pictures: Mapping[str, str] = field(default_factory=dict)
    lockstep: ResultTable | None = None


def write_page(
    analysis: Analysis,
    file: Path,
    comparison: Comparison | None = None,
    *,
    setting: Setting | None = None,
    files: Sequence[str] = (),
) -> None:
    """Write an analysis as a page without external scripts or network access.

    Parameters
    ----------
    analysis : Analysis
    file : Path
    comparison : Comparison, optional
    setting : Setting, optional
    files : sequence of str
        Names of linked files in the folder of `file`.
    """
    setting = setting or Setting()
    found = sorted(analysis.trials, key=lambda t: frames.ranks((t.controller, t.surface)))
    ordered = replace(analysis, trials=found)
    frame, grouped = frames.trials(ordered), frames.groups(ordered)
    of_vectors = frames.vector_metrics(ordered)
    write(
        file,
        "analysis.html.j2",
        setting=setting,
        settings={**setting.settings, **page_provenance()},
        summary=summary(analysis, comparison),
        analysis=analysis,
        confidence=f"{metrics.PERCENT * CONFIDENCE:g} %",
        table=frames.table_two(grouped),
        metrics={**metrics.METRICS, **metrics.VECTOR_METRICS},
        per_trial=(*of_vectors, *PER_TRIAL),
        per_group=(*of_vectors, *PER_GROUP),
        with_vectors=bool(of_vectors),
        trials=frame.to_dict("records"),
        groups=grouped.to_dict("records"),
        published=REGRESSION,
        bands={name: frames.band_column(name) for name in frames.band_names(ordered)},
        forces=[
            (*key, own.force_rms_N.mean(), own.force_peak_N.max(), own.travel_mm.max())
            for key, own in frames.by_condition(frame)
            if own.force_rms_N.notna().any()
        ],
        free=metrics.MILLI * min((t.segment.actuator.travel for t in found), default=math.nan),
        losses=_losses(found),
        comparison=comparison,
        notes={
            t.name: lines for t in found if (lines := [*t.notes, *t.segment.delivery.warnings])
        },
        files=files,
        figure=number,
        finite=math.isfinite,
        data=_embedded(_data(found)),
    )


def _losses(found: Sequence[metrics.AnalysedTrial]) -> list[tuple[str, str, int]]:
    """Return trial, topic, and number of lost samples for each loss."""
    rows = []
    for name, delivery in ((trial.name, trial.segment.delivery) for trial in found):
        silent = {
            f"samples of the {arm} without any message": n for arm, n in delivery.missed.items()
        }
        rows += [(name, *loss) for loss in (delivery.lost | silent).items() if loss[1]]
    return rows


def _data(found: Sequence[metrics.AnalysedTrial]) -> dict[str, Any]:
    """Return the data for the page's script; the trial with the least error is shown first."""
    share = max(POINTS // max(len(found), 1), FEWEST_POINTS)
    errors = [t.error.value if math.isfinite(t.error.value) else math.inf for t in found]
    return {
        "excerpt": traces.EXCERPT,
        "path": traces.PATH,
        "first": errors.index(min(errors)) if errors else 0,
        "trials": [_drawn(trial, share) for trial in found],
    }


def _drawn(trial: metrics.AnalysedTrial, points: int) -> dict[str, Any]:
    whole, detail = trial.traces.shrunk(points)
    axes = trial.segment.axes.names
    by_axis = trial.portrait.by_axis if trial.portrait else {}
    return {
        "name": trial.name,
        "controller": trial.controller,
        "surface": trial.surface,
        "whole": _packed_trace(whole),
        "detail": _packed_trace(detail),
        "begin": trial.traces.excerpt,
        **_axis_data(None if by_axis else trial.portrait),
        "free": trial.segment.actuator.travel * metrics.MILLI,
        "axes": {axis: _axis_data(by_axis.get(axis)) for axis in axes} if len(axes) > 1 else None,
    }


def _axis_data(portrait: traces.Portrait | None) -> dict[str, Any]:
    """Return regression and spectra of one axis."""
    return {"cloud": portrait and _cloud(portrait), "spectra": portrait and _spectra(portrait)}


def _packed_trace(trace: traces.Trace) -> dict[str, Any]:
    signals = {
        name: _packed(values * _UNITS.get(name.split("_")[0], 1.0))
        for name, values in trace.signals.items()
    }
    return {"begin": trace.begin, "step": trace.step, "signals": signals}


def _packed(values: FloatArray) -> dict[str, Any]:
    """Return a signal as base64-encoded 16-bit integers, and the value of one step."""
    scale = (float(np.max(np.abs(values))) if values.size else 0.0) / FULL_SCALE or 1.0
    numbers = np.round(values / scale).astype("<i2")
    return {"scale": scale, "data": base64.b64encode(numbers.tobytes()).decode("ascii")}


def _cloud(portrait: traces.Portrait) -> dict[str, Any]:
    points = traces.sampled(portrait.cloud_actual.size, CLOUD_POINTS)
    points = points[np.argsort(portrait.cloud_actual[points])]
    return {
        "actual": _packed(portrait.cloud_actual[points]),
        "desired": _packed(portrait.cloud_desired[points]),
        "slope": portrait.evaluation.slope_desired_on_actual if portrait.regressed else None,
        "middle": [portrait.mean_actual, portrait.mean_desired],
        "r2": portrait.evaluation.r2 if math.isfinite(portrait.evaluation.r2) else 0.0,
    }


def _spectra(portrait: traces.Portrait) -> dict[str, Any]:
    found = portrait.spectra
    return {
        "step": float(found.frequency[1]),
        "desired": [float(f"{value:.4g}") for value in found.desired.tolist()],
        "actual": [float(f"{value:.4g}") for value in found.actual.tolist()],
        "coherence": [round(value, 4) for value in found.coherence.tolist()],
    }


def _embedded(data: Mapping[str, Any]) -> str:
    """Return data as JSON that cannot close its HTML element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


PAGE = "index.html"

PICTURES = {
    "fig9_time": "As the paper's Fig. 9: desired and actual handle acceleration where the desired"
    " one has its largest root mean square. A row has one scale and, of one seed, one excerpt: the"
    " better the controller, the closer orange lies on blue.",
    "fig10_regression": "As the paper's Fig. 10: desired against actual handle acceleration, after"
    " the shift, with the regression line of desired on actual where R² is at least"
    f" {traces.LEAST_R2:.2f}: below, they have next to nothing in common. A perfect handle puts"
    " every sample on the dashed line; scatter around the red one is what R² leaves unexplained.",
    "fig11_spectra": "As the paper's Fig. 11: amplitude spectral density of desired and actual"
    " handle acceleration from 10 Hz to half the sampling rate. All panels have one scale. Where"
    " orange is below blue the handle shakes too little at that frequency, above it too much.",
}
"""Captions of the paper's figures by name of their plots."""

PATHS = (
    "paths of desired and actual handle acceleration in the planes of each two axes, in the first"
    f" {traces.PATH:g} s of the excerpt of the first figure. All panels have one scale, equal on"
    " both axes. A perfect handle draws orange on blue; a path that is turned is vibration in a"
    " wrong direction, and a single coil draws a line."
)
"""Caption of a figure of vectors, without the surface."""

FORCE = "actuator_force"
"""Column of the force, without axis and unit."""

SIGNALS = {
    topics.TOOL_ACCELERATION.name: "tool_acceleration",
    topics.DESIRED_ACCELERATION.name: "desired_acceleration",
    topics.HANDLE_ACCELERATION.name: "handle_acceleration",
    topics.ACTUATOR_FORCE.name: FORCE,
}
"""Columns of a table of signals by topic, without axis and unit."""

MOST_CONTROLLERS, MOST_SURFACES = 6, 8
"""Maximum numbers of columns and rows in a plot."""


def write_analysis(
    analysis: Analysis,
    folder: Path,
    comparison: Comparison | None = None,
    *,
    setting: Setting | None = None,
    files: Mapping[str, pd.DataFrame] | None = None,
) -> Path:
    """Write page, plots and tables of an analysis to a folder.

    Parameters
    ----------
    analysis : Analysis
    folder : Path
        Existing folder.
    comparison : Comparison, optional
    setting : Setting, optional
        Texts of the page; if specified, the page also shows the paper's figures as pictures.
    files : mapping of str to DataFrame, optional
        Further tables for CSV output by file name; a named index is included.

    Returns
    -------
    Path
        Page ``folder/index.html``. The folder also contains the plots as PNG and PDF,
        ``trials.csv``, ``groups.csv`` and, for a comparison, ``comparison.csv``.
    """
    tables = {"trials.csv": frames.trials(analysis), "groups.csv": frames.groups(analysis)}
    if comparison:
        tables["comparison.csv"] = comparison.frame
    tables = {name: table for name, table in tables.items() if len(table)} | dict(files or {})
    written = [*_save_plots(analysis, folder), *tables]
    for name, table in tables.items():
        # Names of bags may contain undecodable bytes.
        (folder / name).write_text(csv_text(table), encoding="utf-8", errors="backslashreplace")
    if setting:
        vectors = {name: f"{surface}: {PATHS}" for name, surface in _polarised(analysis).items()}
        captions = {f"{name}.png": text for name, text in (PICTURES | vectors).items()}
        shown = {file: text for file, text in captions.items() if file in written}
        setting = replace(setting, pictures=shown)
    write_page(analysis, folder / PAGE, comparison, setting=setting, files=written)
    return folder / PAGE


def as_json(analysis: Analysis, comparison: Comparison | None = None) -> dict[str, Any]:
    """Return all metrics for a program; undefined numbers are null."""
    rows = frames.trials(analysis).to_dict("records")
    content = {
        "shift": {"kind": analysis.shift.kind, "seconds": analysis.shift.seconds},
        "confidence": CONFIDENCE,
        "summary": summary(analysis, comparison),
        "trials": [
            row
            | {
                "lost_by_topic": trial.segment.delivery.lost,
                "missed_by_arm": trial.segment.delivery.missed,
                "age_us": trial.segment.delivery.age_us,
                "deadlines": trial.segment.delivery.deadlines,
                "warnings": trial.segment.delivery.warnings,
            }
            for row, trial in zip(rows, analysis.trials, strict=True)
        ],
        "groups": frames.groups(analysis).to_dict("records"),
        "paper": {
            "nrmse_percent": [
                {"surface": surface, "controller": controller, "value": value}
                for (surface, controller), value in TABLE_II.items()
            ],
            "regression": {
                controller: {"slope_desired_on_actual": slope, "r2": r2}
                for controller, (slope, r2) in REGRESSION.items()
            },
        },
        "two_hosts": [asdict(each) for each in analysis.across],
        "comparison": comparison.frame.to_dict("records") if comparison else None,
        "unpaired": comparison.unpaired if comparison else None,
        "problems": analysis.problems,
    }
    return dict(defined(content))


def signal_table(segment: Segment) -> pd.DataFrame:
    """Read the signals of a trial again; return them by time in s, under names with units."""
    whole = read_segment(segment.bag, segment.number)
    signals = {SIGNALS[name]: values for name, values in whole.signals.items()}
    actual = metrics.actual_acceleration(whole)
    if actual is not None:
        signals["actual_acceleration"] = actual
    frame = frames.segment_signals(replace(whole, signals=signals))
    return frame.rename(columns=lambda name: name + ("_N" if FORCE in name else "_m_s2"))


def _save_plots(analysis: Analysis, folder: Path) -> Iterator[str]:
    """Write the plots for which there are data; yield the names of their files."""
    from haptic_accel.analysis import plots

    drawn: dict[str, Any] = {}
    portraits = _typical(analysis)
    if portraits:
        draw = (plots.time_traces, plots.regressions, plots.amplitude_spectra)
        components = dict(_components(portraits))
        drawn |= {name: one(components) for name, one in zip(PICTURES, draw, strict=True)}
    for name, surface in _polarised(analysis).items():
        own = {c: one for (c, on), one in portraits.items() if on == surface and one.by_axis}
        if own:
            drawn[name] = plots.polarisation(own)
    errors = _band_errors(analysis)
    if any(errors.values()):
        drawn["bands"] = plots.band_errors(errors)
    return plots.save_plots(drawn, folder)


def _typical(analysis: Analysis) -> dict[tuple[str, str], traces.Portrait]:
    """Return a portrait of each condition, up to the maximum number of plots.

    For a surface, the pair with the median of the mean error over controllers is chosen, so that
    all controllers show one input. Without such a pair, each controller's median trial is chosen.
    """
    known = [trial for trial in analysis.trials if trial.portrait]
    frame = frames.trials(replace(analysis, trials=known))
    conditions = list(frames.by_condition(frame))
    controllers = list(dict.fromkeys(c for (c, _), _ in conditions))[:MOST_CONTROLLERS]
    surfaces = list(dict.fromkeys(s for (_, s), _ in conditions))[:MOST_SURFACES]
    found = {}
    for (controller, surface), own in conditions:
        errors = frame[frame.surface == surface].pivot_table(
            "nrmse_percent", ["grip", "pair"], "controller"
        )
        means = errors.dropna().mean(axis=1)
        if len(means):
            grip, pair = _median(means)
            own = own[(own.grip == grip) & (own["pair"] == pair)]
        portrait = known[_median(own.nrmse_percent)].portrait
        if portrait and controller in controllers and surface in surfaces:
            found[controller, surface] = portrait
    return found


def _polarised(analysis: Analysis) -> dict[str, str]:
    """Return the surfaces of trials of several axes, by the names of their plots."""
    surfaces = {t.surface for t in analysis.trials if t.portrait and t.portrait.by_axis}
    return {f"polarisation_{re.sub(r'[^A-Za-z0-9.-]+', '_', s)}": s for s in sorted(surfaces)}


def _components(portraits: traces.Portraits) -> Iterator[tuple[tuple[str, str], traces.Portrait]]:
    """Yield single-axis portraits; for several axes the surface is named as in ``plywood, x``."""
    for (controller, surface), portrait in portraits.items():
        if not portrait.by_axis:
            yield (controller, surface), portrait
        for axis, own in portrait.by_axis.items():
            yield (controller, f"{surface}, {axis}"), own


def _median(values: pd.Series[float]) -> Any:
    """Return the label of the median, or of the lower of two medians."""
    return values.sort_values(kind="stable").index[(len(values) - 1) // 2]


def _band_errors(analysis: Analysis) -> dict[str, dict[str, Interval]]:
    """Return the error by controller and band over all its surfaces, in percent."""
    found = frames.groups(analysis)
    columns = {name: frames.band_column(name) for name in frames.band_names(analysis)}
    errors = {}
    for controller in dict.fromkeys(found.controller):
        own = found[found.controller == controller]
        intervals = {
            band: mean_interval(own[name].tolist(), within=(0.0, math.inf))
            for band, name in columns.items()
        }
        errors[controller] = {band: found for band, found in intervals.items() if found.n}
    return errors

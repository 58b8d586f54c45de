"""Writes an analysis into a folder: page, figures for a paper, tables; and as JSON."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from haptic_accel.analysis.comparison import Comparison
from haptic_accel.analysis.frames import comparison_rows
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.measures import LATENCY_EDGES
from haptic_accel.analysis.page import write_page
from haptic_accel.analysis.plots import (
    PAPER,
    Bar,
    Grid,
    amplitude_spectra,
    band_errors,
    latencies,
    regressions,
    time_traces,
)
from haptic_accel.analysis.summary import summary
from haptic_accel.analysis.tables import Group, group_row, groups, trial_row
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II
from haptic_accel.core.evaluation.statistics import CONFIDENCE, mean_interval
from haptic_accel.core.model import FloatArray

PAGE = "index.html"

DPI = 300
"""Pixels per inch of PNG figures: what printers of papers ask for."""

EMBEDDED: dict[Any, Any] = {
    "pdf.fonttype": 42,
    "font.family": "sans-serif",
    "svg.fonttype": "none",
}
"""Text of PDF figures as TrueType: publishers refuse matplotlib's own Type 3."""

MOST_CONTROLLERS, MOST_SURFACES = 6, 8
"""That one figure has room for."""


def write_analysis(analysis: Analysis, folder: Path, comparison: Comparison | None = None) -> Path:
    """Write everything about some bags into a folder.

    Parameters
    ----------
    analysis : Analysis
    folder : Path
        There already.
    comparison : Comparison, optional

    Returns
    -------
    Path
        The page, ``folder/index.html``. Beside it lie the figures as PNG and PDF, ``trials.csv``,
        ``groups.csv`` and, with a comparison, ``comparison.csv``.
    """
    files = [*_write_figures(groups(analysis.trials), folder)]
    tables = {
        "trials.csv": [trial_row(trial) for trial in analysis.trials],
        "groups.csv": [group_row(group) for group in groups(analysis.trials)],
        "comparison.csv": comparison_rows(comparison) if comparison else [],
    }
    for name, rows in tables.items():
        if rows:
            _write_table(rows, folder / name)
            files.append(name)
    write_page(analysis, folder / PAGE, comparison, files=files)
    return folder / PAGE


def as_json(analysis: Analysis, comparison: Comparison | None = None) -> dict[str, Any]:
    """Return all figures for a program; what is not known is null."""
    content = {
        "shift": {"kind": analysis.shift.kind, "seconds": analysis.shift.seconds},
        "confidence": CONFIDENCE,
        "summary": summary(analysis, comparison),
        "trials": [
            trial_row(trial)
            | {
                "lost_by_topic": trial.measures.stretch.delivery.lost,
                "late_by_topic": trial.measures.stretch.delivery.late,
                "missed_by_arm": trial.measures.stretch.delivery.missed,
                "age_us": trial.measures.stretch.delivery.age_us,
                "warnings": trial.measures.stretch.delivery.warnings,
                "latency_counts": (
                    trial.measures.latency.counts.tolist() if trial.measures.latency else None
                ),
            }
            for trial in analysis.trials
        ],
        "latency_edges_s": LATENCY_EDGES.tolist(),
        "groups": [group_row(group) for group in groups(analysis.trials)],
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
        "comparison": comparison_rows(comparison) if comparison else None,
        "unpaired": comparison.unpaired if comparison else None,
        "problems": analysis.problems,
    }
    return dict(_known(content))


def write_json(content: Mapping[str, Any], file: Path) -> None:
    """Write figures for a program."""
    file.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _known(value: Any) -> Any:
    """Return the same with null for numbers that are none."""
    if isinstance(value, dict):
        return {key: _known(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_known(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write_table(rows: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Write rows as CSV; the columns are those of all rows, cells without a figure are empty."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    with file.open("w", encoding="utf-8", newline="") as opened:
        writer = csv.DictWriter(opened, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.9g}" if math.isfinite(value) else ""
    return value


# Figures


def _write_figures(found: Sequence[Group], folder: Path) -> Iterable[str]:
    """Write the figures, each as PNG and PDF; return the names of the files."""
    names = []
    with mpl.rc_context(EMBEDDED):
        for name, figure in _figures(found).items():
            for suffix in ("png", "pdf"):
                file = f"{name}.{suffix}"
                figure.savefig(folder / file, dpi=DPI)
                names.append(file)
    return names


def _figures(found: Sequence[Group]) -> dict[str, Figure]:
    figures = {}
    grid = _grid(found)
    if grid.portraits:
        figures["fig9_time"] = time_traces(grid, PAPER)
        figures["fig10_regression"] = regressions(grid, PAPER)
        figures["fig11_spectra"] = amplitude_spectra(grid, PAPER)
    errors = _band_errors(found)
    if any(errors.values()):
        figures["bands"] = band_errors(errors)
    counts = _latencies(found)
    if counts:
        figures["latency"] = latencies(counts, LATENCY_EDGES)
    return figures


def _grid(found: Sequence[Group]) -> Grid:
    """Return of each group the trial nearest the median error, as far as there is room."""
    controllers = list(dict.fromkeys(group.controller for group in found))[:MOST_CONTROLLERS]
    surfaces = list(dict.fromkeys(group.surface for group in found))[:MOST_SURFACES]
    typical = {
        (group.surface, group.controller): group.typical().measures.fidelity
        for group in found
        if group.controller in controllers and group.surface in surfaces
    }
    return Grid.of({key: fidelity.portrait for key, fidelity in typical.items() if fidelity})


def _band_errors(found: Sequence[Group]) -> dict[str, dict[str, Bar]]:
    """Return the error by controller and band over all its surfaces, in percent."""
    errors: dict[str, dict[str, Bar]] = {}
    for controller in dict.fromkeys(group.controller for group in found):
        by_band: dict[str, list[float]] = {}
        for group in found:
            if group.controller == controller:
                for band, interval in group.bands().items():
                    by_band.setdefault(band, []).append(interval.value)
        errors[controller] = {
            band: Bar(interval.value, interval.low, interval.high)
            for band, interval in ((b, mean_interval(values)) for b, values in by_band.items())
        }
    return errors


def _latencies(found: Sequence[Group]) -> dict[str, FloatArray]:
    """Return how many forces took how long, by controller."""
    counts: dict[str, FloatArray] = {}
    for group in found:
        for trial in group.trials:
            if trial.measures.latency:
                before = counts.get(group.controller, np.zeros(len(LATENCY_EDGES) - 1))
                counts[group.controller] = before + trial.measures.latency.counts
    return counts

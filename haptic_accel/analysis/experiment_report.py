"""Write the report of an experiment: a page, the paper's figures 9 to 11, tables and signals."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import itertools
import math
import os
import re
import urllib.parse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from haptic_accel.analysis.plots import (
    EXCERPT,
    MOST_POINTS,
    Grid,
    Portrait,
    amplitude_spectra,
    number,
    percent,
    regressions,
    time_traces,
)
from haptic_accel.core.evaluation.metrics import PAPER_DELAY, Evaluation, align
from haptic_accel.core.trial import Trial
from haptic_accel.pages import template

AVERAGE = "average"
"""Name of the average over surfaces, as a column of Table II and as a key of its mapping."""

SIGNALS = {
    "time": "time_s",
    "tool_acceleration": "tool_acceleration_m_s2",
    "desired_acceleration": "desired_acceleration_m_s2",
    "handle_acceleration": "handle_acceleration_m_s2",
    "actual_acceleration": "actual_acceleration_m_s2",
    "actuator_force": "actuator_force_N",
}
"""Columns of the signals' CSV by the name of the trial's array."""

_DPI = 130  # pixels per inch
_REGRESSION_COLUMNS = ("slope_desired_on_actual", "slope_actual_on_desired", "r2")


class Condition(Protocol):
    """One surface explored under one controller, and how well the handle followed.

    Attributes
    ----------
    trial : Trial
        The signals.
    evaluation : Evaluation
        Error, regression slopes and R^2 of the trial.
    age_us : mapping or None
        Age of the forces where they are applied, us: ``p50``, ``p99``, ``max``. ``None`` in
        lockstep, where nothing ages.
    lost, late : mapping or None
        Number of samples lost and late, by topic or node.
    bag : Path or None
        The recording, if one was made.
    """

    @property
    def trial(self) -> Trial: ...  # noqa: D102
    @property
    def evaluation(self) -> Evaluation: ...  # noqa: D102
    @property
    def age_us(self) -> Mapping[str, float] | None: ...  # noqa: D102
    @property
    def lost(self) -> Mapping[str, int] | None: ...  # noqa: D102
    @property
    def late(self) -> Mapping[str, int] | None: ...  # noqa: D102
    @property
    def bag(self) -> Path | None: ...  # noqa: D102


def write_report(
    conditions: Sequence[Condition],
    folder: Path | str,
    *,
    title: str,
    settings: Mapping[str, str],
    paper_table: Mapping[tuple[str, str], float],
    notes: Sequence[str] = (),
    delay: float = PAPER_DELAY,
    when: datetime.datetime | None = None,
) -> Path:
    """Write a page with figures, tables and signals of some conditions into a folder.

    Parameters
    ----------
    conditions : sequence of Condition
        What was run, in the order to show; each surface and controller at most once.
    folder : Path or str
        Where to write; made if it does not exist.
    title : str
        Heading of the page.
    settings : mapping of str to str
        What the conditions were run with, shown as a table: arguments, seed, rig.
    paper_table : mapping of (surface, controller) to float
        The paper's Table II in percent. A surface named ``average`` is taken as the paper's
        averages. What is missing is shown as a dash.
    notes : sequence of str
        Paragraphs shown under Table II.
    delay : float
        Time that the actual acceleration is shifted back, s, as in the evaluations.
    when : datetime, optional
        When the conditions were run; now by default.

    Returns
    -------
    Path
        The page, ``folder/index.html``. Beside it lie ``fig9_time.png``,
        ``fig10_regression.png``, ``fig11_spectra.png``, ``table.csv`` and one
        ``signals_SURFACE_CONTROLLER.csv`` per condition.

    Raises
    ------
    ValueError
        No condition, the same surface and controller twice, or a trial too short for a
        spectrum.
    """
    grid = _grid(conditions, delay)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = _signal_files(conditions)
    for condition, file in zip(conditions, files, strict=True):
        _write_signals(condition.trial, folder / file)
    _write_table(conditions, paper_table, folder / "table.csv")
    figures = {
        "fig9_time.png": time_traces(grid),
        "fig10_regression.png": regressions(grid),
        "fig11_spectra.png": amplitude_spectra(grid),
    }
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=_DPI)
    page = template("report.html.j2").render(
        title=title,
        when=(when or datetime.datetime.now()).astimezone(),
        settings=settings,
        notes=notes,
        table=_table_two(grid, paper_table),
        regression=_regression_rows(grid),
        conditions=_condition_rows(conditions, files, folder),
        live=any(c.age_us or c.lost is not None or c.late is not None for c in conditions),
        losses=_losses(conditions),
        sizes={name: _pixels(figure) for name, figure in figures.items()},
        surfaces=", ".join(grid.surfaces),
        controllers=", ".join(grid.controllers),
        most_points=MOST_POINTS,
        excerpt=EXCERPT,
        delay=f"{1e3 * delay:g} ms",
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8", errors="replace")
    return index


def _pixels(figure: Figure) -> tuple[int, int]:
    """Return width and height in a page's pixels, of which an inch has 96."""
    width, height = figure.get_size_inches()
    return round(96 * width), round(96 * height)


# Conditions by surface and controller


def _grid(conditions: Iterable[Condition], delay: float) -> Grid:
    """Sort conditions into a grid; raise ValueError if there is none, or one twice."""
    portraits: dict[tuple[str, str], Portrait] = {}
    for condition in conditions:
        trial = condition.trial
        key = (trial.surface, trial.controller)
        if key in portraits:
            raise ValueError(f"conditions: {key[0]} with {key[1]} is there twice")
        samples = math.floor(delay * trial.rate + 0.5)
        desired, actual = align(trial.desired_acceleration, trial.actual_acceleration, samples)
        portraits[key] = Portrait.of(desired, actual, trial.rate, condition.evaluation)
    if not portraits:
        raise ValueError("conditions: none given, at least one is needed")
    return Grid.of(portraits)


# CSV files


def _signal_files(conditions: Iterable[Condition]) -> list[str]:
    """Return a file name for the signals of each condition, safe and different from the others."""
    names: list[str] = []
    for condition in conditions:
        words = f"{condition.trial.surface} {condition.trial.controller}"
        stem = "signals_" + re.sub(r"[^A-Za-z0-9.-]+", "_", words)[:80]
        candidates = itertools.chain([stem], (f"{stem}_{n}" for n in itertools.count(2)))
        names.append(next(f"{c}.csv" for c in candidates if f"{c}.csv" not in names))
    return names


def _write_signals(trial: Trial, path: Path) -> None:
    signals = np.column_stack([getattr(trial, name) for name in SIGNALS])
    header = ",".join(SIGNALS.values())
    np.savetxt(path, signals, fmt="%.9g", delimiter=",", header=header, comments="")


def _write_table(
    conditions: Iterable[Condition], paper_table: Mapping[tuple[str, str], float], path: Path
) -> None:
    rows = [_table_row(condition, paper_table) for condition in conditions]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _table_row(
    condition: Condition, paper_table: Mapping[tuple[str, str], float]
) -> dict[str, str]:
    trial, evaluation, age = condition.trial, condition.evaluation, condition.age_us or {}
    key = (trial.surface, trial.controller)
    return {
        "surface": trial.surface,
        "controller": trial.controller,
        "nrmse_percent": _cell(evaluation.nrmse_percent),
        "paper_percent": _cell(paper_table.get(key)),
        "slope_desired_on_actual": _cell(evaluation.slope_desired_on_actual),
        "slope_actual_on_desired": _cell(evaluation.slope_actual_on_desired),
        "r2": _cell(evaluation.r2),
        "seconds": _cell(trial.seconds),
        "age_p50_us": _cell(age.get("p50")),
        "age_p99_us": _cell(age.get("p99")),
        "age_max_us": _cell(age.get("max")),
        "lost": _cell(_total(condition.lost)),
        "late": _cell(_total(condition.late)),
    }


def _cell(value: float | None) -> str:
    """Return a number for a CSV cell, empty where there is none."""
    return "" if value is None or not math.isfinite(value) else f"{value:.9g}"


# What the page shows


@dataclasses.dataclass(frozen=True)
class _Row:
    """A line of a table: what it is about, and its cells."""

    name: str
    cells: list[Any]


def _table_two(grid: Grid, paper_table: Mapping[tuple[str, str], float]) -> dict[str, Any]:
    """Return columns and rows of Table II; each cell is (measured, the paper's)."""
    columns = list(grid.surfaces)
    rows = []
    for controller in grid.controllers:
        measured = {
            surface: portrait.evaluation.nrmse_percent
            for surface, portrait in grid.of_controller(controller).items()
        }
        cells = [
            (percent(measured.get(surface)), percent(paper_table.get((surface, controller))))
            for surface in columns
        ]
        if len(columns) > 1:
            # An average over fewer surfaces than its neighbours would not compare with them.
            average = _mean(measured.values()) if len(measured) == len(columns) else None
            paper = _paper_average(set(columns), controller, paper_table)
            cells.append((percent(average), percent(paper)))
        rows.append(_Row(controller, cells))
    return {"columns": columns + [AVERAGE] * (len(columns) > 1), "rows": rows}


def _paper_average(
    surfaces: set[str], controller: str, paper_table: Mapping[tuple[str, str], float]
) -> float | None:
    """Return the paper's average of a controller if it is over the same surfaces as ours."""
    published = {s for s, c in paper_table if c == controller and s != AVERAGE}
    return paper_table.get((AVERAGE, controller)) if surfaces == published else None


def _regression_rows(grid: Grid) -> list[_Row]:
    """Return a group of rows per controller: slopes and R^2 of each surface, and the average."""
    groups = []
    for controller in grid.controllers:
        evaluations = {
            surface: portrait.evaluation
            for surface, portrait in grid.of_controller(controller).items()
        }
        rows = [
            _Row(surface, [number(getattr(evaluation, name)) for name in _REGRESSION_COLUMNS])
            for surface, evaluation in evaluations.items()
        ]
        if len(rows) > 1:
            means = [
                _mean(getattr(evaluation, name) for evaluation in evaluations.values())
                for name in _REGRESSION_COLUMNS
            ]
            rows.append(_Row(AVERAGE, [number(mean) for mean in means]))
        groups.append(_Row(controller, rows))
    return groups


def _condition_rows(
    conditions: Iterable[Condition], files: Iterable[str], folder: Path
) -> list[dict[str, str]]:
    """Return length, ages, losses and files of each condition."""
    rows = []
    for condition, file in zip(conditions, files, strict=True):
        age = condition.age_us or {}
        bag = condition.bag
        rows.append(
            {
                "surface": condition.trial.surface,
                "controller": condition.trial.controller,
                "seconds": number(condition.trial.seconds, 1),
                "rate": f"{condition.trial.rate:g}",
                "p50": number(age.get("p50"), 0),
                "p99": number(age.get("p99"), 0),
                "max": number(age.get("max"), 0),
                "lost": number(_total(condition.lost), 0),
                "late": number(_total(condition.late), 0),
                "signals": file,
                "bag": bag.name if bag else "",
                "bag_link": urllib.parse.quote(os.path.relpath(bag, folder)) if bag else "",
            }
        )
    return rows


def _losses(conditions: Iterable[Condition]) -> list[str]:
    """Return a line for each condition that lost samples or had late ones: which, how many."""
    lines = []
    for condition in conditions:
        parts = [
            f"{what} {name} {count}"
            for what, counts in (("lost", condition.lost), ("late", condition.late))
            for name, count in (counts or {}).items()
            if count
        ]
        if parts:
            trial = condition.trial
            lines.append(f"{trial.surface}, {trial.controller}: {', '.join(parts)}")
    return lines


def _total(samples: Mapping[str, int] | None) -> int | None:
    return None if samples is None else sum(samples.values())


def _mean(values: Iterable[float]) -> float:
    """Return the mean of the finite values, NaN where there is none."""
    finite = [value for value in values if math.isfinite(value)]
    return math.fsum(finite) / len(finite) if finite else math.nan

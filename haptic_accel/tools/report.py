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
from typing import Any, Literal, Protocol, TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FixedLocator,
    MaxNLocator,
    MultipleLocator,
    NullLocator,
    StrMethodFormatter,
)
from numpy.typing import NDArray

from haptic_accel.core.metrics import PAPER_DELAY, Evaluation, align, spectra
from haptic_accel.core.model import FloatArray
from haptic_accel.core.trial import Trial
from haptic_accel.pages import template

EXCERPT = 0.2
"""Length of the time traces, s: some strokes of texture, yet every swing can be seen."""

LOWEST_FREQUENCY = 10.0
"""Lower end of the spectra, Hz: below it the 15 Hz high-pass leaves little."""

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

DASH = "\N{EN DASH}"
"""What stands where there is no number."""


class _Style(TypedDict, total=False):
    """How a line is drawn, in matplotlib's words."""

    color: str
    linewidth: float
    linestyle: Literal["--", ""]
    marker: str
    markeredgewidth: float


# Of the palette of Okabe and Ito: apart in every common colour vision, and in print. Desired is
# the broader one, so that it is seen where actual lies on it.
_BLUE, _ORANGE, _VERMILION = "#0072b2", "#e69f00", "#d55e00"
_DESIRED: _Style = {"color": _BLUE, "linewidth": 2.0}
_ACTUAL: _Style = {"color": _ORANGE, "linewidth": 1.1}
_REGRESSION: _Style = {"color": _VERMILION, "linewidth": 2.0}
_EQUAL: _Style = {"color": "black", "linewidth": 1.0, "linestyle": "--"}
_SAMPLES: _Style = {"color": _BLUE, "marker": "o", "linestyle": "", "markeredgewidth": 0}

_DPI = 130  # pixels per inch
_CHARACTER = 0.115  # width of a bold letter of 12 points, inches
_MOST_POINTS = 4000  # in a scatter plot; more are drawn over each other
_DECADES = 4.5  # most that a spectrum's axis spans
_TICKS = (10, 20, 50, 100, 200, 500, 1000, 2000)  # Hz
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
    grid = _Grid.of(conditions, delay)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = _signal_files(conditions)
    for condition, file in zip(conditions, files, strict=True):
        _write_signals(condition.trial, folder / file)
    _write_table(conditions, paper_table, folder / "table.csv")
    figures = {
        "fig9_time.png": _time_traces(grid),
        "fig10_regression.png": _regressions(grid),
        "fig11_spectra.png": _amplitude_spectra(grid),
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
        most_points=_MOST_POINTS,
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


@dataclasses.dataclass(frozen=True)
class _Shifted:
    """A condition's desired and actual acceleration after the shift, with its evaluation."""

    rate: float
    desired: FloatArray
    actual: FloatArray
    evaluation: Evaluation


@dataclasses.dataclass(frozen=True)
class _Grid:
    """Conditions in rows of surfaces and columns of controllers; some may be missing."""

    surfaces: tuple[str, ...]
    controllers: tuple[str, ...]
    shifted: Mapping[tuple[str, str], _Shifted]

    @classmethod
    def of(cls, conditions: Iterable[Condition], delay: float) -> _Grid:
        """Sort conditions into a grid; raise ValueError if there is none, or one twice."""
        shifted: dict[tuple[str, str], _Shifted] = {}
        for condition in conditions:
            trial = condition.trial
            key = (trial.surface, trial.controller)
            if key in shifted:
                raise ValueError(f"conditions: {key[0]} with {key[1]} is there twice")
            samples = math.floor(delay * trial.rate + 0.5)
            desired, actual = align(trial.desired_acceleration, trial.actual_acceleration, samples)
            shifted[key] = _Shifted(trial.rate, desired, actual, condition.evaluation)
        if not shifted:
            raise ValueError("conditions: none given, at least one is needed")
        return cls(
            surfaces=tuple(dict.fromkeys(surface for surface, _ in shifted)),
            controllers=tuple(dict.fromkeys(controller for _, controller in shifted)),
            shifted=shifted,
        )

    def of_surface(self, surface: str) -> dict[str, _Shifted]:
        return {c: shifted for (s, c), shifted in self.shifted.items() if s == surface}

    def of_controller(self, controller: str) -> dict[str, _Shifted]:
        return {s: shifted for (s, c), shifted in self.shifted.items() if c == controller}


# Figures


def _panels(
    title: str,
    legend: Sequence[Line2D],
    rows: Sequence[str],
    columns: Sequence[str],
    size: tuple[float, float],
    down: float = 0.45,
    above: float = 0.34,
) -> tuple[Figure, list[list[Axes]]]:
    """Lay out a figure of axes of one size under a title, a legend and the columns' names.

    Sizes are in inches, and so are the gap `down` between rows and the height of the columns'
    names `above` the axes. It is laid out by hand because matplotlib's layout engines draw
    everything twice.
    """
    left, right, top, bottom, across = 1.15, 0.3, 0.91 + above, 0.65, 0.4
    width = max(left + len(columns) * (size[0] + across) - across + right, 7.2)
    height = top + len(rows) * (size[1] + down) - down + bottom
    figure = Figure(figsize=(width, height), facecolor="white")

    def heading(x: float, y: float, words: str, room: float, rotation: str) -> None:
        figure.text(
            x / width,
            y / height,
            _short(words, int(room / _CHARACTER)),
            size=12,
            weight="bold",
            ha="center",
            va="center",
            rotation=rotation,
            parse_math=False,
        )

    figure.text(left / width, 1 - 0.15 / height, title, size=14, weight="bold", va="top")
    figure.legend(
        handles=legend,
        loc="upper left",
        bbox_to_anchor=(left / width, 1 - 0.48 / height),
        ncols=len(legend),
        frameon=False,
        fontsize=11,
        borderaxespad=0,
        borderpad=0,
        handlelength=1.8,
    )
    axes = []
    for i, row in enumerate(rows):
        y = height - top - size[1] - i * (size[1] + down)
        heading(0.2, y + size[1] / 2, row, size[1], "vertical")
        axes.append(
            [
                figure.add_axes((x / width, y / height, size[0] / width, size[1] / height))
                for x in (left + j * (size[0] + across) for j in range(len(columns)))
            ]
        )
    for j, column in enumerate(columns):
        middle = left + j * (size[0] + across) + size[0] / 2
        heading(middle, height - top + above, column, size[0], "horizontal")
    return figure, axes


def _dress(axes: Sequence[Sequence[Axes]], x: str, y: str, one_x: bool = True) -> None:
    """Rule all axes; name and number those at the left and at the bottom.

    Where the rows have not `one_x` scale for all, x is numbered in each.
    """
    for i, row in enumerate(axes):
        for j, panel in enumerate(row):
            panel.set_axisbelow(True)
            panel.grid(color="#dddddd", linewidth=0.6)
            panel.spines[["top", "right"]].set_visible(False)
            lowest = i == len(axes) - 1
            panel.tick_params(labelsize=10, color="#888888")
            panel.tick_params(labelleft=j == 0, labelbottom=lowest or not one_x)
            if j == 0:
                panel.set_ylabel(y, fontsize=11)
            if lowest:
                panel.set_xlabel(x, fontsize=11)


def _traces() -> list[Line2D]:
    return [
        Line2D([], [], **_DESIRED, label="desired"),
        Line2D([], [], **_ACTUAL, label="actual, shifted back"),
    ]


def _time_traces(grid: _Grid) -> Figure:
    """Draw the paper's Fig. 9: desired and actual acceleration where desired is liveliest."""
    figure, axes = _panels(
        "Handle acceleration over time", _traces(), grid.surfaces, grid.controllers, (3.5, 1.9)
    )
    for surface, row in zip(grid.surfaces, axes, strict=True):
        windows = {
            controller: _liveliest(shifted.desired, round(EXCERPT * shifted.rate))
            for controller, shifted in grid.of_surface(surface).items()
        }
        extent = 1.05 * _extent(
            signal[windows[controller]]
            for controller, shifted in grid.of_surface(surface).items()
            for signal in (shifted.desired, shifted.actual)
        )
        for controller, panel in zip(grid.controllers, row, strict=True):
            panel.set_xlim(0, 1e3 * EXCERPT)
            panel.xaxis.set_major_locator(MultipleLocator(250 * EXCERPT))
            panel.set_ylim(-extent, extent)
            shifted = grid.shifted.get((surface, controller))
            if shifted is None:
                _not_run(panel)
                continue
            window = windows[controller]
            milliseconds = 1e3 * np.arange(window.stop - window.start) / shifted.rate
            panel.plot(milliseconds, shifted.desired[window], **_DESIRED)
            panel.plot(milliseconds, shifted.actual[window], **_ACTUAL)
            error = _percent(shifted.evaluation.nrmse_percent)
            _subtitle(panel, f"NRMSE {error}, from {window.start / shifted.rate:.2f} s")
    _dress(axes, "time in the excerpt (ms)", "acceleration (m/s²)")
    return figure


def _liveliest(signal: FloatArray, samples: int) -> slice:
    """Return the first window of so many samples that has the largest RMS."""
    samples = min(max(samples, 1), signal.size)
    energy = np.concatenate([[0.0], np.cumsum(signal**2)])
    start = int(np.argmax(energy[samples:] - energy[:-samples]))
    return slice(start, start + samples)


def _regressions(grid: _Grid) -> Figure:
    """Draw the paper's Fig. 10: desired against actual acceleration with the regression line."""
    legend = [
        Line2D([], [], **_SAMPLES, markersize=4, label="samples"),
        Line2D([], [], **_REGRESSION, label="regression of desired on actual"),
        Line2D([], [], **_EQUAL, label="1:1"),
    ]
    figure, axes = _panels(
        "Desired against actual handle acceleration",
        legend,
        grid.surfaces,
        grid.controllers,
        (3.0, 3.0),
        down=0.65,
    )
    for surface, row in zip(grid.surfaces, axes, strict=True):
        extent = 1.05 * _extent(
            signal
            for shifted in grid.of_surface(surface).values()
            for signal in (shifted.desired, shifted.actual)
        )
        for controller, panel in zip(grid.controllers, row, strict=True):
            panel.set_xlim(-extent, extent)
            panel.set_ylim(-extent, extent)
            panel.xaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10)))
            panel.yaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10)))
            shifted = grid.shifted.get((surface, controller))
            if shifted is None:
                _not_run(panel)
            else:
                _regression(panel, shifted, extent)
    _dress(axes, "actual (m/s²)", "desired (m/s²)", one_x=False)
    return figure


def _regression(panel: Axes, shifted: _Shifted, extent: float) -> None:
    """Draw one panel of `_regressions`."""
    some = _some(shifted.desired.size)
    panel.plot(
        shifted.actual[some],
        shifted.desired[some],
        **_SAMPLES,
        markersize=2,
        alpha=0.45,
    )
    panel.plot([-extent, extent], [-extent, extent], **_EQUAL)
    slope = shifted.evaluation.slope_desired_on_actual
    middle = (float(shifted.actual.mean()), float(shifted.desired.mean()))
    panel.axline(middle, slope=slope, **_REGRESSION)
    _subtitle(panel, f"slope {_number(slope)}, R² {_number(shifted.evaluation.r2)}")


def _some(size: int) -> NDArray[np.intp]:
    """Return the indices of at most so many points as can be told apart.

    They are drawn by lot, from a fixed seed, because every n-th would beat with a periodic
    signal.
    """
    if size <= _MOST_POINTS:
        return np.arange(size)
    return np.random.default_rng(0).choice(size, _MOST_POINTS, replace=False)


def _amplitude_spectra(grid: _Grid) -> Figure:
    """Draw the paper's Fig. 11: amplitude spectra of desired and actual acceleration."""
    figure, axes = _panels(
        "Amplitude spectra of the handle acceleration",
        _traces(),
        grid.controllers,
        grid.surfaces,
        (3.5, 2.2),
        above=0.2,
    )
    found = {
        key: spectra(shifted.desired, shifted.actual, shifted.rate)
        for key, shifted in grid.shifted.items()
    }
    drawn = [
        amplitude[spectrum.frequency >= LOWEST_FREQUENCY]
        for spectrum in found.values()
        for amplitude in (spectrum.desired, spectrum.actual)
    ]
    top = 2.0 * _extent(drawn)
    bottom = min((a[a > 0].min() for a in drawn if np.any(a > 0)), default=top)
    bottom = max(float(bottom), top * 10.0**-_DECADES)
    highest = max(shifted.rate for shifted in grid.shifted.values()) / 2
    for controller, row in zip(grid.controllers, axes, strict=True):
        for surface, panel in zip(grid.surfaces, row, strict=True):
            panel.set_xscale("log")
            panel.set_yscale("log")
            panel.set_xlim(LOWEST_FREQUENCY, highest)
            panel.set_ylim(bottom, top)
            panel.xaxis.set_major_locator(FixedLocator([t for t in _TICKS if t <= highest]))
            panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            panel.xaxis.set_minor_locator(NullLocator())
            panel.yaxis.set_minor_locator(NullLocator())
            spectrum = found.get((surface, controller))
            if spectrum is None:
                _not_run(panel)
                continue
            panel.plot(spectrum.frequency, spectrum.desired, **_DESIRED)
            panel.plot(spectrum.frequency, spectrum.actual, **_ACTUAL)
    _dress(axes, "frequency (Hz)", "amplitude (m/s²/√Hz)")
    return figure


def _extent(signals: Iterable[FloatArray]) -> float:
    """Return the largest magnitude in some signals, or 1 if all are zero."""
    return max((float(np.abs(signal).max()) for signal in signals), default=0.0) or 1.0


def _subtitle(panel: Axes, words: str) -> None:
    panel.set_title(words, fontsize=10, pad=4)


def _not_run(panel: Axes) -> None:
    panel.text(
        0.5, 0.5, "not run", transform=panel.transAxes, ha="center", color="#666666", fontsize=11
    )


def _short(name: str, longest: int) -> str:
    """Return a name on one line, cut to so many characters."""
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    return name if len(name) <= longest else name[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"


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


def _table_two(grid: _Grid, paper_table: Mapping[tuple[str, str], float]) -> dict[str, Any]:
    """Return columns and rows of Table II; each cell is (measured, the paper's)."""
    columns = list(grid.surfaces)
    rows = []
    for controller in grid.controllers:
        measured = {
            surface: shifted.evaluation.nrmse_percent
            for surface, shifted in grid.of_controller(controller).items()
        }
        cells = [
            (_percent(measured.get(surface)), _percent(paper_table.get((surface, controller))))
            for surface in columns
        ]
        if len(columns) > 1:
            # An average over fewer surfaces than its neighbours would not compare with them.
            average = _mean(measured.values()) if len(measured) == len(columns) else None
            paper = _paper_average(set(columns), controller, paper_table)
            cells.append((_percent(average), _percent(paper)))
        rows.append(_Row(controller, cells))
    return {"columns": columns + [AVERAGE] * (len(columns) > 1), "rows": rows}


def _paper_average(
    surfaces: set[str], controller: str, paper_table: Mapping[tuple[str, str], float]
) -> float | None:
    """Return the paper's average of a controller if it is over the same surfaces as ours."""
    published = {s for s, c in paper_table if c == controller and s != AVERAGE}
    return paper_table.get((AVERAGE, controller)) if surfaces == published else None


def _regression_rows(grid: _Grid) -> list[_Row]:
    """Return a group of rows per controller: slopes and R^2 of each surface, and the average."""
    groups = []
    for controller in grid.controllers:
        evaluations = {
            surface: shifted.evaluation
            for surface, shifted in grid.of_controller(controller).items()
        }
        rows = [
            _Row(surface, [_number(getattr(evaluation, name)) for name in _REGRESSION_COLUMNS])
            for surface, evaluation in evaluations.items()
        ]
        if len(rows) > 1:
            means = [
                _mean(getattr(evaluation, name) for evaluation in evaluations.values())
                for name in _REGRESSION_COLUMNS
            ]
            rows.append(_Row(AVERAGE, [_number(mean) for mean in means]))
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
                "seconds": _number(condition.trial.seconds, 1),
                "rate": f"{condition.trial.rate:g}",
                "p50": _number(age.get("p50"), 0),
                "p99": _number(age.get("p99"), 0),
                "max": _number(age.get("max"), 0),
                "lost": _number(_total(condition.lost), 0),
                "late": _number(_total(condition.late), 0),
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


def _percent(value: float | None) -> str:
    return _number(value, 1, " %")


def _number(value: float | None, decimals: int = 2, unit: str = "") -> str:
    """Return a number for a reader, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    rounded = round(value, decimals) + 0.0  # no minus before a zero
    return f"{rounded:.{decimals}f}{unit}".replace("-", "\N{MINUS SIGN}")

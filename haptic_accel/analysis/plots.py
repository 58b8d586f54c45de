# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Palette, axes and plots of all reports: the paper's Figs. 9 to 11, errors by band.

The package defines colours and plots in this module only. It loads matplotlib, so that commands
import it when they draw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, cycle, product
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_accel.analysis.traces import EXCERPT, LEAST_R2, PATH, Portrait, Portraits, extent
from haptic_accel.core.evaluation.statistics import Interval
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tables import DASH, number

LOWEST_FREQUENCY = 10.0
"""Lower end of the spectra, Hz: the 15 Hz high-pass leaves little below it."""

DPI = 300
"""Resolution of PNG plots, pixels per inch, as required for printed papers."""

COLUMN, TEXT = 3.5, 7.16
"""Widths of a column and of the text of an IEEE paper, inches."""

BLUE, ORANGE, GREEN, VERMILION = "#0072b2", "#e69f00", "#009e73", "#d55e00"
DARK_ORANGE = "#c77d00"
"""Orange for the actual acceleration in all plots and pages, dark enough for lines on white."""

PURPLE, SKY, GREY = "#cc79a7", "#56b4e9", "#444444"
"""Palette of Okabe and Ito, distinguishable with any colour vision and in print."""

BARS = (BLUE, ORANGE, GREEN, PURPLE, SKY, GREY)
HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "--")
"""Colours of bars, and hatches that distinguish bars without colour."""

PALE_GRIPS = ("#c3c8cd", "#f3cf85", "#a6d9f7", "#e9c3d8")
DARK_GRIPS = ("#4d545b", "#a87400", "#1f7fb4", "#99447a")
"""Pale and dark colour of the measurements of each grip."""

SHADE, LINE, BLACK = "#e4e7ea", "#999999", "#000000"
"""Colours of excluded areas, of their limits, and of models that must not hide data."""

DASHES = ("-", "--", "-.", ":")
"""Dashes that distinguish lines without colour."""

Style = dict[str, Any]
"""Style of a line, with matplotlib's keys."""

DESIRED: Style = {"color": BLUE, "linewidth": 1.2}
ACTUAL: Style = {"color": DARK_ORANGE, "linewidth": 0.66}
"""Lines of desired and actual acceleration; the desired one is wider, so that it is visible below
the actual one."""

_REGRESSION: Style = {"color": VERMILION, "linewidth": 1.2}
_EQUAL: Style = {"color": "black", "linewidth": 0.6, "linestyle": "--"}
_VALUES: Style = {"color": SKY, "marker": "o", "linestyle": "", "markersize": 3.4}
_SAMPLES: Style = {"color": BLUE, "marker": "o", "linestyle": "", "markeredgewidth": 0}
_TRACES = (
    Line2D([], [], **DESIRED, label="desired"),
    Line2D([], [], **ACTUAL, label="actual, shifted back"),
)

_LABEL, _TICK = 8, 7  # text sizes, points
_LONGEST = 60  # characters of the name of a row
_CHARACTER = 0.115 / 12  # width of a bold letter per point of font size, inches
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.7, 0.11, 0.47, 0.36  # margins of a figure of panels, inches
_ACROSS, _DOWN = 0.2, 0.24  # gaps between panels, inches
_SUBTITLE: Style = {"fontsize": _TICK, "pad": 2.5}
_HEADING = 0.23  # from the panels to the centre of the column names, inches
_DECADES = 4.5  # maximum range of a spectrum's axis
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)  # Hz
_FEW_TICKS = (10, 30, 100, 300, 1000)  # Hz, for small panels
_LEGEND: Style = {"loc": "upper left", "frameon": False, "borderaxespad": 0}
_LEGEND |= {"fontsize": _LABEL, "borderpad": 0, "handlelength": 1.8}
_KEY: Style = {"loc": "lower left", "frameon": False, "borderaxespad": 0, "columnspacing": 1.0}
_KEY |= {"fontsize": _TICK, "borderpad": 0.2, "handlelength": 1.6, "bbox_to_anchor": (0, 1.0)}
EMBEDDED: dict[Any, Any] = {"pdf.fonttype": 42, "font.family": "sans-serif"}
"""Text of PDF plots as TrueType, as publishers reject matplotlib's default Type 3."""


# Numbers and names


def short(name: str, longest: int = 24) -> str:
    """Return a name on one line, cut to a number of characters."""
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    return name if len(name) <= longest else name[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"


# The paper's figures


def time_traces(portraits: Portraits) -> Figure:
    """Draw the paper's Fig. 9: both accelerations where the desired one is largest."""
    names = ("time in the excerpt (ms)", "acceleration (m/s²)")
    figure, panels = _panels(portraits, _TRACES, names, 1.9 / 3.5)
    for (controller, surface), panel in panels.items():
        drawn = _on(portraits, surface)
        reach = 1.05 * extent(signal for p in drawn for signal in (p.desired, p.actual))
        panel.set_xlim(0, 1e3 * EXCERPT)
        panel.xaxis.set_major_locator(ticker.MultipleLocator(500 * EXCERPT))
        panel.set_ylim(-reach, reach)
        if portrait := portraits.get((controller, surface)):
            milliseconds = 1e3 * np.arange(portrait.desired.size) / portrait.rate
            panel.plot(milliseconds, portrait.desired, **DESIRED)
            panel.plot(milliseconds, portrait.actual, **ACTUAL)
            error = number(portrait.evaluation.nrmse_percent, 1, " %")
            _subtitle(
                panel, f"NRMSE {error}, from {portrait.begin:.2f} s", f"NRMSE {error}", error
            )
    return figure


def regressions(portraits: Portraits) -> Figure:
    """Draw the paper's Fig. 10: desired over actual acceleration with the regression line."""
    legend = (
        Line2D([], [], **_SAMPLES, markersize=4, label="samples"),
        Line2D(
            [],
            [],
            **_REGRESSION,
            label=f"regression of desired on actual, where R² ≥ {LEAST_R2:.2f}",
        ),
        Line2D([], [], **_EQUAL, label="1:1"),
    )
    names = ("actual (m/s²)", "desired (m/s²)")
    figure, panels = _panels(portraits, legend, names, 1.0, one_x=False, more_down=0.12)
    for (controller, surface), panel in panels.items():
        reach = 1.05 * max(portrait.largest for portrait in _on(portraits, surface))
        panel.set(xlim=(-reach, reach), ylim=(-reach, reach))
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(ticker.MaxNLocator(5, steps=(1, 2, 5, 10)))
        if portrait := portraits.get((controller, surface)):
            cloud = portrait.cloud_actual, portrait.cloud_desired
            # Rasterise: thousands of points make a vector drawing slow to display.
            panel.plot(*cloud, **_SAMPLES, markersize=1.2, alpha=0.45, rasterized=True)
            panel.plot([-reach, reach], [-reach, reach], **_EQUAL)
            texts = [f"R² {number(portrait.evaluation.r2)}"]
            if portrait.regressed:
                slope = portrait.evaluation.slope_desired_on_actual
                middle = (portrait.mean_actual, portrait.mean_desired)
                panel.axline(middle, slope=slope, **_REGRESSION)
                texts.insert(0, f"slope {number(slope)}, {texts[0]}")
            else:
                texts.insert(0, f"{texts[0]}: no regression")
            _subtitle(panel, *texts)
    return figure


def amplitude_spectra(portraits: Portraits) -> Figure:
    """Draw the paper's Fig. 11: amplitude spectra of desired and actual acceleration."""
    names = ("frequency (Hz)", "amplitude (m/s²/√Hz)")
    figure, panels = _panels(
        portraits, _TRACES, names, 2.2 / 3.5, surfaces_down=False, less_above=0.084
    )
    drawn = [
        amplitude[portrait.spectra.frequency >= LOWEST_FREQUENCY]
        for portrait in portraits.values()
        for amplitude in (portrait.spectra.desired, portrait.spectra.actual)
    ]
    top = 2.0 * extent(drawn)
    bottom = min((a[a > 0].min() for a in drawn if np.any(a > 0)), default=top)
    bottom = max(float(bottom), top * 10.0**-_DECADES)
    highest = max(portrait.rate for portrait in portraits.values()) / 2
    for key, panel in panels.items():
        frequency_axis(panel, LOWEST_FREQUENCY, highest, _FEW_TICKS)
        panel.set(yscale="log", ylim=(bottom, top))
        panel.yaxis.set_minor_locator(ticker.NullLocator())
        if key in portraits:
            spectrum = portraits[key].spectra
            panel.plot(spectrum.frequency, spectrum.desired, **DESIRED)
            panel.plot(spectrum.frequency, spectrum.actual, **ACTUAL)
    return figure


def polarisation(portraits: Mapping[str, Portrait]) -> Figure:
    """Draw the paths of desired and actual acceleration in the plane of each pair of axes.

    Parameters
    ----------
    portraits : mapping
        Portraits of vectors on one surface, by controller.
    """
    axes = next(iter(portraits.values())).by_axis
    planes = {f"{across}-{up}": (across, up) for across, up in combinations(axes, 2)}
    rows = {(name, row): portraits[name] for row, name in product(planes, portraits)}
    figure, panels = _panels(rows, _TRACES, ("", ""), 1.0, one_x=False, more_down=0.2)
    drawn = [
        part[: round(PATH * portrait.rate)]
        for portrait in portraits.values()
        for part in (portrait.desired, portrait.actual)
    ]
    reach = 1.05 * extent(drawn)
    for (controller, row), panel in panels.items():
        panel.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(ticker.MaxNLocator(5, steps=(1, 2, 5, 10)))
        own = portraits[controller].by_axis
        across, up = planes[row]
        panel.set_xlabel(f"{across} (m/s²)", fontsize=_LABEL, labelpad=1)
        if controller == next(iter(portraits)):
            panel.set_ylabel(f"{up} (m/s²)", fontsize=_LABEL)
        part = slice(round(PATH * own[up].rate))
        panel.plot(own[across].desired[part], own[up].desired[part], **DESIRED)
        panel.plot(own[across].actual[part], own[up].actual[part], **ACTUAL)
    return figure


# Plots of one column


def band_errors(errors: Mapping[str, Mapping[str, Interval]]) -> Figure:
    """Draw the error within frequency bands, as a group of bars per band.

    Parameters
    ----------
    errors : mapping
        NRMSE in percent by controller and by band.
    """
    names = list(errors)
    found = list(dict.fromkeys(band for by_band in errors.values() for band in by_band))
    figure, panel = _column(2.1, "band (Hz)", "NRMSE (%)", "y")
    width = 0.8 / max(len(names), 1)
    unknown = Interval(math.nan, math.nan, math.nan, 0, "")
    ticks = np.arange(len(found))
    for i, (name, color, hatch) in enumerate(zip(names, cycle(BARS), cycle(HATCHES))):
        bars = [errors[name].get(band, unknown) for band in found]
        reach = np.array([[bar.value - bar.low, bar.high - bar.value] for bar in bars]).T
        style: Style = {"color": color, "hatch": hatch, "edgecolor": "white", "linewidth": 0.4}
        if found:
            style["yerr"] = np.nan_to_num(np.maximum(reach, 0.0))
            style["error_kw"] = {"elinewidth": 0.6, "capsize": 1.2}
        middles = ticks + (i - (len(names) - 1) / 2) * width
        panel.bar(middles, [bar.value for bar in bars], width, label=short(name), **style)
    panel.axhline(100.0, **_EQUAL)
    labels = [band.removesuffix(" Hz").replace("-", DASH) for band in found]
    panel.set_xticks(ticks, labels)
    panel.legend(ncols=max(min(len(names), 4), 1), **_KEY)
    return figure


# Plots of studies with participants


@dataclass(frozen=True)
class Strip:
    """Values of one quantity, and an estimate such as their mean.

    Attributes
    ----------
    values : iterable of float
        Value of each participant; empty if there is only the estimate.
    estimate : Interval
    """

    values: Iterable[float]
    estimate: Interval


def strips(rows: Mapping[str, Strip], x: str, reference: float | None = None) -> Figure:
    """Draw a row for each name: values as pale dots, the estimate with its interval above them.

    Parameters
    ----------
    rows : mapping of str to Strip
    x : str
        Name and unit of the values.
    reference : float, optional
        Value to mark by a dashed line, such as chance level.
    """
    figure, panel = _named_rows([short(name, _LONGEST) for name in rows], x)
    for row, strip in enumerate(rows.values()):
        values = list(strip.values)
        spread = row + np.linspace(-0.25, 0.25, len(values)) if len(values) > 1 else [row]
        panel.plot(values, spread[: len(values)], **_VALUES)
        found = strip.estimate
        if math.isfinite(found.low) and math.isfinite(found.high):
            panel.plot((found.low, found.high), (row, row), color=BLUE, linewidth=1.4)
        panel.plot(found.value, row, "D", color=BLUE, markersize=4)
    if reference is not None:
        panel.axvline(reference, **_EQUAL)
    panel.set_ylim(len(rows) - 0.5, -0.5)
    return figure


def matrix(table: pd.DataFrame, texts: tuple[str, str, str]) -> Figure:
    """Draw a square table of numbers as shaded cells with the numbers.

    Parameters
    ----------
    table : DataFrame
        Table with names of rows and columns.
    texts : tuple of str
        Names of the columns, the rows and the values.
    """
    shown, values = [short(name, _LONGEST) for name in table.index], table.to_numpy(float)
    figure, panel = _named_rows(shown, texts[0], square=True)
    drawn = panel.imshow(values, cmap="Blues", aspect="auto", vmin=0)
    middle = 0.5 * float(np.nanmax(values))
    for (row, column), value in np.ndenumerate(values):
        if math.isfinite(value):
            color = "white" if value > middle else BLACK
            text: Style = {"ha": "center", "va": "center", "fontsize": _TICK, "color": color}
            panel.text(column, row, f"{value:.3g}", **text)
    panel.set_xticks(range(len(shown)), shown, rotation=30, ha="right")
    panel.set_ylabel(texts[1], fontsize=_LABEL)
    panel.grid(visible=False)
    bar = figure.colorbar(drawn, ax=panel)
    bar.set_label(texts[2], fontsize=_LABEL)
    bar.ax.tick_params(labelsize=_TICK)
    return figure


def scaling_map(points: FloatArray, names: Sequence[str]) -> Figure:
    """Draw a map of named points, whose distances are dissimilarities.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    names : sequence of str
    """
    figure, panel = _column(
        3.0, "dimension 1 (unit of the ratings)", "dimension 2 (unit of the ratings)"
    )
    panel.plot(points[:, 0], points[:, 1], "o", color=BLUE, markersize=4)
    for (x, y), name in zip(points, names, strict=True):
        above: Style = {"xytext": (0, 5), "textcoords": "offset points", "ha": "center"}
        panel.annotate(short(name), (x, y), fontsize=_TICK, **above)
    panel.margins(0.3)
    panel.set_aspect("equal", "datalim")
    return figure


@dataclass(frozen=True)
class FittedCurve:
    """Measured proportions, and the function fitted to them.

    Attributes
    ----------
    points : DataFrame
        ``mean``, the proportion, and ``size``, the number of trials, by level.
    x, y : ndarray, shape (m,)
        The function.
    threshold : float
    """

    points: pd.DataFrame
    x: FloatArray
    y: FloatArray
    threshold: float


def fitted_curves(curves: Mapping[str, FittedCurve], x: str, log: bool) -> Figure:
    """Draw a panel for each participant: proportions correct by level, and the fitted function.

    The area of a dot is in proportion to its number of trials.
    """
    across = min(len(curves), 4)
    down = math.ceil(len(curves) / across)
    figure = Figure(figsize=(TEXT, 0.5 + 1.5 * down), facecolor="white", layout="constrained")
    panels = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    for panel in panels.flat[len(curves) :]:
        panel.set_visible(False)
    for panel, (name, curve) in zip(panels.flat, curves.items(), strict=False):
        rule(panel, width=0.36)
        points = curve.points
        panel.scatter(
            points.index, points["mean"], s=3 * points["size"], color=SKY, edgecolor=BLUE
        )
        panel.plot(curve.x, curve.y, color=BLUE, linewidth=1.2)
        panel.axvline(curve.threshold, **_EQUAL)
        panel.set_ylim(-0.03, 1.05)
        if log:
            panel.set_xscale("log")
            panel.xaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
            panel.xaxis.set_minor_locator(ticker.NullLocator())
        panel.xaxis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
        panel.set_title(short(name), **_SUBTITLE)
        panel.tick_params(labelsize=_TICK)
    figure.supxlabel(x, fontsize=_LABEL)
    figure.supylabel("proportion correct", fontsize=_LABEL)
    return figure


def _named_rows(names: Sequence[str], x: str, square: bool = False) -> tuple[Figure, Axes]:
    """Create a panel with a row for each name; the number of rows determines its height."""
    wide, each = (TEXT * 0.7, 0.32) if square else (TEXT * 0.8, 0.28)
    size = (wide, 0.8 + each * len(names) + 0.4 * square)
    figure = Figure(figsize=size, facecolor="white", layout="constrained")
    panel = figure.add_subplot()
    rule(panel, width=0.36)
    panel.tick_params(labelsize=_TICK)
    panel.set_yticks(range(len(names)), names, parse_math=False)
    panel.set_xlabel(x, fontsize=_LABEL)
    return figure, panel


def save_plots(plots: Mapping[str, Figure], folder: Path) -> Iterator[str]:
    """Write plots by name as PNG and PDF; yield the file names."""
    with mpl.rc_context(EMBEDDED):
        for name, figure in plots.items():
            for suffix in ("png", "pdf"):
                figure.savefig(folder / f"{name}.{suffix}", dpi=DPI)
                yield f"{name}.{suffix}"


# Axes


def frequency_axis(
    panel: Axes, low: float, high: float, ticks: Sequence[float] = _TICKS, ends: bool = False
) -> None:
    """Make x a logarithmic frequency axis, Hz, optionally with ticks at its `ends`."""
    panel.set_xscale("log")
    if ends:
        # Labels at the ends must be complete, without overlap by other ticks.
        panel.set_xlim(low / 1.03, high * 1.03)
        ticks = [low, *(tick for tick in ticks if low * 1.2 < tick < high / 1.2), high]
    else:
        panel.set_xlim(low, high)
        ticks = [tick for tick in ticks if tick <= high]
    panel.xaxis.set_major_locator(ticker.FixedLocator(ticks))
    panel.xaxis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
    panel.xaxis.set_minor_locator(ticker.NullLocator())


def rule(panel: Axes, grid: Literal["both", "y"] = "both", width: float = 0.6) -> None:
    """Style a panel: a pale grid behind the data, no frame at the top and right."""
    panel.set_axisbelow(True)
    panel.grid(axis=grid, color="#dddddd", linewidth=width)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(color="#888888")


def _column(
    height: float, x: str, y: str, grid: Literal["both", "y"] = "both"
) -> tuple[Figure, Axes]:
    """Create one panel with the width of a column and named axes."""
    figure = Figure(figsize=(COLUMN, height), facecolor="white")
    panel = figure.add_axes(
        (0.5 / COLUMN, 0.42 / height, (COLUMN - 0.56) / COLUMN, (height - 0.7) / height)
    )
    rule(panel, grid, 0.36)
    panel.tick_params(labelsize=_TICK)
    panel.set_xlabel(x, fontsize=_LABEL)
    panel.set_ylabel(y, fontsize=_LABEL)
    return figure, panel


def _on(portraits: Portraits, surface: str) -> list[Portrait]:
    """Return the portraits of one surface."""
    return [portrait for (_, own), portrait in portraits.items() if own == surface]


def _panels(
    portraits: Portraits,
    legend: Sequence[Line2D],
    names: tuple[str, str],
    shape: float,
    *,
    surfaces_down: bool = True,
    one_x: bool = True,
    more_down: float = 0.0,
    less_above: float = 0.0,
) -> tuple[Figure, dict[tuple[str, str], Axes]]:
    """Create a panel for each controller and surface, with the width of a paper's text.

    The legend and the column names are at the top. Panels without a portrait are labelled so. The
    layout is computed here, as matplotlib's layout engines draw everything twice.

    Parameters
    ----------
    portraits : mapping
    legend : sequence of Line2D
    names : tuple of str
        Names of the x and y axes.
    shape : float
        Ratio of a panel's height to its width.
    surfaces_down : bool
        Use a row per surface instead of a column.
    one_x : bool
        All rows share one x scale, which is labelled at the bottom only.
    more_down, less_above : float
        Addition to the gap between rows, taken from the height of the column names, inches.
    """
    controllers, surfaces = (list(dict.fromkeys(part)) for part in zip(*portraits, strict=True))
    rows, columns = (surfaces, controllers) if surfaces_down else (controllers, surfaces)
    top, down = _TOP - less_above, _DOWN + more_down
    wide = (TEXT - _LEFT - _RIGHT + _ACROSS) / len(columns) - _ACROSS
    high = wide * shape
    height = top + len(rows) * (high + down) - down + _BOTTOM
    figure = Figure(figsize=(TEXT, height), facecolor="white")
    corner = (_LEFT / TEXT, 1 - 0.05 / height)
    figure.legend(handles=legend, bbox_to_anchor=corner, ncols=len(legend), **_LEGEND)

    def heading(x: float, y: float, name: str, room: float, rotation: str) -> None:
        text = short(name, int(room / (_CHARACTER * _LABEL)))
        font: Style = {"size": _LABEL, "weight": "bold", "rotation": rotation, "parse_math": False}
        figure.text(x / TEXT, y / height, text, ha="center", va="center", **font)

    panels = {}
    for (i, row), (j, column) in product(enumerate(rows), enumerate(columns)):
        x, y = _LEFT + j * (wide + _ACROSS), height - top - high - i * (high + down)
        panel = figure.add_axes((x / TEXT, y / height, wide / TEXT, high / height))
        rule(panel, width=0.36)
        lowest = i == len(rows) - 1
        panel.tick_params(labelsize=_TICK, labelleft=j == 0, labelbottom=lowest or not one_x)
        if i == 0:
            heading(x + wide / 2, y + high + _HEADING - less_above, column, wide, "horizontal")
        if j == 0:
            heading(0.13, y + high / 2, row, high + down, "vertical")
        # Panels are shorter than the label, so it is drawn once, in the middle.
        if j == 0 and i == len(rows) // 2:
            panel.set_ylabel(names[1], fontsize=_LABEL)
        if lowest and j == 0:
            middle = 0.5 * len(columns) + 0.5 * (len(columns) - 1) * _ACROSS / wide
            panel.set_xlabel(names[0], fontsize=_LABEL, x=middle)
        key = (column, row) if surfaces_down else (row, column)
        panels[key] = panel
        if key not in portraits:
            style: Style = {"ha": "center", "color": "#666666", "fontsize": _LABEL}
            panel.text(0.5, 0.5, "not run", transform=panel.transAxes, **style)
    return figure, panels


def _subtitle(panel: Axes, *texts: str) -> None:
    """Set the first of several subtitles that fits the panel's width, or the last one."""
    room = panel.get_position().width * TEXT / (_CHARACTER * _TICK)
    fitting = (text for text in texts if len(text) <= room)
    panel.set_title(next(fitting, texts[-1]), **_SUBTITLE)

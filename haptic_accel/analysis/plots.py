"""The paper's figures 9 to 11 of some conditions, for a page and for print; errors and latencies.

What is drawn of a trial is kept as a `Portrait`, a few thousand numbers, so that a long recording
need not stay in memory.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypedDict

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

from haptic_accel.analysis.thinning import liveliest, some
from haptic_accel.core.evaluation.metrics import Evaluation, Spectra, spectra
from haptic_accel.core.model import FloatArray

EXCERPT = 0.2
"""Length of the time traces, s: some strokes of texture, yet every swing can be seen."""

LOWEST_FREQUENCY = 10.0
"""Lower end of the spectra, Hz: below it the 15 Hz high-pass leaves little."""

MOST_POINTS = 4000
"""Points of a scatter plot; more are drawn over each other."""

DASH = "\N{EN DASH}"
"""What stands where there is no number."""

CHARACTER = 0.115 / 12
"""Width of a bold letter per point of its size, inches."""

_DECADES = 4.5  # most that a spectrum's axis spans
_TICKS = (10, 20, 50, 100, 200, 500, 1000, 2000)  # Hz
_FEW_TICKS = (10, 30, 100, 300, 1000)  # Hz, where there is little room


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


@dataclasses.dataclass(frozen=True)
class Look:
    """Sizes of a figure for where it is seen.

    Attributes
    ----------
    width : float or None
        Of the whole figure, inches; None for as wide as its panels are.
    title, heading, label, tick : float
        Sizes of text, points; a title of 0 is left out.
    lines : float
        By which the widths of lines are multiplied.
    left, right, top, bottom, across, down : float
        Margins, and gaps between columns and rows, inches.
    """

    width: float | None
    title: float
    heading: float
    label: float
    tick: float
    lines: float
    left: float
    right: float
    top: float
    bottom: float
    across: float
    down: float


PAGE = Look(None, 14, 12, 11, 10, 1.0, 1.15, 0.3, 0.91, 0.65, 0.4, 0.45)
"""Under its title on a page."""

COLUMN, TEXT = 3.5, 7.16
"""Width of a column and of the text of an IEEE paper, inches."""

PAPER = Look(TEXT, 0, 8, 8, 7, 0.6, 0.7, 0.11, 0.24, 0.36, 0.2, 0.24)
"""In a paper across both columns, 8 points, its title in the caption."""


@dataclasses.dataclass(frozen=True)
class Portrait:
    """What is drawn of a trial after the shift.

    Attributes
    ----------
    rate : float
        Samples per second.
    evaluation : Evaluation
    spectra : Spectra
    begin : float
        Of the excerpt, s.
    desired, actual : ndarray
        The excerpt, where desired is liveliest, m/s^2.
    cloud_desired, cloud_actual : ndarray
        Some samples of the whole trial, m/s^2.
    mean_desired, mean_actual : float
        m/s^2.
    largest : float
        Magnitude in either signal, m/s^2.
    """

    rate: float
    evaluation: Evaluation
    spectra: Spectra
    begin: float
    desired: FloatArray
    actual: FloatArray
    cloud_desired: FloatArray
    cloud_actual: FloatArray
    mean_desired: float
    mean_actual: float
    largest: float

    @classmethod
    def of(
        cls,
        desired: FloatArray,
        actual: FloatArray,
        rate: float,
        evaluation: Evaluation,
        spectrum: Spectra | None = None,
    ) -> Portrait:
        """Take from two accelerations, already aligned, what is drawn of them."""
        window = liveliest(desired, round(EXCERPT * rate))
        points = some(desired.size, MOST_POINTS)
        return cls(
            rate,
            evaluation,
            spectrum or spectra(desired, actual, rate),
            window.start / rate,
            desired[window].copy(),
            actual[window].copy(),
            desired[points],
            actual[points],
            float(desired.mean()),
            float(actual.mean()),
            extent((desired, actual)),
        )


@dataclasses.dataclass(frozen=True)
class Grid:
    """Portraits in rows of surfaces and columns of controllers; some may be missing."""

    surfaces: tuple[str, ...]
    controllers: tuple[str, ...]
    portraits: Mapping[tuple[str, str], Portrait]

    @classmethod
    def of(cls, portraits: Mapping[tuple[str, str], Portrait]) -> Grid:
        """Sort portraits by surface and controller."""
        return cls(
            surfaces=tuple(dict.fromkeys(surface for surface, _ in portraits)),
            controllers=tuple(dict.fromkeys(controller for _, controller in portraits)),
            portraits=portraits,
        )

    def of_surface(self, surface: str) -> dict[str, Portrait]:
        """Return a surface's portraits by controller."""
        return {c: portrait for (s, c), portrait in self.portraits.items() if s == surface}

    def of_controller(self, controller: str) -> dict[str, Portrait]:
        """Return a controller's portraits by surface."""
        return {s: portrait for (s, c), portrait in self.portraits.items() if c == controller}


def number(value: float | None, decimals: int = 2, unit: str = "") -> str:
    """Return a number for a reader, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    rounded = round(value, decimals) + 0.0  # no minus before a zero
    return f"{rounded:.{decimals}f}{unit}".replace("-", "\N{MINUS SIGN}")


def percent(value: float | None) -> str:
    """Return a number of percent for a reader."""
    return number(value, 1, " %")


def time_traces(grid: Grid, look: Look = PAGE) -> Figure:
    """Draw the paper's Fig. 9: desired and actual acceleration where desired is liveliest."""
    title = "Handle acceleration over time"
    figure, axes = _panels(title, _traces(look), grid.surfaces, grid.controllers, (3.5, 1.9), look)
    for surface, row in zip(grid.surfaces, axes, strict=True):
        drawn = grid.of_surface(surface).values()
        reach = 1.05 * extent(s for portrait in drawn for s in (portrait.desired, portrait.actual))
        for controller, panel in zip(grid.controllers, row, strict=True):
            panel.set_xlim(0, 1e3 * EXCERPT)
            panel.xaxis.set_major_locator(MultipleLocator((250 if look.title else 500) * EXCERPT))
            panel.set_ylim(-reach, reach)
            portrait = grid.portraits.get((surface, controller))
            if portrait is None:
                _not_run(panel, look)
                continue
            milliseconds = 1e3 * np.arange(portrait.desired.size) / portrait.rate
            panel.plot(milliseconds, portrait.desired, **_scaled(_DESIRED, look))
            panel.plot(milliseconds, portrait.actual, **_scaled(_ACTUAL, look))
            error = percent(portrait.evaluation.nrmse_percent)
            _subtitle(panel, f"NRMSE {error}, from {portrait.begin:.2f} s", look)
    _dress(axes, "time in the excerpt (ms)", "acceleration (m/s²)", look)
    return figure


def regressions(grid: Grid, look: Look = PAGE) -> Figure:
    """Draw the paper's Fig. 10: desired against actual acceleration with the regression line."""
    legend = [
        Line2D([], [], **_SAMPLES, markersize=4, label="samples"),
        Line2D([], [], **_scaled(_REGRESSION, look), label="regression of desired on actual"),
        Line2D([], [], **_scaled(_EQUAL, look), label="1:1"),
    ]
    figure, axes = _panels(
        "Desired against actual handle acceleration",
        legend,
        grid.surfaces,
        grid.controllers,
        (3.0, 3.0),
        look,
        more_down=0.2,
    )
    for surface, row in zip(grid.surfaces, axes, strict=True):
        drawn = grid.of_surface(surface).values()
        reach = 1.05 * max((portrait.largest for portrait in drawn), default=1.0)
        for controller, panel in zip(grid.controllers, row, strict=True):
            panel.set_xlim(-reach, reach)
            panel.set_ylim(-reach, reach)
            panel.xaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10)))
            panel.yaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10)))
            portrait = grid.portraits.get((surface, controller))
            if portrait is None:
                _not_run(panel, look)
            else:
                _regression(panel, portrait, reach, look)
    _dress(axes, "actual (m/s²)", "desired (m/s²)", look, one_x=False)
    return figure


def _regression(panel: Axes, portrait: Portrait, reach: float, look: Look) -> None:
    """Draw one panel of `regressions`."""
    panel.plot(
        portrait.cloud_actual,
        portrait.cloud_desired,
        **_SAMPLES,
        markersize=2 * look.lines,
        alpha=0.45,
        # As a picture within the page: thousands of points make a drawing slow to show.
        rasterized=True,
    )
    panel.plot([-reach, reach], [-reach, reach], **_scaled(_EQUAL, look))
    slope = portrait.evaluation.slope_desired_on_actual
    middle = (portrait.mean_actual, portrait.mean_desired)
    panel.axline(middle, slope=slope, **_scaled(_REGRESSION, look))
    _subtitle(panel, f"slope {number(slope)}, R² {number(portrait.evaluation.r2)}", look)


def amplitude_spectra(grid: Grid, look: Look = PAGE) -> Figure:
    """Draw the paper's Fig. 11: amplitude spectra of desired and actual acceleration."""
    figure, axes = _panels(
        "Amplitude spectra of the handle acceleration",
        _traces(look),
        grid.controllers,
        grid.surfaces,
        (3.5, 2.2),
        look,
        less_above=0.14,
    )
    drawn = [
        amplitude[portrait.spectra.frequency >= LOWEST_FREQUENCY]
        for portrait in grid.portraits.values()
        for amplitude in (portrait.spectra.desired, portrait.spectra.actual)
    ]
    top = 2.0 * extent(drawn)
    bottom = min((a[a > 0].min() for a in drawn if np.any(a > 0)), default=top)
    bottom = max(float(bottom), top * 10.0**-_DECADES)
    highest = max(portrait.rate for portrait in grid.portraits.values()) / 2
    for controller, row in zip(grid.controllers, axes, strict=True):
        for surface, panel in zip(grid.surfaces, row, strict=True):
            _frequency_axis(panel, highest, look)
            panel.set_yscale("log")
            panel.set_ylim(bottom, top)
            panel.yaxis.set_minor_locator(NullLocator())
            portrait = grid.portraits.get((surface, controller))
            if portrait is None:
                _not_run(panel, look)
                continue
            spectrum = portrait.spectra
            panel.plot(spectrum.frequency, spectrum.desired, **_scaled(_DESIRED, look))
            panel.plot(spectrum.frequency, spectrum.actual, **_scaled(_ACTUAL, look))
    _dress(axes, "frequency (Hz)", "amplitude (m/s²/√Hz)", look)
    return figure


@dataclasses.dataclass(frozen=True)
class Bar:
    """A figure with the ends of its interval, NaN where there is none."""

    value: float
    low: float
    high: float


def band_errors(errors: Mapping[str, Mapping[str, Bar]], look: Look = PAPER) -> Figure:
    """Draw the error within bands of frequency, a group of bars to each band.

    Parameters
    ----------
    errors : mapping
        NRMSE in percent by what is compared, controllers for one, and by band.
    """
    names = list(errors)
    found = list(dict.fromkeys(band for by_band in errors.values() for band in by_band))
    figure, panel = _column(look, 2.1)
    width = 0.8 / max(len(names), 1)
    for i, name in enumerate(names):
        bars = [errors[name].get(band, Bar(math.nan, math.nan, math.nan)) for band in found]
        middle = np.arange(len(found)) + (i - (len(names) - 1) / 2) * width
        values = np.array([bar.value for bar in bars])
        reach = np.array([[bar.value - bar.low, bar.high - bar.value] for bar in bars]).T
        panel.bar(
            middle,
            values,
            width,
            yerr=np.nan_to_num(np.maximum(reach, 0.0)) if len(found) else None,
            label=_short(name, 24),
            color=BARS[i % len(BARS)][0],
            hatch=BARS[i % len(BARS)][1],
            edgecolor="white",
            linewidth=0.4,
            error_kw={"elinewidth": 0.6, "capsize": 1.2},
        )
    panel.axhline(100.0, **_scaled(_EQUAL, look))
    words = [band.removesuffix(" Hz").replace("-", DASH) for band in found]
    panel.set_xticks(np.arange(len(found)), words)
    panel.set_xlabel("band (Hz)", fontsize=look.label)
    panel.set_ylabel("NRMSE (%)", fontsize=look.label)
    _finish(panel, look, grid="y", legend=len(names))
    return figure


def latencies(counts: Mapping[str, FloatArray], edges: FloatArray, look: Look = PAPER) -> Figure:
    """Draw how many forces reached the bag how long after the sample that caused them.

    Parameters
    ----------
    counts : mapping of str to ndarray, shape (n,)
        By what is compared.
    edges : ndarray, shape (n + 1,)
        Of the bins, s.
    """
    figure, panel = _column(look, 1.9)
    inner = [np.flatnonzero(count) for count in counts.values() if np.any(count)]
    low = min((int(places[0]) for places in inner), default=0)
    high = max((int(places[-1]) + 1 for places in inner), default=len(edges) - 1)
    for i, (name, count) in enumerate(counts.items()):
        share = 100.0 * np.asarray(count) / max(float(np.sum(count)), 1.0)
        panel.stairs(
            share,
            1e3 * edges,
            label=_short(name, 24),
            color=BARS[i % len(BARS)][0],
            linestyle=DASHES[i % len(DASHES)],
            linewidth=1.6 * look.lines,
        )
    panel.set_xscale("log")
    panel.set_xlim(1e3 * float(edges[low]), 1e3 * float(edges[high]))
    panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.set_ylim(bottom=0)
    panel.set_xlabel("from sample to recorded force (ms)", fontsize=look.label)
    panel.set_ylabel("share of forces (%)", fontsize=look.label)
    _finish(panel, look, grid="both", legend=len(counts))
    return figure


BARS = (
    ("#0072b2", ""),
    ("#e69f00", "////"),
    ("#009e73", "...."),
    ("#cc79a7", "\\\\\\\\"),
    ("#56b4e9", "xxxx"),
    ("#444444", "--"),
)
"""Colours of Okabe and Ito, each with a hatch that tells it apart without colour."""

DASHES = ("-", "--", "-.", ":")
"""Of lines that are told apart without colour."""


def _column(look: Look, height: float) -> tuple[Figure, Axes]:
    """Lay out one panel as wide as a column."""
    figure = Figure(figsize=(COLUMN, height), facecolor="white")
    left, bottom, right, top = 0.5, 0.42, 0.06, 0.28
    box = (
        left / COLUMN,
        bottom / height,
        (COLUMN - left - right) / COLUMN,
        (height - bottom - top) / height,
    )
    return figure, figure.add_axes(box)


def _finish(panel: Axes, look: Look, grid: Literal["both", "y"], legend: int) -> None:
    panel.set_axisbelow(True)
    panel.grid(axis=grid, color="#dddddd", linewidth=0.6 * look.lines)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(labelsize=look.tick, color="#888888")
    panel.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=max(min(legend, 4), 1),
        frameon=False,
        fontsize=look.tick,
        borderaxespad=0,
        borderpad=0.2,
        handlelength=1.6,
        columnspacing=1.0,
    )


def _panels(
    title: str,
    legend: Sequence[Line2D],
    rows: Sequence[str],
    columns: Sequence[str],
    size: tuple[float, float],
    look: Look,
    more_down: float = 0.0,
    less_above: float = 0.0,
) -> tuple[Figure, list[list[Axes]]]:
    """Lay out a figure of axes of one size under a title, a legend and the columns' names.

    `size` is that of an axes in inches, or gives its shape where the look has a width. So are what
    is added to the gap between rows, and taken from the height of the columns' names above the
    axes. It is laid out by hand because matplotlib's layout engines draw everything twice.
    """
    above, down = _ABOVE * look.heading / PAGE.heading - less_above * look.lines, look.down
    down += more_down * (1.0 if look.title else 0.6)
    left, right, top, bottom, across = (
        look.left,
        look.right,
        look.top + above,
        look.bottom,
        look.across,
    )
    if look.width:
        wide = (look.width - left - right + across) / len(columns) - across
        size = (wide, wide * size[1] / size[0])
        width = look.width
    else:
        width = max(left + len(columns) * (size[0] + across) - across + right, 7.2)
    height = top + len(rows) * (size[1] + down) - down + bottom
    figure = Figure(figsize=(width, height), facecolor="white")

    def heading(x: float, y: float, words: str, room: float, rotation: str) -> None:
        figure.text(
            x / width,
            y / height,
            _short(words, int(room / (CHARACTER * look.heading))),
            size=look.heading,
            weight="bold",
            ha="center",
            va="center",
            rotation=rotation,
            parse_math=False,
        )

    if look.title:
        figure.text(
            left / width, 1 - 0.15 / height, title, size=look.title, weight="bold", va="top"
        )
    figure.legend(
        handles=legend,
        loc="upper left",
        bbox_to_anchor=(left / width, 1 - (0.48 if look.title else 0.05) / height),
        ncols=len(legend),
        frameon=False,
        fontsize=look.label,
        borderaxespad=0,
        borderpad=0,
        handlelength=1.8,
    )
    axes = []
    for i, row in enumerate(rows):
        y = height - top - size[1] - i * (size[1] + down)
        heading(0.2 * look.heading / PAGE.heading, y + size[1] / 2, row, size[1], "vertical")
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


_ABOVE = 0.34  # from the axes to the middle of the columns' names on a page, inches


def _dress(axes: Sequence[Sequence[Axes]], x: str, y: str, look: Look, one_x: bool = True) -> None:
    """Rule all axes; name and number those at the left and at the bottom.

    Where the rows have not `one_x` scale for all, x is numbered in each.
    """
    for i, row in enumerate(axes):
        for j, panel in enumerate(row):
            panel.set_axisbelow(True)
            panel.grid(color="#dddddd", linewidth=0.6 * look.lines)
            panel.spines[["top", "right"]].set_visible(False)
            lowest = i == len(axes) - 1
            panel.tick_params(labelsize=look.tick, color="#888888")
            panel.tick_params(labelleft=j == 0, labelbottom=lowest or not one_x)
            # In a paper rows are lower than the words are long: they stand once, in the middle.
            if j == 0 and (look.title or i == len(axes) // 2):
                panel.set_ylabel(y, fontsize=look.label)
            if lowest:
                panel.set_xlabel(x, fontsize=look.label)


def _frequency_axis(panel: Axes, highest: float, look: Look) -> None:
    panel.set_xscale("log")
    panel.set_xlim(LOWEST_FREQUENCY, highest)
    ticks = [tick for tick in (_TICKS if look.title else _FEW_TICKS) if tick <= highest]
    panel.xaxis.set_major_locator(FixedLocator(ticks))
    panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.xaxis.set_minor_locator(NullLocator())


def _scaled(style: _Style, look: Look) -> _Style:
    """Return a line's style with the look's width."""
    return {**style, "linewidth": style["linewidth"] * look.lines}


def _traces(look: Look) -> list[Line2D]:
    return [
        Line2D([], [], **_scaled(_DESIRED, look), label="desired"),
        Line2D([], [], **_scaled(_ACTUAL, look), label="actual, shifted back"),
    ]


def extent(signals: Iterable[FloatArray]) -> float:
    """Return the largest magnitude in some signals, or 1 if all are zero."""
    return max((float(np.abs(signal).max()) for signal in signals), default=0.0) or 1.0


def _subtitle(panel: Axes, words: str, look: Look) -> None:
    panel.set_title(words, fontsize=look.tick, pad=4 if look.title else 2.5)


def _not_run(panel: Axes, look: Look) -> None:
    panel.text(
        0.5,
        0.5,
        "not run",
        transform=panel.transAxes,
        ha="center",
        color="#666666",
        fontsize=look.label,
    )


def _short(name: str, longest: int) -> str:
    """Return a name on one line, cut to so many characters."""
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    return name if len(name) <= longest else name[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"

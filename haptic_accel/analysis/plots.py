"""Palette, axes and plots of every report: the paper's Figs. 9 to 11, errors by band, latencies.

The rest of the package names no colour and draws nothing without this module. What is drawn of a
trial is kept as a `Portrait`, a few thousand numbers, so that a long recording need not stay in
memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypedDict

import matplotlib as mpl
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

from haptic_accel.analysis.traces import most_active, sampled
from haptic_accel.core.evaluation.metrics import Evaluation, Spectra
from haptic_accel.core.evaluation.statistics import Interval
from haptic_accel.core.model import FloatArray

EXCERPT = 0.2
"""Length of the time traces, s: some strokes of texture, yet every swing can be seen."""

LOWEST_FREQUENCY = 10.0
"""Lower end of the spectra, Hz: below it the 15 Hz high-pass leaves little."""

MOST_POINTS = 4000
"""Maximum number of points of a scatter plot; more are drawn over each other."""

DASH = "\N{EN DASH}"
"""Placeholder for a number that is undefined."""

DPI = 300
"""Resolution of PNG plots, pixels per inch: what printers of papers ask for."""

COLUMN, TEXT = 3.5, 7.16
"""Width of a column and of the text of an IEEE paper, inches."""

BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, GREY = (
    "#0072b2",
    "#e69f00",
    "#009e73",
    "#d55e00",
    "#cc79a7",
    "#56b4e9",
    "#444444",
)
"""Palette of Okabe and Ito: distinct in every common colour vision, and in print."""

BARS = (
    (BLUE, ""),
    (ORANGE, "////"),
    (GREEN, "...."),
    (PURPLE, "\\\\\\\\"),
    (SKY, "xxxx"),
    (GREY, "--"),
)
"""Colours of bars, each with a hatch that tells it apart without colour."""

GRIPS = (
    ("#c3c8cd", "#4d545b"),
    ("#f3cf85", "#a87400"),
    ("#a6d9f7", "#1f7fb4"),
    ("#e9c3d8", "#99447a"),
)
"""Pale and dark colour of the measurements of each grip."""

SHADE, LINE, BLACK = "#e4e7ea", "#999999", "#000000"
"""Colours of an area that is left out, of its bounds, and of models that hide no data."""

DASHES: tuple[Dashes, ...] = ("-", "--", "-.", ":")
"""Dashes of lines that are told apart without colour."""

Dashes = Literal["-", "--", "-.", ":", ""] | tuple[float, tuple[float, ...]]


class Style(TypedDict, total=False):
    """Look of a line, in matplotlib's words."""

    color: str
    linewidth: float
    linestyle: Dashes
    marker: str
    markersize: float
    markeredgewidth: float
    markerfacecolor: str
    zorder: float


# Desired is the broader line, so that it is seen where actual lies on it.
_DESIRED: Style = {"color": BLUE, "linewidth": 1.2}
_ACTUAL: Style = {"color": ORANGE, "linewidth": 0.66}
_REGRESSION: Style = {"color": VERMILION, "linewidth": 1.2}
_EQUAL: Style = {"color": "black", "linewidth": 0.6, "linestyle": "--"}
_SAMPLES: Style = {"color": BLUE, "marker": "o", "linestyle": "", "markersize": 1.2}
_SAMPLES["markeredgewidth"] = 0
_TRACES = (
    Line2D([], [], **_DESIRED, label="desired"),
    Line2D([], [], **_ACTUAL, label="actual, shifted back"),
)

_LABEL, _TICK = 8, 7  # sizes of text, points
_CHARACTER = 0.115 / 12  # width of a bold letter per point of its size, inches
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.7, 0.11, 0.47, 0.36  # margins of a figure of panels, inches
_ACROSS, _DOWN = 0.2, 0.24  # gaps between panels, inches
_HEADING = 0.23  # from the panels to the middle of the columns' names, inches
_DECADES = 4.5  # largest range of a spectrum's axis
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)  # Hz
_FEW_TICKS = (10, 30, 100, 300, 1000)  # Hz, where there is little room
_EMBEDDED: dict[Any, Any] = {
    # Text of PDF plots as TrueType: publishers refuse matplotlib's own Type 3.
    "pdf.fonttype": 42,
    "font.family": "sans-serif",
    "svg.fonttype": "none",
}


@dataclass(frozen=True)
class Portrait:
    """Parts of a trial that plots show, after the shift.

    Attributes
    ----------
    rate : float
        Samples per second.
    evaluation : Evaluation
    spectra : Spectra
    begin : float
        Start of the excerpt, s.
    desired, actual : ndarray
        The excerpt, where desired has its largest RMS, m/s^2.
    cloud_desired, cloud_actual : ndarray
        Samples drawn from the whole trial, m/s^2.
    mean_desired, mean_actual : float
        m/s^2.
    largest : float
        Largest magnitude in either signal, m/s^2.
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
        spectra: Spectra,
    ) -> Portrait:
        """Take from two accelerations, already aligned, what is drawn of them."""
        window = most_active(desired, round(EXCERPT * rate))
        points = sampled(desired.size, MOST_POINTS)
        return cls(
            rate,
            evaluation,
            spectra,
            window.start / rate,
            desired[window].copy(),
            actual[window].copy(),
            desired[points],
            actual[points],
            float(desired.mean()),
            float(actual.mean()),
            _extent((desired, actual)),
        )


Portraits = Mapping[tuple[str, str], Portrait]
"""Portraits by controller and surface; some combinations may be missing."""


# Numbers and names


def number(value: float | None, decimals: int = 2, unit: str = "") -> str:
    """Return a number for a reader, a dash if it is undefined."""
    if value is None or not math.isfinite(value):
        return DASH
    rounded = round(value, decimals) + 0.0  # no minus before a zero
    return f"{rounded:.{decimals}f}{unit}".replace("-", "\N{MINUS SIGN}")


def percent(value: float | None) -> str:
    """Return a percentage for a reader."""
    return number(value, 1, " %")


def short(name: str, longest: int = 24) -> str:
    """Return a name on one line, cut to so many characters."""
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    return name if len(name) <= longest else name[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"


# The paper's figures


def time_traces(portraits: Portraits) -> Figure:
    """Draw the paper's Fig. 9: desired and actual acceleration where desired is most active."""
    controllers, surfaces = _names(portraits)
    figure, axes = _panels(_TRACES, surfaces, controllers, 1.9 / 3.5)
    for surface, row in zip(surfaces, axes, strict=True):
        drawn = [portrait for (_, s), portrait in portraits.items() if s == surface]
        reach = 1.05 * _extent(
            s for portrait in drawn for s in (portrait.desired, portrait.actual)
        )
        for portrait, panel in _filled(portraits, [(c, surface) for c in controllers], row):
            milliseconds = 1e3 * np.arange(portrait.desired.size) / portrait.rate
            panel.plot(milliseconds, portrait.desired, **_DESIRED)
            panel.plot(milliseconds, portrait.actual, **_ACTUAL)
            error = percent(portrait.evaluation.nrmse_percent)
            _subtitle(panel, f"NRMSE {error}, from {portrait.begin:.2f} s")
        for panel in row:
            panel.set_xlim(0, 1e3 * EXCERPT)
            panel.xaxis.set_major_locator(MultipleLocator(500 * EXCERPT))
            panel.set_ylim(-reach, reach)
    _label(axes, "time in the excerpt (ms)", "acceleration (m/s²)")
    return figure


def regressions(portraits: Portraits) -> Figure:
    """Draw the paper's Fig. 10: desired against actual acceleration with the regression line."""
    controllers, surfaces = _names(portraits)
    samples = Line2D([], [], **_SAMPLES, label="samples")
    samples.set_markersize(4)
    legend = (
        samples,
        Line2D([], [], **_REGRESSION, label="regression of desired on actual"),
        Line2D([], [], **_EQUAL, label="1:1"),
    )
    figure, axes = _panels(legend, surfaces, controllers, 1.0, more_down=0.12)
    for surface, row in zip(surfaces, axes, strict=True):
        reach = 1.05 * max(p.largest for (_, s), p in portraits.items() if s == surface)
        for portrait, panel in _filled(portraits, [(c, surface) for c in controllers], row):
            panel.plot(
                portrait.cloud_actual,
                portrait.cloud_desired,
                **_SAMPLES,
                alpha=0.45,
                # As a picture within the page: thousands of points make a drawing slow to show.
                rasterized=True,
            )
            panel.plot([-reach, reach], [-reach, reach], **_EQUAL)
            found = portrait.evaluation
            middle = (portrait.mean_actual, portrait.mean_desired)
            panel.axline(middle, slope=found.slope_desired_on_actual, **_REGRESSION)
            _subtitle(
                panel, f"slope {number(found.slope_desired_on_actual)}, R² {number(found.r2)}"
            )
        for panel in row:
            panel.set_xlim(-reach, reach)
            panel.set_ylim(-reach, reach)
            panel.xaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10)))
            panel.yaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10)))
    _label(axes, "actual (m/s²)", "desired (m/s²)", one_x=False)
    return figure


def amplitude_spectra(portraits: Portraits) -> Figure:
    """Draw the paper's Fig. 11: amplitude spectra of desired and actual acceleration."""
    controllers, surfaces = _names(portraits)
    figure, axes = _panels(_TRACES, controllers, surfaces, 2.2 / 3.5, less_above=0.084)
    drawn = [
        amplitude[portrait.spectra.frequency >= LOWEST_FREQUENCY]
        for portrait in portraits.values()
        for amplitude in (portrait.spectra.desired, portrait.spectra.actual)
    ]
    top = 2.0 * _extent(drawn)
    bottom = min((a[a > 0].min() for a in drawn if np.any(a > 0)), default=top)
    bottom = max(float(bottom), top * 10.0**-_DECADES)
    highest = max(portrait.rate for portrait in portraits.values()) / 2
    for controller, row in zip(controllers, axes, strict=True):
        for panel in row:
            frequency_axis(panel, LOWEST_FREQUENCY, highest, _FEW_TICKS)
            panel.set_yscale("log")
            panel.set_ylim(bottom, top)
            panel.yaxis.set_minor_locator(NullLocator())
        for portrait, panel in _filled(portraits, [(controller, s) for s in surfaces], row):
            spectrum = portrait.spectra
            panel.plot(spectrum.frequency, spectrum.desired, **_DESIRED)
            panel.plot(spectrum.frequency, spectrum.actual, **_ACTUAL)
    _label(axes, "frequency (Hz)", "amplitude (m/s²/√Hz)")
    return figure


# Plots of one column


def band_errors(errors: Mapping[str, Mapping[str, Interval]]) -> Figure:
    """Draw the error within bands of frequency, a group of bars to each band.

    Parameters
    ----------
    errors : mapping
        NRMSE in percent by controller and by band.
    """
    names = list(errors)
    found = list(dict.fromkeys(band for by_band in errors.values() for band in by_band))
    figure, panel = _column(2.1)
    width = 0.8 / max(len(names), 1)
    unknown = Interval(math.nan, math.nan, math.nan, 0, "")
    for i, name in enumerate(names):
        bars = [errors[name].get(band, unknown) for band in found]
        reach = np.array([[bar.value - bar.low, bar.high - bar.value] for bar in bars]).T
        panel.bar(
            np.arange(len(found)) + (i - (len(names) - 1) / 2) * width,
            [bar.value for bar in bars],
            width,
            yerr=np.nan_to_num(np.maximum(reach, 0.0)) if len(found) else None,
            label=short(name),
            color=BARS[i % len(BARS)][0],
            hatch=BARS[i % len(BARS)][1],
            edgecolor="white",
            linewidth=0.4,
            error_kw={"elinewidth": 0.6, "capsize": 1.2},
        )
    panel.axhline(100.0, **_EQUAL)
    words = [band.removesuffix(" Hz").replace("-", DASH) for band in found]
    panel.set_xticks(np.arange(len(found)), words)
    panel.set_xlabel("band (Hz)", fontsize=_LABEL)
    panel.set_ylabel("NRMSE (%)", fontsize=_LABEL)
    _finish(panel, "y", len(names))
    return figure


def latencies(counts: Mapping[str, FloatArray], edges: FloatArray) -> Figure:
    """Draw the time from a sample to the recording of its force, as a histogram.

    Parameters
    ----------
    counts : mapping of str to ndarray, shape (n,)
        Number of forces in each bin, by controller.
    edges : ndarray, shape (n + 1,)
        Edges of the bins, s.
    """
    figure, panel = _column(1.9)
    inner = [np.flatnonzero(count) for count in counts.values() if np.any(count)]
    low = min((int(places[0]) for places in inner), default=0)
    high = max((int(places[-1]) + 1 for places in inner), default=len(edges) - 1)
    for i, (name, count) in enumerate(counts.items()):
        panel.stairs(
            100.0 * np.asarray(count) / max(float(np.sum(count)), 1.0),
            1e3 * edges,
            label=short(name),
            color=BARS[i % len(BARS)][0],
            linestyle=DASHES[i % len(DASHES)],
            linewidth=0.96,
        )
    panel.set_xscale("log")
    panel.set_xlim(1e3 * float(edges[low]), 1e3 * float(edges[high]))
    panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.set_ylim(bottom=0)
    panel.set_xlabel("from sample to recorded force (ms)", fontsize=_LABEL)
    panel.set_ylabel("share of forces (%)", fontsize=_LABEL)
    _finish(panel, "both", len(counts))
    return figure


def save(plots: Mapping[str, Figure], folder: Path) -> Iterator[str]:
    """Write plots by name as PNG and PDF; yield the names of the files."""
    with mpl.rc_context(_EMBEDDED):
        for name, figure in plots.items():
            for suffix in ("png", "pdf"):
                figure.savefig(folder / f"{name}.{suffix}", dpi=DPI)
                yield f"{name}.{suffix}"


# Axes


def frequency_axis(
    panel: Axes, low: float, high: float, ticks: Sequence[float] = _TICKS, ends: bool = False
) -> None:
    """Make x a logarithmic frequency axis, Hz, with ticks at its `ends` too if asked for."""
    panel.set_xscale("log")
    if ends:
        # Marks at the ends are seen whole, and no other tick is written over theirs.
        panel.set_xlim(low / 1.03, high * 1.03)
        ticks = [low, *(tick for tick in ticks if low * 1.2 < tick < high / 1.2), high]
    else:
        panel.set_xlim(low, high)
        ticks = [tick for tick in ticks if tick <= high]
    panel.xaxis.set_major_locator(FixedLocator(ticks))
    panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.xaxis.set_minor_locator(NullLocator())


def rule(panel: Axes, grid: Literal["both", "y"] = "both", width: float = 0.6) -> None:
    """Rule a panel: a pale grid behind the data, no frame at the top and right."""
    panel.set_axisbelow(True)
    panel.grid(axis=grid, color="#dddddd", linewidth=width)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(color="#888888")


def _column(height: float) -> tuple[Figure, Axes]:
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


def _finish(panel: Axes, grid: Literal["both", "y"], entries: int) -> None:
    rule(panel, grid, 0.36)
    panel.tick_params(labelsize=_TICK)
    panel.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=max(min(entries, 4), 1),
        frameon=False,
        fontsize=_TICK,
        borderaxespad=0,
        borderpad=0.2,
        handlelength=1.6,
        columnspacing=1.0,
    )


def _names(portraits: Portraits) -> tuple[list[str], list[str]]:
    """Return controllers and surfaces, in the order of the portraits."""
    return list(dict.fromkeys(c for c, _ in portraits)), list(
        dict.fromkeys(s for _, s in portraits)
    )


def _filled(
    portraits: Portraits, keys: Sequence[tuple[str, str]], row: Sequence[Axes]
) -> Iterator[tuple[Portrait, Axes]]:
    """Yield the portraits of a row of panels; say in the other panels that there is none."""
    for key, panel in zip(keys, row, strict=True):
        if key in portraits:
            yield portraits[key], panel
        else:
            panel.text(
                0.5,
                0.5,
                "not run",
                transform=panel.transAxes,
                ha="center",
                color="#666666",
                fontsize=_LABEL,
            )


def _panels(
    legend: Sequence[Line2D],
    rows: Sequence[str],
    columns: Sequence[str],
    shape: float,
    more_down: float = 0.0,
    less_above: float = 0.0,
) -> tuple[Figure, list[list[Axes]]]:
    """Lay out panels as wide as the text of a paper, under a legend and the columns' names.

    `shape` is height over width of a panel; `more_down` is added to the gap between rows and
    `less_above` taken from the height of the columns' names, inches. It is laid out by hand
    because matplotlib's layout engines draw everything twice.
    """
    above, down = _HEADING - less_above, _DOWN + more_down
    top = _TOP - less_above
    wide = (TEXT - _LEFT - _RIGHT + _ACROSS) / len(columns) - _ACROSS
    high = wide * shape
    height = top + len(rows) * (high + down) - down + _BOTTOM
    figure = Figure(figsize=(TEXT, height), facecolor="white")

    def heading(x: float, y: float, words: str, room: float, rotation: str) -> None:
        figure.text(
            x / TEXT,
            y / height,
            short(words, int(room / (_CHARACTER * _LABEL))),
            size=_LABEL,
            weight="bold",
            ha="center",
            va="center",
            rotation=rotation,
            parse_math=False,
        )

    figure.legend(
        handles=legend,
        loc="upper left",
        bbox_to_anchor=(_LEFT / TEXT, 1 - 0.05 / height),
        ncols=len(legend),
        frameon=False,
        fontsize=_LABEL,
        borderaxespad=0,
        borderpad=0,
        handlelength=1.8,
    )
    axes = []
    for i, row in enumerate(rows):
        y = height - top - high - i * (high + down)
        heading(0.13, y + high / 2, row, high, "vertical")
        axes.append(
            [
                figure.add_axes((x / TEXT, y / height, wide / TEXT, high / height))
                for x in (_LEFT + j * (wide + _ACROSS) for j in range(len(columns)))
            ]
        )
    for j, column in enumerate(columns):
        middle = _LEFT + j * (wide + _ACROSS) + wide / 2
        heading(middle, height - top + above, column, wide, "horizontal")
    return figure, axes


def _label(axes: Sequence[Sequence[Axes]], x: str, y: str, one_x: bool = True) -> None:
    """Rule all axes; name and number those at the left and at the bottom.

    Unless the rows have `one_x` scale in common, x is numbered in each.
    """
    for i, row in enumerate(axes):
        for j, panel in enumerate(row):
            rule(panel, width=0.36)
            lowest = i == len(axes) - 1
            panel.tick_params(labelsize=_TICK, labelleft=j == 0, labelbottom=lowest or not one_x)
            # Rows are lower than the words are long: they stand once, in the middle.
            if j == 0 and i == len(axes) // 2:
                panel.set_ylabel(y, fontsize=_LABEL)
            if lowest:
                panel.set_xlabel(x, fontsize=_LABEL)


def _extent(signals: Iterable[FloatArray]) -> float:
    """Return the largest magnitude in some signals, or 1 if all are zero."""
    return max((float(np.abs(signal).max()) for signal in signals), default=0.0) or 1.0


def _subtitle(panel: Axes, words: str) -> None:
    panel.set_title(words, fontsize=_TICK, pad=2.5)

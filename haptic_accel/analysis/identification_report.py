"""Write the report of an identification: a page, the paper's figures 4 and 5, the coherence."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FixedLocator,
    LogLocator,
    MaxNLocator,
    NullLocator,
    StrMethodFormatter,
)

from haptic_accel.analysis.plots import DASH
from haptic_accel.core.identification import (
    UNEXPLAINED,
    DiscreteModel,
    FrequencyResponse,
    GripIdentification,
    HandleFit,
    Identification,
    IdentificationTrial,
    SweepParameters,
)
from haptic_accel.core.identification.sweep import DROPPED_REPEATS, repeat_samples
from haptic_accel.core.model import (
    ApproximateModel,
    ComplexArray,
    FloatArray,
    HandleParameters,
    MountParameters,
    handle_model,
)
from haptic_accel.core.parameters import own_schema
from haptic_accel.pages import template

PARAMETER_FILE = "handle.yaml"
"""Name of the parameter file that the page tells of."""

POOLED = "all grips"
"""Heading of what was fitted to all trials of several grips."""

KNOWN = "known"
"""What stands for the standard error of a parameter that was not fitted."""

MASS_LIKE = 60.0
"""Between suspension and mount, where handles are little more than their mass, Hz."""

POINTS = 400
"""Frequencies at which models are drawn."""

DEGREES = 180 / math.pi
"""In a radian."""

MICROSECONDS = 1e6
"""In a second."""


@dataclass(frozen=True)
class ModelError:
    """Largest differences of a model's response from the true one over a band.

    Attributes
    ----------
    magnitude_db : float
        Of the magnitude, either way, dB.
    phase_deg : float
        Of the phase, either way, degrees.
    """

    magnitude_db: float
    phase_deg: float


class _Style(TypedDict, total=False):
    """How a line is drawn, in matplotlib's words."""

    color: str
    linewidth: float
    linestyle: Literal["-", "--", "-.", ":", ""] | tuple[float, tuple[float, ...]]
    marker: str
    markersize: float
    markeredgewidth: float
    markerfacecolor: str
    zorder: float


# Mostly of the palette of Okabe and Ito: apart in every common colour vision. Lines that lie on
# each other differ in width and dashes too.
_BLUE, _VERMILION, _GREEN, _PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
_FULL: _Style = {"color": _BLUE, "linewidth": 2.2, "zorder": 4}
_DISCRETE: _Style = {"color": "black", "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 5}
_EQUATION: _Style = {
    "color": _GREEN,
    "linewidth": 1.8,
    "linestyle": (0, (7, 2, 1.5, 2)),
    "zorder": 3,
}
_APPROXIMATE: _Style = {
    "color": _VERMILION,
    "linewidth": 2.2,
    "linestyle": (0, (1.2, 1.2)),
    "zorder": 3.5,
}
_MASS: _Style = {"color": _PURPLE, "linewidth": 1.8, "linestyle": (0, (10, 4)), "zorder": 2.5}


@dataclass(frozen=True)
class _Look:
    """How what was measured of a grip is drawn: each trial pale, averages dark."""

    pale: str
    dark: str
    dashes: Literal["-", "--", "-.", ":"]

    @property
    def ratio(self) -> _Style:
        return {"color": self.pale, "marker": ".", "markersize": 7.0, "linestyle": "", "zorder": 1}

    @property
    def h1(self) -> _Style:
        return self._marks("o")

    @property
    def h2(self) -> _Style:
        return self._marks("x")

    def _marks(self, marker: str) -> _Style:
        return {
            "color": self.dark,
            "marker": marker,
            "markersize": 4.5,
            "markerfacecolor": "none",
            "markeredgewidth": 0.9,
            "linestyle": "",
            "zorder": 2,
        }

    @property
    def ratio_line(self) -> _Style:
        return {"color": self.pale, "linewidth": 1.2, "zorder": 1}

    @property
    def h1_line(self) -> _Style:
        return {"color": self.dark, "linewidth": 1.6, "linestyle": self.dashes, "zorder": 2}


_LOOKS = (
    _Look("#c3c8cd", "#4d545b", "-"),
    _Look("#f3cf85", "#a87400", "--"),
    _Look("#a6d9f7", "#1f7fb4", "-."),
    _Look("#e9c3d8", "#99447a", ":"),
)


def _look(index: int) -> _Look:
    return _LOOKS[index % len(_LOOKS)]


_DPI = 130  # pixels per inch
_CSS_DPI = 96  # a page's pixels per inch
_AVERAGED_POINTS = 28  # drawn of an averaged estimate; more would hide the models
_LONGEST_NAME = 24  # characters of a grip's name in a legend
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)  # Hz
_MARGIN_DEGREES = 20.0  # beyond what is drawn
_MARGIN_FACTOR = 1.3  # of magnitude beyond what is drawn
_MOST_DATA = (1.0, 99.0)  # percentiles of the data that axes reach
_TICK_APART = 1.2  # as a factor
_BAND_MARGIN = 1.03  # as a factor; marks at the ends of the band are seen whole
_DIGITS = 5  # that count, of a value whose error is not known
_MOST_DIGITS = 7  # of one whose error is very small
_ERROR_DIGITS = 2  # of a standard error


def write_identification_report(
    found: Identification,
    sweep: SweepParameters,
    folder: Path,
    *,
    settings: Mapping[str, str],
    truth: HandleParameters | None,
    errors: Mapping[str, ModelError],
    band: tuple[float, float],
    notes: Sequence[str] = (),
) -> Path:
    """Write a page with the parameters, models and figures of an identification into a folder.

    Parameters
    ----------
    found : Identification
        What to report.
    sweep : SweepParameters
        What excited the handle.
    folder : Path
        Where to write; made if it does not exist. The page refers to ``handle.yaml`` there.
    settings : mapping of str to str
        What it was run with, shown as a table.
    truth : HandleParameters or None
        Of a simulated handle, where known.
    errors : mapping of str to ModelError
        By model, ``discrete`` and ``physical``; empty where there is no truth.
    band : tuple of float
        Of the errors, Hz.
    notes : sequence of str
        Paragraphs shown under the heading, warnings first.

    Returns
    -------
    Path
        The page, ``folder/index.html``, which needs no other file to be shown. Beside it lie
        its figures ``fig4_sweep.png``, ``fig5_models.png`` and ``coherence.png``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    grip, identified = next(iter(found.grips.items()))
    figures = {
        "fig4_sweep.png": _draw_sweep(identified.trials[0], sweep),
        "fig5_models.png": _draw_models(found),
        "coherence.png": _draw_coherence(found),
    }
    page = template("identification.html.j2").render(
        when=datetime.now().astimezone(),
        settings=settings,
        notes=notes,
        grips=_grip_rows(found.grips),
        first_grip=grip,
        columns=[name for name, _ in _fits(found)],
        parameters=_parameter_rows(found, truth),
        simulated=truth is not None,
        explained=_explained(found),
        mount="mount_frequency" in found.fit.standard_errors,
        approximate=_pair_rows(found.approximate),
        order=_order(found.discrete),
        delay_samples=found.discrete.delay_samples,
        rate=f"{found.discrete.rate:g}",
        errors=_error_rows(errors),
        band=_span(band),
        sweep_band=_span(found.band),
        parameter_file=PARAMETER_FILE,
        pictures={name: _picture(figure, folder / name) for name, figure in figures.items()},
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8", errors="replace")
    return index


# Figures


def _draw_sweep(trial: IdentificationTrial, sweep: SweepParameters) -> Figure:
    """Draw force and acceleration over time, the paper's Fig. 4."""
    figure = Figure(figsize=(10, 5.6), layout="constrained", facecolor="white")
    force, acceleration = figure.subplots(2, 1, sharex=True)
    repeat = repeat_samples(sweep, trial.rate)
    samples = sweep.repeats * repeat
    time = np.arange(samples) / trial.rate
    force.plot(time, trial.actuator_force[:samples], color=_BLUE, linewidth=0.6)
    acceleration.plot(time, trial.handle_acceleration[:samples], color=_VERMILION, linewidth=0.6)
    dropped = DROPPED_REPEATS * repeat / trial.rate
    for panel, label in (
        (force, "actuator force (N)"),
        (acceleration, "handle acceleration (m/s²)"),
    ):
        panel.axvspan(0, dropped, color="#e4e7ea", zorder=0)
        for index in range(DROPPED_REPEATS + 1, sweep.repeats):
            panel.axvline(index * repeat / trial.rate, color="#999999", linewidth=0.8)
        panel.set_ylabel(label)
        panel.set_xlim(0, samples / trial.rate)
        _rule(panel)
    for start, end, words in (
        (0, dropped, "settling, not evaluated"),
        (dropped, samples / trial.rate, "evaluated"),
    ):
        force.annotate(
            words,
            ((start + end) / 2, 1.0),
            xycoords=force.get_xaxis_transform(),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            color="#444444",
        )
    figure.align_ylabels()
    acceleration.set_xlabel("time (s)")
    return figure


def _draw_models(found: Identification) -> Figure:
    """Draw magnitude and phase of data and models, the paper's Fig. 5."""
    figure = Figure(figsize=(11, 8.2), layout="constrained", facecolor="white")
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    frequency = _model_frequencies(found)
    curves = _model_curves(found, frequency)
    reference = _unwrapped(frequency, curves[0].response)
    for curve in curves:
        magnitude.plot(frequency, np.abs(curve.response), **curve.style)
        phase.plot(frequency, _unwrapped(frequency, curve.response), **curve.style)
    for data, style in _data(found.grips.values()):
        near = np.interp(data.frequency, frequency, reference)
        magnitude.plot(data.frequency, np.abs(data.response), **style)
        phase.plot(data.frequency, _nearest_turn(data.response, near), **style)
    _scale_magnitude(magnitude, [curve.response for curve in curves], found)
    _scale_phase(phase, [_unwrapped(frequency, curve.response) for curve in curves])
    magnitude.set_ylabel("acceleration over force (m/s² per N)")
    phase.set_ylabel("phase (degrees)")
    phase.set_xlabel("frequency (Hz)")
    for panel in (magnitude, phase):
        _frequency_axis(panel, found.band)
        _rule(panel)
    _legend(magnitude, [curve.key for curve in curves])
    _legend(phase, list(_data_keys(found.grips)))
    figure.align_ylabels()
    return figure


@dataclass(frozen=True)
class _Curve:
    """A model's complex response, m/s^2 per N, shape (n,), and how it is drawn."""

    label: str
    style: _Style
    response: ComplexArray

    @property
    def key(self) -> Line2D:
        return Line2D([], [], **self.style, label=self.label)


def _model_frequencies(found: Identification) -> FloatArray:
    """Return where models are drawn, Hz: in the sweep's band, below half the rate."""
    low, high = found.band
    return np.asarray(np.geomspace(low, min(high, 0.499 * found.discrete.rate), POINTS))


def _model_curves(found: Identification, frequency: FloatArray) -> list[_Curve]:
    """Return the models at frequencies in Hz; the first follows the data most surely."""
    handle = found.fit.handle
    mass = np.full(len(frequency), 1 / handle.m_h, dtype=np.complex128)
    full = found.fit.response(frequency, found.discrete.rate)
    return [
        _Curve("full model, as sampled", _FULL, full),
        _Curve("discrete model", _DISCRETE, found.discrete.response(frequency)),
        _Curve("eq. (3) alone", _EQUATION, handle_model(handle).response(frequency)),
        _Curve("approximate model", _APPROXIMATE, found.approximate.model().response(frequency)),
        _Curve("mass model", _MASS, mass),
    ]


def _data(grips: Iterable[GripIdentification]) -> Iterator[tuple[FrequencyResponse, _Style]]:
    """Yield the estimates that are drawn, and how."""
    for index, grip in enumerate(grips):
        look = _look(index)
        for response in grip.responses:
            yield response, look.ratio
        yield _thinned(grip.averaged_h1), look.h1
        yield _thinned(grip.averaged_h2), look.h2


def _data_keys(grips: Iterable[str]) -> Iterator[Line2D]:
    for index, name in enumerate(grips):
        look = _look(index)
        yield Line2D([], [], **look.ratio, label=f"{_short(name)}: DFT ratio, each trial")
        yield Line2D([], [], **look.h1, label=f"{_short(name)}: H1, all trials")
        yield Line2D([], [], **look.h2, label=f"{_short(name)}: H2, all trials")


def _thinned(response: FrequencyResponse) -> FrequencyResponse:
    """Return lines evenly spaced on a logarithmic axis, as far as there are such."""
    low, high = response.frequency[0], response.frequency[-1]
    wanted = np.geomspace(low, high, _AVERAGED_POINTS)
    some = np.unique(np.abs(response.frequency - wanted[:, None]).argmin(axis=1))
    return replace(
        response,
        frequency=response.frequency[some],
        response=response.response[some],
        coherence=response.coherence[some],
    )


def _unwrapped(frequency: FloatArray, response: ComplexArray) -> FloatArray:
    """Return a smooth response's phase without jumps, degrees, shape (n,).

    Whole turns say nothing: all models are near zero where the handle is a mass.
    """
    phase = np.unwrap(np.angle(response)) * DEGREES
    middle = min(int(np.searchsorted(frequency, MASS_LIKE)), len(phase) - 1)
    return np.asarray(phase - 360 * np.round(phase[middle] / 360))


def _nearest_turn(response: ComplexArray, near: FloatArray) -> FloatArray:
    """Return a noisy response's phase within half a turn of another one, degrees, shape (n,)."""
    phase = np.angle(response) * DEGREES
    return np.asarray(phase - 360 * np.round((phase - near) / 360))


def _scale_magnitude(panel: Axes, models: Sequence[ComplexArray], found: Identification) -> None:
    """Scale an axis to models and data but for outliers, which would make all else small."""
    data = [response.response for grip in found.grips.values() for response in grip.responses]
    low, high = np.percentile(np.abs(np.concatenate(data)), _MOST_DATA)
    drawn = np.abs(np.concatenate(models))
    panel.set_yscale("log")
    panel.set_ylim(min(low, drawn.min()) / _MARGIN_FACTOR, max(high, drawn.max()) * _MARGIN_FACTOR)
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.yaxis.set_minor_locator(NullLocator())


def _scale_phase(panel: Axes, models: Sequence[FloatArray]) -> None:
    drawn = np.concatenate(models)
    panel.set_ylim(drawn.min() - _MARGIN_DEGREES, drawn.max() + _MARGIN_DEGREES)
    panel.yaxis.set_major_locator(MaxNLocator(9, steps=(1, 1.5, 3, 4.5, 9, 10)))


def _draw_coherence(found: Identification) -> Figure:
    """Draw what share of the acceleration's power the force explains, over frequency."""
    figure = Figure(figsize=(11, 4.2), layout="constrained", facecolor="white")
    panel = figure.subplots()
    keys, lowest = [], 1.0
    for index, (name, grip) in enumerate(found.grips.items()):
        look = _look(index)
        drawn = [(response, look.ratio_line) for response in grip.responses]
        for response, style in [*drawn, (grip.averaged_h1, look.h1_line)]:
            panel.plot(response.frequency, response.coherence, **style)
            lowest = min(lowest, float(response.coherence.min()))
        keys += [
            Line2D([], [], **look.h1_line, label=f"{_short(name)}: H1, all trials"),
            Line2D([], [], **look.ratio_line, label=f"{_short(name)}: DFT ratio, each trial"),
        ]
    panel.set_ylim(max(0.0, math.floor(10 * lowest - 1) / 10), 1.01)
    panel.set_ylabel("coherence (1)")
    panel.set_xlabel("frequency (Hz)")
    _frequency_axis(panel, found.band)
    _rule(panel)
    _legend(panel, keys)
    return figure


def _frequency_axis(panel: Axes, band: tuple[float, float]) -> None:
    panel.set_xscale("log")
    panel.set_xlim(band[0] / _BAND_MARGIN, band[1] * _BAND_MARGIN)
    low, high = band[0] * _TICK_APART, band[1] / _TICK_APART
    panel.xaxis.set_major_locator(FixedLocator([*band, *(t for t in _TICKS if low < t < high)]))
    panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.xaxis.set_minor_locator(NullLocator())


def _rule(panel: Axes) -> None:
    panel.set_axisbelow(True)
    panel.grid(color="#dddddd", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(color="#888888")


def _legend(panel: Axes, keys: Sequence[Line2D]) -> None:
    """Put a legend beside a panel, where it hides nothing."""
    legend = panel.legend(
        handles=keys,
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        frameon=False,
        handlelength=3.2,
        borderaxespad=0,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)  # a grip may be named as it likes


def _short(name: str) -> str:
    """Return a grip's name as a legend has room for it."""
    words = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    return words if len(words) <= _LONGEST_NAME else words[: _LONGEST_NAME - 1] + "…"


def _picture(figure: Figure, path: Path) -> dict[str, Any]:
    """Write a figure, and return what shows it in a page: its address and size in pixels."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_DPI)
    path.write_bytes(file.getvalue())
    encoded = base64.b64encode(file.getvalue()).decode("ascii")
    width, height = (round(_CSS_DPI * inches) for inches in figure.get_size_inches())
    return {"source": f"data:image/png;base64,{encoded}", "width": width, "height": height}


# What the page shows


@dataclass(frozen=True)
class _Row:
    """A line of a table: what it is about, in words, its unit and its cells."""

    name: str
    text: str
    unit: str
    true: str
    cells: list[tuple[str, str]]


def _fits(found: Identification) -> list[tuple[str, HandleFit]]:
    """Return the fit of each grip and, where there are several, of all of them."""
    fits = [(name, grip.fit) for name, grip in found.grips.items()]
    return fits if len(fits) == 1 else [*fits, (POOLED, found.fit)]


def _parameter_rows(found: Identification, truth: HandleParameters | None) -> list[_Row]:
    """Return what was fitted or known, each cell with its standard error."""
    fits = [fit for _, fit in _fits(found)]
    rows: list[_Row] = []
    for name, (_, given) in own_schema(HandleParameters).items():
        true = None if truth is None else getattr(truth, name)
        cells = [_cell(getattr(fit.handle, name), fit.standard_errors.get(name)) for fit in fits]
        rows.append(_Row(name, given.text, given.unit, _number(true), cells))
    if any("delay" in fit.standard_errors for fit in fits):
        rows.append(_delay_row(fits))
    for name, (_, given) in own_schema(MountParameters).items():
        errors = [fit.standard_errors.get(f"mount_{name}") for fit in fits]
        if any(error is not None for error in errors):
            cells = [
                (DASH, DASH) if error is None else _cell(getattr(fit.mount, name), error)
                for fit, error in zip(fits, errors, strict=True)
            ]
            text = "of the accelerometer's mount"
            rows.append(_Row(f"mount {name}", text, given.unit or "1", DASH, cells))
    return rows


def _delay_row(fits: Sequence[HandleFit]) -> _Row:
    cells = []
    for fit in fits:
        error = fit.standard_errors.get("delay")
        in_microseconds = None if error is None else error * MICROSECONDS
        cells.append(_cell(fit.delay * MICROSECONDS, in_microseconds))
    return _Row("delay", "beside the loop's own sample and the hold", "µs", DASH, cells)


def _cell(value: float, error: float | None) -> tuple[str, str]:
    """Return a value, to the last digit of its standard error, and that error."""
    if error is None:
        return _number(value), KNOWN
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return _number(value), _number(error)
    decimals = _decimals(error, _ERROR_DIGITS)
    if value:
        decimals = min(decimals, _decimals(value, _MOST_DIGITS))
    return _fixed(value, decimals), _fixed(error, _decimals(error, _ERROR_DIGITS))


def _decimals(value: float, digits: int) -> int:
    """Return the number of decimals with which a value has so many digits that count."""
    return max(0, digits - 1 - math.floor(math.log10(abs(value))))


def _fixed(value: float, decimals: int) -> str:
    rounded = round(value, decimals) + 0.0  # no minus before a zero
    return f"{rounded:.{decimals}f}".replace("-", "\N{MINUS SIGN}")


def _number(value: float | None) -> str:
    """Return a number for a reader, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{value:.{_DIGITS}g}".replace("-", "\N{MINUS SIGN}")


def _explained(found: Identification) -> str:
    """Return in words what the fit leaves, and what that means."""
    residual = found.fit.residual
    if len(found.grips) > 1:
        return (
            "The pooled fit is a compromise between the grips: it leaves"
            f" {100 * found.fit.relative_residual:.2g} % of the response, as root mean square, and"
            " its standard errors tell how the grips differ, not how noisy the data is."
        )
    sentence = (
        f"The fit leaves {residual:.3g} times the scatter of the data, or"
        f" {100 * found.fit.relative_residual:.2g} % of the response, as root mean square"
    )
    if residual <= UNEXPLAINED:
        return f"{sentence}: it lacks nothing that stands out from the noise, which leaves 1."
    return (
        f"{sentence}. Noise alone leaves 1: the handle does what the model lacks, such as"
        " dry friction. The standard errors know nothing of that."
    )


def _grip_rows(grips: Mapping[str, GripIdentification]) -> list[dict[str, str]]:
    return [
        {
            "name": name,
            "trials": str(len(grip.trials)),
            "residual": f"{grip.fit.residual:.3g}",
            "coherence": f"{float(np.mean(grip.averaged_h1.coherence)):.3f}",
        }
        for name, grip in grips.items()
    ]


def _pair_rows(model: ApproximateModel) -> list[tuple[str, str, str]]:
    """Return name, frequency in Hz and damping ratio of each pair of zeros and of poles."""
    return [
        (
            f"{kind} pair {number}",
            _fixed(getattr(model, f"{kind}_{number}_frequency"), 2),
            _fixed(getattr(model, f"{kind}_{number}_damping"), 3),
        )
        for kind in ("zero", "pole")
        for number in (1, 2)
    ]


def _error_rows(errors: Mapping[str, ModelError]) -> list[tuple[str, str, str]]:
    return [
        (name, f"{error.magnitude_db:.2f}", f"{error.phase_deg:.1f}")
        for name, error in errors.items()
    ]


def _order(model: DiscreteModel) -> int:
    """Return the number of poles: a section of first order has no z^-2 below."""
    return int(2 * len(model.sections) - np.count_nonzero(model.sections[:, 5] == 0.0))


def _span(band: tuple[float, float]) -> str:
    return f"{band[0]:g} to {band[1]:g} Hz"

"""Plots of an identification: the paper's Figs. 4 and 5, and the coherence."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

from haptic_accel.analysis.plots import (
    BLACK,
    BLUE,
    DASHES,
    GREEN,
    GREY,
    GRIPS,
    LINE,
    PURPLE,
    SHADE,
    VERMILION,
    Dashes,
    Style,
    frequency_axis,
    rule,
    short,
)
from haptic_accel.core.identification.estimate import FrequencyResponse
from haptic_accel.core.identification.evaluation import GripIdentification, Identification
from haptic_accel.core.identification.sweep import (
    DROPPED_REPEATS,
    IdentificationTrial,
    SweepParameters,
    repeat_samples,
)
from haptic_accel.core.model import ComplexArray, FloatArray, handle_model

MASS_LIKE = 60.0
"""Frequency between suspension and mount, where a handle is little more than its mass, Hz."""

POINTS = 400
"""Number of frequencies at which models are drawn."""

DEGREES = 180 / math.pi
"""Degrees in a radian."""

# Lines that lie on each other differ in width and dashes too.
_FULL: Style = {"color": BLUE, "linewidth": 2.2, "zorder": 4}
_DISCRETE: Style = {"color": BLACK, "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 5}
_EQUATION: Style = {"color": GREEN, "linewidth": 1.8, "zorder": 3}
_EQUATION["linestyle"] = (0, (7, 2, 1.5, 2))
_APPROXIMATE: Style = {"color": VERMILION, "linewidth": 2.2, "zorder": 3.5}
_APPROXIMATE["linestyle"] = (0, (1.2, 1.2))
_MASS: Style = {"color": PURPLE, "linewidth": 1.8, "linestyle": (0, (10, 4)), "zorder": 2.5}

_AVERAGED_POINTS = 28  # drawn of an averaged estimate; more would hide the models
_MARGIN_DEGREES = 20.0  # beyond what is drawn
_MARGIN_FACTOR = 1.3  # of magnitude beyond what is drawn
_MOST_DATA = (1.0, 99.0)  # percentiles of the data that axes reach


@dataclass(frozen=True)
class _GripLook:
    """Look of the measurements of one grip: each trial pale, averages dark."""

    pale: str
    dark: str
    dashes: Dashes

    @property
    def ratio(self) -> Style:
        return {"color": self.pale, "marker": ".", "markersize": 7.0, "linestyle": "", "zorder": 1}

    @property
    def h1(self) -> Style:
        return self._marks("o")

    @property
    def h2(self) -> Style:
        return self._marks("x")

    def _marks(self, marker: str) -> Style:
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
    def ratio_line(self) -> Style:
        return {"color": self.pale, "linewidth": 1.2, "zorder": 1}

    @property
    def h1_line(self) -> Style:
        return {"color": self.dark, "linewidth": 1.6, "linestyle": self.dashes, "zorder": 2}


def _look(index: int) -> _GripLook:
    return _GripLook(*GRIPS[index % len(GRIPS)], DASHES[index % len(DASHES)])


def sweep_plot(trial: IdentificationTrial, sweep: SweepParameters) -> Figure:
    """Draw force and acceleration over time, the paper's Fig. 4."""
    figure = Figure(figsize=(10, 5.6), layout="constrained", facecolor="white")
    force, acceleration = figure.subplots(2, 1, sharex=True)
    repeat = repeat_samples(sweep, trial.rate)
    samples = sweep.repeats * repeat
    time = np.arange(samples) / trial.rate
    force.plot(time, trial.actuator_force[:samples], color=BLUE, linewidth=0.6)
    acceleration.plot(time, trial.handle_acceleration[:samples], color=VERMILION, linewidth=0.6)
    dropped = DROPPED_REPEATS * repeat / trial.rate
    for panel, label in (
        (force, "actuator force (N)"),
        (acceleration, "handle acceleration (m/s²)"),
    ):
        panel.axvspan(0, dropped, color=SHADE, zorder=0)
        for index in range(DROPPED_REPEATS + 1, sweep.repeats):
            panel.axvline(index * repeat / trial.rate, color=LINE, linewidth=0.8)
        panel.set_ylabel(label)
        panel.set_xlim(0, samples / trial.rate)
        rule(panel)
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
            color=GREY,
        )
    figure.align_ylabels()
    acceleration.set_xlabel("time (s)")
    return figure


def model_plot(found: Identification) -> Figure:
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
        frequency_axis(panel, *found.band, ends=True)
        rule(panel)
    _legend(magnitude, [curve.key for curve in curves])
    _legend(phase, list(_data_keys(found.grips)))
    figure.align_ylabels()
    return figure


@dataclass(frozen=True)
class _Curve:
    """A model's complex response, m/s^2 per N, shape (n,), and how it is drawn."""

    label: str
    style: Style
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


def _data(grips: Iterable[GripIdentification]) -> Iterator[tuple[FrequencyResponse, Style]]:
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
        yield Line2D([], [], **look.ratio, label=f"{short(name)}: DFT ratio, each trial")
        yield Line2D([], [], **look.h1, label=f"{short(name)}: H1, all trials")
        yield Line2D([], [], **look.h2, label=f"{short(name)}: H2, all trials")


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


def coherence_plot(found: Identification) -> Figure:
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
            Line2D([], [], **look.h1_line, label=f"{short(name)}: H1, all trials"),
            Line2D([], [], **look.ratio_line, label=f"{short(name)}: DFT ratio, each trial"),
        ]
    panel.set_ylim(max(0.0, math.floor(10 * lowest - 1) / 10), 1.01)
    panel.set_ylabel("coherence (1)")
    panel.set_xlabel("frequency (Hz)")
    frequency_axis(panel, *found.band, ends=True)
    rule(panel)
    _legend(panel, keys)
    return figure


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

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures of an identification with one coil or with three."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

from haptic_accel.analysis import plots
from haptic_accel.analysis.plots import BLUE, DASHES, VERMILION, Style, frequency_axis, rule, short
from haptic_accel.core.axes import NAMES
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import FrequencyResponse
from haptic_accel.core.identification.evaluation import GripIdentification, Identification
from haptic_accel.core.identification.fit import INTERVAL
from haptic_accel.core.identification.three_axes import ThreeAxisIdentification
from haptic_accel.core.model import ComplexArray, FloatArray, handle_model

MASS_LIKE = 60.0
"""Frequency between suspension and mount, where the handle behaves like a mass, Hz."""

POINTS = 400
"""Number of frequencies for drawing models."""

DEGREES = 180 / math.pi
"""Degrees per radian."""

# Tuples of label, colour, width, order and dashes; overlapping lines differ in width and dashes.
_MODELS: Sequence[tuple[str, str, float, float, Any]] = (
    ("full model, as sampled", BLUE, 2.2, 4, "-"),
    ("discrete model", plots.BLACK, 1.2, 5, (0, (4, 2))),
    ("eq. (3) alone", plots.GREEN, 1.8, 3, (0, (7, 2, 1.5, 2))),
    ("approximate model", VERMILION, 2.2, 3.5, (0, (1.2, 1.2))),
    ("mass model", plots.PURPLE, 1.8, 2.5, (0, (10, 4))),
)

Grips = Mapping[str, GripIdentification]
"""Identifications by name of the grip."""

_AVERAGED_POINTS = 28  # maximum for an averaged estimate; more would hide the models
_MARGIN_DEGREES = 20.0  # beyond the drawn range
_MARGIN_FACTOR = 1.3  # of magnitude beyond the drawn range
_MOST_DATA = (1.0, 99.0)  # percentiles of the data within the axes


def sweep_plot(trial: sweeps.IdentificationTrial, sweep: sweeps.SweepParameters) -> Figure:
    """Draw force and acceleration over time (the paper's Fig. 4)."""
    figure = Figure(figsize=(10, 5.6), layout="constrained", facecolor="white")
    force, acceleration = figure.subplots(2, 1, sharex=True)
    repeat = sweeps.repeat_samples(sweep, trial.rate)
    samples = sweep.repeats * repeat
    time = np.arange(samples) / trial.rate
    force.plot(time, trial.actuator_force[:samples], color=BLUE, linewidth=0.6)
    acceleration.plot(time, trial.handle_acceleration[:samples], color=VERMILION, linewidth=0.6)
    dropped = sweeps.DROPPED_REPEATS * repeat / trial.rate
    end = samples / trial.rate
    labels = ("actuator force (N)", "handle acceleration (m/s²)")
    for panel, label in zip((force, acceleration), labels, strict=True):
        panel.axvspan(0, dropped, color=plots.SHADE, zorder=0)
        for index in range(sweeps.DROPPED_REPEATS + 1, sweep.repeats):
            panel.axvline(index * repeat / trial.rate, color=plots.LINE, linewidth=0.8)
        panel.set_ylabel(label)
        panel.set_xlim(0, end)
        rule(panel)
    above: Style = {"xycoords": force.get_xaxis_transform(), "textcoords": "offset points"}
    above |= {"xytext": (0, 4), "ha": "center", "color": plots.GREY}
    force.annotate("settling, not evaluated", (dropped / 2, 1.0), **above)
    force.annotate("evaluated", ((dropped + end) / 2, 1.0), **above)
    figure.align_ylabels()
    acceleration.set_xlabel("time (s)")
    return figure


def model_plot(found: Identification) -> Figure:
    """Draw magnitude and phase of data and models (the paper's Fig. 5)."""
    figure = Figure(figsize=(11, 8.2), layout="constrained", facecolor="white")
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    low, high = found.band
    frequency = np.geomspace(low, min(high, 0.499 * found.discrete.rate), POINTS)
    models = _models(found, frequency)
    phases = [_unwrapped(frequency, model) for model in models]
    lines = []
    for (label, color, width, order, dashes), model, angle in zip(
        _MODELS, models, phases, strict=True
    ):
        style: Style = {"color": color, "linewidth": width, "linestyle": dashes, "zorder": order}
        lines += magnitude.plot(frequency, np.abs(model), **style, label=label)
        phase.plot(frequency, angle, **style)
    marks = {}
    for label, data, style in _data(found.grips):
        near = np.interp(data.frequency, frequency, phases[0])
        magnitude.plot(data.frequency, np.abs(data.response), **style)
        angle = np.angle(data.response) * DEGREES
        angle -= 360 * np.round((angle - near) / 360)  # to within half a turn of the model's phase
        (marks[label],) = phase.plot(data.frequency, angle, **style, label=label)
    _scale_magnitude(magnitude, np.abs(models), found)
    phase.set_ylim(np.min(phases) - _MARGIN_DEGREES, np.max(phases) + _MARGIN_DEGREES)
    phase.yaxis.set_major_locator(MaxNLocator(9, steps=(1, 1.5, 3, 4.5, 9, 10)))
    magnitude.set_ylabel("acceleration over force (m/s² per N)")
    phase.set_ylabel("phase (degrees)")
    phase.set_xlabel("frequency (Hz)")
    _finish(magnitude, found, lines)
    _finish(phase, found, list(marks.values()))
    figure.align_ylabels()
    return figure


def _models(found: Identification, frequency: FloatArray) -> list[ComplexArray]:
    """Return the responses of `_MODELS`, m/s^2 per N, the best fit to the data first."""
    return [
        found.fit.response(frequency, found.discrete.rate),
        found.discrete.response(frequency),
        handle_model(found.fit.handle).response(frequency),
        found.approximate.model().response(frequency),
        np.full(len(frequency), 1 / found.fit.handle.m_h, dtype=np.complex128),
    ]


def _data(grips: Grips) -> Iterator[tuple[str, FrequencyResponse, Style]]:
    """Yield label, estimate and style of the drawn data: trials pale, averages dark."""
    for name, grip, pale, dark, _ in _looks(grips):
        each: Style = {"color": pale, "linestyle": "", "zorder": 1, "marker": ".", "markersize": 7}
        averaged: Style = {"color": dark, "linestyle": "", "zorder": 2, "markersize": 4.5}
        averaged |= {"markerfacecolor": "none", "markeredgewidth": 0.9}
        for response in grip.responses:
            yield f"{short(name)}: DFT ratio, each trial", response, each
        for kind, response, marker in (
            ("H1", grip.averaged_h1, "o"),
            ("H2", grip.averaged_h2, "x"),
        ):
            label = f"{short(name)}: {kind}, all trials"
            yield label, _thinned(response), averaged | {"marker": marker}


def _looks(grips: Grips) -> Iterator[tuple[str, GripIdentification, str, str, str]]:
    """Yield name, identification, pale colour, dark colour and dashes of each grip."""
    return zip(
        grips, grips.values(), cycle(plots.PALE_GRIPS), cycle(plots.DARK_GRIPS), cycle(DASHES)
    )


def _thinned(response: FrequencyResponse) -> FrequencyResponse:
    """Return lines with logarithmic spacing, as far as available."""
    low, high = response.frequency[0], response.frequency[-1]
    spaced = np.geomspace(low, high, _AVERAGED_POINTS)
    some = np.unique(np.abs(response.frequency - spaced[:, None]).argmin(axis=1))
    names = ("frequency", "response", "coherence")
    return replace(response, **{name: getattr(response, name)[some] for name in names})


def _unwrapped(frequency: FloatArray, response: ComplexArray) -> FloatArray:
    """Return the phase of a smooth response without jumps, degrees, shape (n,).

    Whole turns are meaningless: all models are near zero where the handle behaves like a mass.
    """
    phase = np.unwrap(np.angle(response)) * DEGREES
    middle = min(int(np.searchsorted(frequency, MASS_LIKE)), len(phase) - 1)
    return np.asarray(phase - 360 * np.round(phase[middle] / 360))


def _scale_magnitude(panel: Axes, models: FloatArray, found: Identification) -> None:
    """Scale an axis to models and data without outliers."""
    data = [response.response for grip in found.grips.values() for response in grip.responses]
    low, high = np.percentile(np.abs(np.concatenate(data)), _MOST_DATA)
    low, high = min(low, models.min()), max(high, models.max())
    panel.set(yscale="log", ylim=(low / _MARGIN_FACTOR, high * _MARGIN_FACTOR))
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.yaxis.set_minor_locator(NullLocator())


def coherence_plot(found: Identification) -> Figure:
    """Draw the coherence over frequency: the fraction of power explained by the force."""
    figure = Figure(figsize=(11, 4.2), layout="constrained", facecolor="white")
    panel = figure.subplots()
    keys, lowest = [], 1.0
    for name, grip, pale, dark, dashes in _looks(found.grips):
        each: Style = {"color": pale, "linewidth": 1.2, "zorder": 1}
        averaged: Style = {"color": dark, "linewidth": 1.6, "linestyle": dashes}
        drawn = [(response, each) for response in grip.responses]
        for response, style in [*drawn, (grip.averaged_h1, averaged | {"zorder": 2})]:
            panel.plot(response.frequency, response.coherence, **style)
            lowest = min(lowest, float(response.coherence.min()))
        keys += [
            Line2D([], [], **averaged, label=f"{short(name)}: H1, all trials"),
            Line2D([], [], **each, label=f"{short(name)}: DFT ratio, each trial"),
        ]
    panel.set_ylim(max(0.0, math.floor(10 * lowest - 1) / 10), 1.01)
    panel.set_ylabel("coherence (1)")
    panel.set_xlabel("frequency (Hz)")
    _finish(panel, found, keys)
    return figure


def _finish(panel: Axes, found: Identification, keys: Sequence[Line2D]) -> None:
    """Scale the frequency axis of a panel, and add a legend next to the panel."""
    frequency_axis(panel, *found.band, ends=True)
    rule(panel)
    style: Style = {"bbox_to_anchor": (1.01, 1.0), "frameon": False, "handlelength": 3.2}
    legend = panel.legend(handles=keys, loc="upper left", borderaxespad=0, **style)
    for text in legend.get_texts():
        text.set_parse_math(False)  # the name of a grip is arbitrary


ANISOTROPY = "anisotropy (largest over smallest singular value of the response)"
"""Condition number of a response at one frequency; differs from the condition number of the coils'
directions, which has a limit."""


_AXIS_COLORS = dict(zip(NAMES, (plots.BLUE, plots.VERMILION, plots.GREEN), strict=True))


def response_plot(found: ThreeAxisIdentification) -> Figure:
    """Draw magnitude and phase of all nine elements: estimate, 95 % interval and plant."""
    figure = Figure(figsize=(11, 12.5), layout="constrained", facecolor="white")
    panels = figure.subplots(6, 3, sharex=True, sharey="row", height_ratios=[1.4, 1] * 3)
    response = found.response
    modelled = found.plant.response(response.frequency, response.rate)
    for axis, coil in np.ndindex(3, 3):
        magnitude, phase = panels[2 * axis : 2 * axis + 2, coil]
        estimate, model = response.response[:, axis, coil], modelled[:, axis, coil]
        _element(magnitude, phase, response.frequency, estimate, model)
        width = INTERVAL * np.sqrt(2.0) * response.deviation[:, axis, coil]
        size = np.abs(estimate)
        style: Style = {"color": plots.SKY, "alpha": 0.4, "linewidth": 0}
        magnitude.fill_between(
            response.frequency, np.maximum(size - width, 1e-3), size + width, **style
        )
        if axis == 0:
            magnitude.set_title(f"force of coil {NAMES[coil]}", fontsize="medium")
        if coil == 0:
            magnitude.set_ylabel(f"{NAMES[axis]}: m/s² per N")
            phase.set_ylabel(f"{NAMES[axis]}: phase (degrees)")
        low, high = magnitude.get_ylim() if coil else (np.inf, 0.0)
        magnitude.set_ylim(min(low, size.min() / 3), max(high, size.max() * 2))
    for panel in panels[-1]:
        panel.set_xlabel("frequency (Hz)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    figure.align_ylabels()
    return figure


def _element(
    magnitude: Axes,
    phase: Axes,
    frequency: FloatArray,
    estimate: ComplexArray,
    model: ComplexArray,
) -> None:
    """Draw an element of the response and of the plant."""
    data: Style = {"color": plots.GREY, "linestyle": "", "marker": ".", "markersize": 2.5}
    line: Style = {"color": plots.BLUE, "linewidth": 1.4}
    magnitude.plot(frequency, np.abs(estimate), **data, label="estimate, with 95 % interval")
    magnitude.plot(frequency, np.abs(model), **line, label="plant")
    phase.plot(frequency, np.angle(estimate, deg=True), **data)
    phase.plot(
        frequency, np.angle(model, deg=True), **line | {"marker": ".", "linestyle": ""}, ms=1
    )
    magnitude.set_yscale("log")
    phase.set(ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
    for panel in (magnitude, phase):
        frequency_axis(panel, frequency[0], frequency[-1], (20, 50, 100, 200), ends=True)
        rule(panel)


def multiple_coherence_plot(found: ThreeAxisIdentification) -> Figure:
    """Draw the multiple coherence of each acceleration over frequency."""
    figure, panel = _over_frequency(found, "multiple coherence (1)")
    coherence = found.response.coherence
    for name, values in zip(NAMES, coherence.T, strict=True):
        panel.plot(
            found.response.frequency,
            values,
            color=_AXIS_COLORS[name],
            linewidth=1.2,
            label=f"acceleration along {name}",
        )
    panel.set_ylim(max(0.0, float(coherence.min()) - 0.02), 1.005)
    panel.legend(loc="lower right", frameon=False)
    return figure


def condition_plot(found: ThreeAxisIdentification) -> Figure:
    """Draw the anisotropy of the estimate and of the plant over frequency."""
    figure, panel = _over_frequency(found, ANISOTROPY)
    response = found.response
    modelled = np.linalg.cond(found.plant.response(response.frequency, response.rate))
    style: Style = {"color": plots.GREY, "linestyle": "", "marker": ".", "markersize": 3}
    panel.plot(response.frequency, response.condition, **style, label="estimate")
    panel.plot(response.frequency, modelled, color=plots.BLUE, linewidth=1.4, label="plant")
    panel.set_ylim(bottom=1.0)
    panel.legend(frameon=False)
    return figure


def _over_frequency(found: ThreeAxisIdentification, label: str) -> tuple[Figure, Axes]:
    """Return a figure with one panel over frequency."""
    figure = Figure(figsize=(11, 4.2), layout="constrained", facecolor="white")
    panel = figure.subplots()
    frequency = found.response.frequency
    frequency_axis(panel, frequency[0], frequency[-1], ends=True)
    rule(panel)
    panel.set_xlabel("frequency (Hz)")
    panel.set_ylabel(label)
    return figure, panel

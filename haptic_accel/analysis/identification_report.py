# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Report of an identification: a page with parameters, models and plots."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

from haptic_accel.analysis import plots
from haptic_accel.analysis.plots import BLUE, DASHES, VERMILION, Style, frequency_axis, rule, short
from haptic_accel.core.handle.discrete import DiscreteModel
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import FrequencyResponse
from haptic_accel.core.identification.evaluation import (
    GripIdentification,
    Identification,
)
from haptic_accel.core.identification.fit import HandleFit
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import (
    ComplexArray,
    FloatArray,
    HandleParameters,
    MountParameters,
    handle_model,
)
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.tables import DASH, ResultTable, number
from haptic_accel.pages import write

PARAMETER_FILE = "handle.yaml"
"""Name of the parameter file to which the page refers."""

POOLED = "all grips"
"""Heading of the fit to all trials of several grips."""

KNOWN = "known"
"""Text for the standard error of a parameter that was not fitted."""

MICROSECONDS = 1e6
"""Microseconds per second."""


@dataclass(frozen=True)
class ModelError:
    """Largest errors of a model's response over a band.

    Attributes
    ----------
    magnitude_db : float
        Largest magnitude error, dB.
    phase_deg : float
        Largest phase error, degrees.
    """

    magnitude_db: float
    phase_deg: float


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
    """Write a page with the parameters, models and plots of an identification to a folder.

    Parameters
    ----------
    found : Identification
        Result of the identification.
    sweep : SweepParameters
        Excitation of the handle.
    folder : Path
        Folder, created if necessary. The page refers to a file ``handle.yaml`` in it.
    settings : mapping of str to str
        Arguments of the run, shown as a table.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    errors : mapping of str to ModelError
        Errors by model, ``discrete`` and ``physical``; empty if the true response is unknown.
    band : tuple of float
        Band of the errors, Hz.
    notes : sequence of str
        Paragraphs below the heading, warnings first.

    Returns
    -------
    Path
        Page ``folder/index.html``, which is self-contained. The plots are also saved beside it as
        ``fig4_sweep.png``, ``fig5_models.png`` and ``coherence.png``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    identified = next(iter(found.grips.values()))
    plots = {
        "fig4_sweep.png": sweep_plot(identified.trials[0], sweep),
        "fig5_models.png": model_plot(found),
        "coherence.png": coherence_plot(found),
    }
    index = folder / "index.html"
    write(
        index,
        "identification.html.j2",
        found=found,
        settings=settings,
        notes=notes,
        columns=list(fits_by_column(found)),
        parameters=parameter_rows(fits_by_column(found), truth),
        simulated=truth is not None,
        explained=explained(found),
        order=_order(found.discrete),
        errors=errors,
        band=band,
        number=number,
        parameter_file=PARAMETER_FILE,
        pictures=pictures(plots, folder),
    )
    return index


_DPI = 130  # pixels per inch
_CSS_DPI = 96  # pixels per inch of a page
_DIGITS = 5  # significant digits of a value with unknown error
_MOST_DIGITS = 7  # for a very small error
_ERROR_DIGITS = 2  # of a standard error


def pictures(figures: Mapping[str, Figure], folder: Path) -> dict[str, dict[str, Any]]:
    """Write figures to a folder; return by name their addresses for a page and sizes in pixels."""
    return {name: _picture(figure, folder / name) for name, figure in figures.items()}


def _picture(figure: Figure, path: Path) -> dict[str, Any]:
    """Write a figure; return its address for a page and its size in pixels."""
    figure.savefig(path, dpi=_DPI)
    encoded = base64.b64encode(path.read_bytes()).decode("ascii")
    width, height = (round(_CSS_DPI * inches) for inches in figure.get_size_inches())
    return {"source": f"data:image/png;base64,{encoded}", "width": width, "height": height}


# Contents of the page


@dataclass(frozen=True)
class Row:
    """Row of the parameter table: true value, and for each fit value and error."""

    name: str
    text: str
    unit: str
    true: str
    cells: list[tuple[str, str]]


def fits_by_column(found: Identification) -> dict[str, HandleFit]:
    """Return the fit of each grip and, if there are several, of all together."""
    fits = {name: grip.fit for name, grip in found.grips.items()}
    return fits if len(fits) == 1 else {**fits, POOLED: found.fit}


def _quantities() -> Iterator[tuple[str, str, str, float]]:
    """Yield name, text, unit, and the factor to that unit, for all possible fitted quantities."""
    for name, (_, given) in own_schema(HandleParameters).items():
        yield name, given.text, given.unit, 1.0
    yield "friction", "dry friction of the actuator's bearing", "N", 1.0
    yield (
        "delay",
        "delay of the hardware, in addition to latency, hold and one sample",
        "µs",
        MICROSECONDS,
    )
    for name, (_, given) in own_schema(MountParameters).items():
        yield f"mount_{name}", "mount of the accelerometer", given.unit or "1", 1.0


def parameter_rows(
    by_column: Mapping[str, HandleFit], truth: HandleParameters | None
) -> list[Row]:
    """Return the table of fitted and known parameters.

    Parameters
    ----------
    by_column : mapping of str to HandleFit
        Fits, each with a cell in a row.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    """
    fits = list(by_column.values())
    of_handle = own_schema(HandleParameters)
    rows = []
    for name, text, unit, factor in _quantities():
        fitted = any(name in fit.standard_errors for fit in fits)
        if fitted or name in of_handle:
            cells = [
                _cell(fit.value(name), fit.standard_errors.get(name), factor)
                if name in fit.standard_errors or name in of_handle
                else (DASH, DASH)
                for fit in fits
            ]
            label = name if name in of_handle else name.replace("_", " ")
            rows.append(Row(label, text, unit, _number(getattr(truth, name, None)), cells))
    return rows


def parameter_table(
    by_column: Mapping[str, HandleFit], truth: HandleParameters | None
) -> ResultTable:
    """Return the parameters as a table for a terminal."""
    left = ("name", "unit", "true") if truth else ("name", "unit")
    rows = []
    for row in parameter_rows(by_column, truth):
        cells = [
            f"{value} ± {error}" if error[0].isdigit() else f"{value} {error}"
            for value, error in row.cells
        ]
        rows.append([*(getattr(row, name) for name in left), *cells])
    headings = ("", *left[1:], *by_column)
    return ResultTable(headings, rows, "the handle, with standard errors", left=len(left))


def _cell(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """Return a value, rounded to the last digit of its standard error, and that error."""
    value *= factor
    if error is None:
        return _number(value), KNOWN
    error *= factor
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return _number(value), _number(error)
    decimals = _decimals(error, _ERROR_DIGITS)
    own = min(decimals, _decimals(value, _MOST_DIGITS)) if value else decimals
    return number(value, own), number(error, decimals)


def _decimals(value: float, digits: int) -> int:
    """Return the number of decimals that gives a value a number of significant digits."""
    return max(0, digits - 1 - math.floor(math.log10(abs(value))))


def _number(value: float | None) -> str:
    """Return a number as text, or a dash if there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{value:.{_DIGITS}g}".replace("-", "\N{MINUS SIGN}")


def fit_metrics(fit: HandleFit) -> dict[str, Any]:
    """Return the parameters of a fit with standard errors for a JSON file."""
    return {
        "parameters": {
            name: {
                "value": fit.value(name),
                "standard_error": fit.standard_errors.get(name),
                "unit": given.unit,
            }
            for name, (_, given) in own_schema(HandleParameters).items()
        },
        "delay_s": fit.delay,
        "delay_us": fit.delay * 1e6,
        "delay_standard_error_s": fit.standard_errors.get("delay"),
        "friction_n": fit.bearing.friction,
        "friction_standard_error_n": fit.standard_errors.get("friction"),
        "mount": asdict(fit.mount),
        "mount_standard_errors": {
            name: fit.standard_errors.get(f"mount_{name}") for name in asdict(fit.mount)
        },
        "residual": fit.residual,
    }


def plain(values: Mapping[str, Any]) -> dict[str, float]:
    """Return numbers rounded to six digits for a parameter file."""
    return {name: float(f"{value:.6g}") for name, value in values.items()}


def explained(found: Identification) -> str:
    """Return a sentence on the residual of the fit."""
    residual = found.fit.residual
    if len(found.grips) > 1:
        return (
            "The pooled fit is a compromise between the grips. Its residual is"
            f" {100 * found.fit.relative_residual:.2g} % of the response (root mean square), and"
            " its standard errors show the difference between the grips, not the noise."
        )
    sentence = (
        f"The residual of the fit is {residual:.3g} times the scatter of the data, or"
        f" {100 * found.fit.relative_residual:.2g} % of the response (root mean square)."
    )
    if not found.fit.deviates:
        return (
            f"{sentence} Noise alone gives about 1: the data shows no significant deviation from"
            " the model."
        )
    sentence += " Noise alone gives about 1, so the handle deviates from the model"
    if "friction" in found.fit.standard_errors:
        return f"{sentence}. The standard errors include that."
    return f"{sentence}, for example by dry friction. The standard errors do not include that."


def _order(model: DiscreteModel) -> int:
    """Return the number of poles; a first-order section has no z^-2 in its denominator."""
    return int(2 * len(model.sections) - np.count_nonzero(model.sections[:, 5] == 0.0))


MASS_LIKE = 60.0
"""Frequency between suspension and mount, where the handle behaves like a mass, Hz."""

POINTS = 400
"""Number of frequencies for drawing models."""

DEGREES = 180 / math.pi
"""Degrees per radian."""

# Label, colour, width, order and dashes; overlapping lines differ in width and dashes.
_MODELS: Sequence[tuple[str, str, float, float, Any]] = (
    ("full model, as sampled", BLUE, 2.2, 4, "-"),
    ("discrete model", plots.BLACK, 1.2, 5, (0, (4, 2))),
    ("eq. (3) alone", plots.GREEN, 1.8, 3, (0, (7, 2, 1.5, 2))),
    ("approximate model", VERMILION, 2.2, 3.5, (0, (1.2, 1.2))),
    ("mass model", plots.PURPLE, 1.8, 2.5, (0, (10, 4))),
)

Grips = Mapping[str, GripIdentification]
"""Identifications by name of the grip."""

_AVERAGED_POINTS = 28  # drawn for an averaged estimate; more would hide the models
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
    place: Style = {"xycoords": force.get_xaxis_transform(), "textcoords": "offset points"}
    place |= {"xytext": (0, 4), "ha": "center", "color": plots.GREY}
    force.annotate("settling, not evaluated", (dropped / 2, 1.0), **place)
    force.annotate("evaluated", ((dropped + end) / 2, 1.0), **place)
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
        (marks[label],) = phase.plot(
            data.frequency, _nearest_turn(data.response, near), **style, label=label
        )
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
    wanted = np.geomspace(low, high, _AVERAGED_POINTS)
    some = np.unique(np.abs(response.frequency - wanted[:, None]).argmin(axis=1))
    names = ("frequency", "response", "coherence")
    return replace(response, **{name: getattr(response, name)[some] for name in names})


def _unwrapped(frequency: FloatArray, response: ComplexArray) -> FloatArray:
    """Return the phase of a smooth response without jumps, degrees, shape (n,).

    Whole turns are meaningless: all models are near zero where the handle behaves like a mass.
    """
    phase = np.unwrap(np.angle(response)) * DEGREES
    middle = min(int(np.searchsorted(frequency, MASS_LIKE)), len(phase) - 1)
    return np.asarray(phase - 360 * np.round(phase[middle] / 360))


def _nearest_turn(response: ComplexArray, near: FloatArray) -> FloatArray:
    """Return a noisy phase within half a turn of another response's, degrees, shape (n,)."""
    phase = np.angle(response) * DEGREES
    return np.asarray(phase - 360 * np.round((phase - near) / 360))


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
    """Scale the frequency axis of a panel, and add a legend beside it."""
    frequency_axis(panel, *found.band, ends=True)
    rule(panel)
    look: Style = {"bbox_to_anchor": (1.01, 1.0), "frameon": False, "handlelength": 3.2}
    legend = panel.legend(handles=keys, loc="upper left", borderaxespad=0, **look)
    for text in legend.get_texts():
        text.set_parse_math(False)  # the name of a grip is arbitrary

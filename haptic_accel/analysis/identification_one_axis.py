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

"""Result of an identification with one coil: metrics, parameters, page and figures."""

from __future__ import annotations

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
from haptic_accel.analysis.identification_result import ModelError, Result, fit_metrics, plain
from haptic_accel.analysis.plots import BLUE, DASHES, VERMILION, Style, frequency_axis, rule, short
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import FrequencyResponse, dft_ratio
from haptic_accel.core.identification.evaluation import GripIdentification, Identification, centred
from haptic_accel.core.identification.fit import HandleFit
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import ACTUATOR, ComplexArray, FloatArray, Suspension, handle_model
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import run_identification
from haptic_accel.setup.files import EVERY_NODE

LOWEST_COMPARED = 15.0
"""Frequency below which the compensator's high-pass passes nothing (paper), Hz."""

HIGHEST_COMPARED = 400.0
"""Frequency above which the true response lies in the accelerometer's noise, Hz."""

POOLED = "all grips"
"""Heading of the fit to all trials of several grips."""

POOLED_NOTE = (
    "models of all grips pooled are a compromise between them, the discrete model most of all; for"
    " the best model of one grip, identify that grip alone"
)
"""Note on several grips."""


@dataclass(frozen=True)
class OneAxisResult(Result[Identification]):
    """Result of the identification of a handle with one coil, held with one or several grips.

    Errors are those of the models ``discrete`` and ``physical``.
    """

    template = "identification.html.j2"

    @property
    def order(self) -> int:
        """Number of poles of the discrete model."""
        sections = self.found.discrete.sections
        # A first-order section has no z^-2 in its denominator.
        return int(2 * len(sections) - np.count_nonzero(sections[:, 5] == 0.0))

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency of a comparison with the true response, Hz."""
        lowest, highest = self.found.band
        return max(LOWEST_COMPARED, lowest), min(0.9 * highest, HIGHEST_COMPARED)

    @property
    def notes(self) -> list[str]:
        """Warnings to the reader of the metrics."""
        return super().notes + [POOLED_NOTE] * (len(self.found.grips) > 1)

    @property
    def fits(self) -> dict[str, HandleFit]:
        """Fit of each grip and, if there are several, of all together."""
        fits = {name: grip.fit for name, grip in self.found.grips.items()}
        return fits if len(fits) == 1 else {**fits, POOLED: self.found.fit}

    @property
    def explained(self) -> str:
        """Sentence on the residual of the fit."""
        fit = self.found.fit
        relative = f"{100 * fit.relative_residual:.2g} % of the response (root mean square)"
        if len(self.found.grips) > 1:
            return (
                f"The pooled fit is a compromise between the grips. Its residual is {relative},"
                " and its standard errors show the difference between the grips, not the noise."
            )
        sentence = (
            f"The residual of the fit is {fit.residual:.3g} times the scatter of the data, or"
            f" {relative}."
        )
        if not fit.deviates:
            return (
                f"{sentence} Noise alone gives about 1: the data shows no significant deviation"
                " from the model."
            )
        sentence += " Noise alone gives about 1, so the handle deviates from the model"
        if "friction" in fit.standard_errors:
            return f"{sentence}. The standard errors include that."
        return f"{sentence}, for example by dry friction. The standard errors do not include that."

    @property
    def moving_mass(self) -> float:
        """Mass of the handle without the actuator, kg."""
        return self.found.fit.handle.m_h

    def beside_truth(
        self, rig: RigParameters, sweep: SweepParameters, on_arrival: bool
    ) -> OneAxisResult:
        """Return the result with the errors of its models."""
        errors = model_errors(self.found, rig, sweep, self.band, on_arrival)
        return replace(self, truth=rig.master.handle, errors=errors)

    def sentences(self) -> Iterator[str]:
        """Yield errors against the true response, and the delay of the hardware."""
        for name, error in self.errors.items():
            yield (
                f"{name} model against the true response, {self.band[0]:g} to {self.band[1]:g} Hz:"
                f" at most {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
            )
        yield (
            f"delay of the hardware: {self.found.fit.delay * 1e6:.0f} us, in addition to the"
            f" graph's latency of {self.latency} samples"
        )

    def parameters(self, age: float, model: Path) -> dict[str, dict[str, Any]]:
        """Return the parameters of each node that describe the handle, and its controllers."""
        del model  # the parameters hold all models
        found, fit = self.found, self.found.fit
        friction = float(f"{fit.certain_friction:.4f}")
        handle = plain({name: getattr(fit.handle, name) for name in ("m_h", "k_u", "b_u")})
        mount = plain(asdict(fit.mount))
        suspension = {name: getattr(fit.handle, name) for name in own_schema(Suspension)}
        return {
            EVERY_NODE: {ACTUATOR: plain(asdict(self.actuator) | suspension)},
            "master_device": {
                "simulated": {
                    "handle": handle,
                    "mount": mount,
                    "drive": {
                        "delay": float(f"{max(0.0, fit.delay - age):.6f}"),
                        "coulomb_friction": friction,
                    },
                }
            },
            "compensator": {
                "constant": plain({"mass": fit.handle.m_h}),
                "dynamic": plain(asdict(found.approximate)),
                "plant": {
                    "handle": handle,
                    "mount": mount,
                    "delay": float(f"{max(0.0, fit.delay):.6f}"),
                    "bandwidth": fit.low_pass_frequency,
                    "friction": friction,
                    "doubt": "; ".join(self.doubts),
                },
            },
        }

    @property
    def heading(self) -> str:
        """First lines of a parameter file."""
        fit = self.found.fit
        return (
            "# A handle as identified; use with params_file:=FILE. SI units.\n"
            f"# Band {fit.band[0]:.4g} to {fit.band[1]:.4g} Hz, delay of the hardware"
            f" {fit.delay * 1e6:.0f} us, beside the latency\n# and the loop's own sample, residual"
            f" {fit.residual:.2f} (1: noise alone).\n"
        )

    def metrics(self) -> dict[str, Any]:
        """Return the metrics of an identification for a JSON file.

        Keys without a model's name refer to the discrete model.
        """
        found, errors = self.found, self.errors
        discrete = errors.get("discrete")
        return {
            **fit_metrics(found.fit),
            "latency_samples": self.latency,
            "max_magnitude_error_db": discrete.magnitude_db if discrete else None,
            "max_phase_error_deg": discrete.phase_deg if discrete else None,
            "band_hz": list(self.band),
            "doubts": list(self.doubts),
            "outliers": {
                name: sum(trial.counters[sweeps.OUTLIERS] for trial in grip.trials)
                for name, grip in found.grips.items()
            },
            "physical_model": asdict(errors["physical"]) if errors else None,
            "grips": {name: fit_metrics(grip.fit) for name, grip in found.grips.items()},
            "approximate_model": asdict(found.approximate),
            "discrete_model": {
                "sections": found.discrete.sections.tolist(),
                "delay_samples": found.discrete.delay_samples,
                "rate_hz": found.discrete.rate,
            },
        }

    def figures(self, sweep: SweepParameters) -> dict[str, Figure]:
        """Return the paper's Figs. 4 and 5, and the coherence."""
        identified = next(iter(self.found.grips.values()))
        return {
            "fig4_sweep.png": sweep_plot(identified.trials[0], sweep),
            "fig5_models.png": model_plot(self.found),
            "coherence.png": coherence_plot(self.found),
        }


def model_errors(
    found: Identification,
    rig: RigParameters,
    sweep: sweeps.SweepParameters,
    band: tuple[float, float],
    on_arrival: bool,
) -> dict[str, ModelError]:
    """Compare the models with the response of the rig without noise, friction and converters.

    Parameters
    ----------
    found : Identification
    rig : RigParameters
        Simulated rig that was identified.
    sweep : SweepParameters
        Excitation of the comparison.
    band : tuple of float
        Lowest and highest frequency compared, Hz.
    on_arrival : bool
        True if forces took effect on arrival. Their age adds to the rig's own delay and is part of
        the models, so the identified delay is used as the true one.

    Returns
    -------
    dict of ModelError
        Largest errors of the models ``discrete`` and ``physical``.
    """
    master, rate = rig.master, found.discrete.rate
    delay = max(0.0, found.fit.delay) if on_arrival else master.drive.delay
    clean = replace(
        master,
        drive=replace(master.drive, coulomb_friction=0.0, bits=32, delay=delay),
        accelerometer=replace(master.accelerometer, noise_density=0.0, bits=32),
    )
    (trial,) = run_identification(clean, sweep, rate, latency=0)
    force, acceleration = (
        sweeps.kept_repeats(values, sweep, rate)
        for values in (trial.actuator_force, centred(trial.handle_acceleration))
    )
    true = dft_ratio(force, acceleration, rate, band, sweep.repeats - 1)
    errors = {}
    for name, response in (
        ("discrete", found.discrete.response(true.frequency)),
        ("physical", found.fit.response(true.frequency, rate)),
    ):
        ratio = response / true.response
        errors[name] = ModelError(
            float(np.max(np.abs(20 * np.log10(np.abs(ratio))))),
            float(np.max(np.abs(np.angle(ratio))) * (180 / math.pi)),
        )
    return errors


# Figures


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
        angle -= 360 * np.round((angle - near) / 360)  # within half a turn of the model's
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
    """Scale the frequency axis of a panel, and add a legend beside it."""
    frequency_axis(panel, *found.band, ends=True)
    rule(panel)
    look: Style = {"bbox_to_anchor": (1.01, 1.0), "frameon": False, "handlelength": 3.2}
    legend = panel.legend(handles=keys, loc="upper left", borderaxespad=0, **look)
    for text in legend.get_texts():
        text.set_parse_math(False)  # the name of a grip is arbitrary

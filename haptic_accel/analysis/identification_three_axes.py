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
"""Results of an identification with three coils: metrics, parameters, page and figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_accel.analysis import identification_result, plots
from haptic_accel.analysis.plots import Style, frequency_axis, rule
from haptic_accel.core.axes import ALL_AXES, NAMES
from haptic_accel.core.handle.plant import THREE_AXES
from haptic_accel.core.identification.fit import INTERVAL, HandleFit
from haptic_accel.core.identification.sweep import OUTLIERS, SweepParameters
from haptic_accel.core.identification.three_axes import COMPARED, WEAKEST, ThreeAxisIdentification
from haptic_accel.core.model import ACTUATOR, ComplexArray, FloatArray
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import master_response
from haptic_accel.setup.files import EVERY_NODE

ANISOTROPY = "anisotropy (largest over smallest singular value of the response)"
"""Condition number of a response at one frequency. That of the coils' directions, which
alone has a limit, is another number."""


@dataclass(frozen=True)
class ThreeAxisResult(identification_result.Result[ThreeAxisIdentification]):
    """Result of the identification of a handle with three coils.

    The error is that of the model ``plant``.
    """

    template = "identification_three_axes.html.j2"
    model_file = identification_result.MODEL_FILE
    names = NAMES

    @property
    def fits(self) -> Mapping[str, HandleFit]:
        """Fits by axis."""
        return self.found.fits

    @property
    def explained(self) -> str:
        """Sentence on the residuals of the fits."""
        residuals = ", ".join(f"{fit.residual:.3g} ({name})" for name, fit in self.fits.items())
        return (
            f"The residuals of the fits are {residuals} times the scatter of the data; noise alone"
            " gives about 1."
        )

    def beside_truth(
        self, rig: RigParameters, sweep: SweepParameters, on_arrival: bool
    ) -> ThreeAxisResult:
        """Return the result with the error of its plant."""
        del sweep  # the true response is known at each line
        plant = self.found.plant
        low, high = COMPARED
        lines = self.found.response.frequency
        frequency = lines[(lines >= low) & (lines <= high)]
        delay = float(np.mean([each.delay for each in plant.axes])) if on_arrival else None
        true = master_response(rig.master, frequency, plant.rate, delay)
        modelled = plant.response(frequency, plant.rate)
        return replace(self, errors={"plant": plant_error(modelled, true)})

    def sentences(self) -> Iterator[str]:
        """Yield the error against the true response, coherence, coupling and delays."""
        response = self.found.response
        for error in self.errors.values():
            yield (
                f"plant against the true response, {COMPARED[0]:g} to {COMPARED[1]:g} Hz, elements"
                f" within {-20 * math.log10(WEAKEST):g} dB of the coil's own: at most"
                f" {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
            )
        means = response.coherence.mean(axis=0)
        yield "multiple coherence: " + ", ".join(
            f"{name} {mean:.4f} on average" for name, mean in zip(NAMES, means, strict=True)
        )
        levels = response.cross_coupling
        axis, coil = np.unravel_index(np.argmax(levels - 1e9 * np.eye(3)), levels.shape)
        yield (
            f"cross-coupling: {levels[axis, coil]:.1f} dB at most, of coil {NAMES[coil]} with axis"
            f" {NAMES[axis]}; {ANISOTROPY}: {response.condition.max():.1f} at most; condition"
            f" number of the coils' directions: {self.found.plant.condition:.2g}"
        )
        delays = ", ".join(f"{fit.delay * 1e6:.0f} us ({name})" for name, fit in self.fits.items())
        yield (
            f"delay of the hardware: {delays}, in addition to the graph's latency of"
            f" {self.latency} samples"
        )

    @property
    def heading(self) -> str:
        """First lines of a parameter file."""
        response = self.found.response
        low, high = response.frequency[0], response.frequency[-1]
        return (
            "# A handle with three coils as identified; use with params_file:=FILE. SI units.\n"
            f"# Band {low:.4g} to {high:.4g} Hz, coupling of {self.found.plant.coupling.shape[2]}"
            f" samples at {response.rate:g} Hz.\n"
        )

    def parameters(self, age: float, model: Path) -> dict[str, dict[str, Any]]:
        """Return the parameters of each node that describe the handle."""
        del age  # nothing is told to a simulated device
        damping = float(np.mean([fit.handle.b_s for fit in self.fits.values()]))
        actuator = vars(self.actuator) | {"b_s": damping}
        plant = {"model": str(model), "doubt": "; ".join(self.doubts)}
        return {
            EVERY_NODE: {ACTUATOR: identification_result.plain(actuator)},
            "compensator": {"axes": ", ".join(ALL_AXES.names), "plant": plant},
        }

    def metrics(self) -> dict[str, Any]:
        """Return the metrics for a JSON file, whose key `THREE_AXES` the compensator reads."""
        response, plant = self.found.response, self.found.plant
        error = self.errors.get("plant")
        return {
            THREE_AXES: plant.as_document(),
            "axes": {name: _with_intervals(fit) for name, fit in self.fits.items()},
            "latency_samples": self.latency,
            "max_magnitude_error_db": error.magnitude_db if error else None,
            "max_phase_error_deg": error.phase_deg if error else None,
            "doubts": list(self.doubts),
            "outliers": sum(trial.counters[OUTLIERS] for trial in self.found.trials),
            "cross_coupling_db": response.cross_coupling.tolist(),
            "mean_coherence": response.coherence.mean(axis=0).tolist(),
            "response": {
                "frequency_hz": response.frequency.tolist(),
                "real": response.response.real.tolist(),
                "imaginary": response.response.imag.tolist(),
                "interval_half_width": (INTERVAL * response.deviation).tolist(),
                "coherence": response.coherence.tolist(),
                "condition": response.condition.tolist(),
            },
        }

    def figures(self, sweep: SweepParameters) -> dict[str, Figure]:
        """Return response, coherence and anisotropy."""
        del sweep
        return {
            "response.png": response_plot(self.found),
            "coherence.png": coherence_plot(self.found),
            "condition.png": condition_plot(self.found),
        }


def _with_intervals(fit: HandleFit) -> dict[str, Any]:
    """Return the metrics of a fit with 95 % intervals by parameter."""
    intervals = {
        name: [fit.value(name) - INTERVAL * error, fit.value(name) + INTERVAL * error]
        for name, error in fit.standard_errors.items()
    }
    return {**identification_result.fit_metrics(fit), "intervals": intervals}


def plant_error(modelled: ComplexArray, true: ComplexArray) -> identification_result.ModelError:
    """Return the largest errors of a plant's response, of the elements that are not too weak.

    Parameters
    ----------
    modelled, true : ndarray, shape (n, 3, 3)
        Responses at frequencies of `COMPARED`, m/s^2 per N.
    """
    own = np.abs(np.diagonal(true, axis1=1, axis2=2))[:, np.newaxis, :]
    ratio = (modelled / true)[np.abs(true) > WEAKEST * own]
    return identification_result.ModelError(
        float(np.max(np.abs(20 * np.log10(np.abs(ratio))))),
        float(np.max(np.abs(np.angle(ratio, deg=True)))),
    )


# Figures

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


def coherence_plot(found: ThreeAxisIdentification) -> Figure:
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

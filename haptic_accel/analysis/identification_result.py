# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of an identification with one or three coils: metrics, tables, figures and page."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

import numpy as np

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ALL_AXES, NAMES
from haptic_accel.core.handle.plant import THREE_AXES
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import dft_ratio
from haptic_accel.core.identification.evaluation import Identification, centred
from haptic_accel.core.identification.fit import INTERVAL, HandleFit
from haptic_accel.core.identification.sweep import OUTLIERS, SweepParameters
from haptic_accel.core.identification.three_axes import COMPARED, WEAKEST, ThreeAxisIdentification
from haptic_accel.core.model import (
    ACTUATOR,
    ComplexArray,
    HandleParameters,
    MountParameters,
    Suspension,
)
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.tables import DASH, ResultTable, number
from haptic_accel.core.trial import master_response, run_identification
from haptic_accel.pages import write
from haptic_accel.setup.files import EVERY_NODE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PARAMETER_FILE = "handle.yaml"
"""Name of the parameter file to which the page refers."""

MODEL_FILE = "identification.json"
"""Name of the metrics file that the compensator reads."""

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

    @classmethod
    def of(cls, ratio: ComplexArray) -> ModelError:
        """Return the largest errors of ratios of a modelled to a true response."""
        magnitude, phase = 20 * np.log10(np.abs(ratio)), np.angle(ratio, deg=True)
        return cls(float(np.max(np.abs(magnitude))), float(np.max(np.abs(phase))))


LOWEST_COMPARED = 15.0
"""Frequency below which the compensator's high-pass blocks the signal (paper), Hz."""

HIGHEST_COMPARED = 400.0
"""Frequency above which the true response is below the accelerometer's noise, Hz."""

POOLED = "all grips"
"""Heading of the fit to all trials of several grips."""

POOLED_NOTE = (
    "models of all grips pooled are a compromise between them, the discrete model most of all; for"
    " the best model of one grip, identify that grip alone"
)
"""Note on a page for a handle held with several grips."""


Found = TypeVar("Found", Identification, ThreeAxisIdentification)


@dataclass(frozen=True)
class _Result(Generic[Found]):
    """Result of an identification.

    Attributes
    ----------
    found : Identification or ThreeAxisIdentification
    actuator : ActuatorParameters
        Actuator of each axis before the identification.
    latency : int
        Latency of the recordings, samples.
    doubts : sequence of str
        Warnings about the fits, one line each.
    truth : HandleParameters or None
        Parameters of a simulated handle with one coil, if known.
    errors : mapping of ModelError
        Errors by model; empty if the true response is unknown.
    """

    found: Found
    actuator: ActuatorParameters
    latency: int
    doubts: Sequence[str]
    truth: HandleParameters | None = None
    errors: Mapping[str, ModelError] = field(default_factory=dict)

    template: ClassVar[str]
    """Template of the page."""

    model_file = ""
    """Name of the metrics file that the parameter file refers to; empty if none."""

    @property
    def notes(self) -> list[str]:
        """Warnings for readers of the metrics."""
        return [*self.doubts, *self.found.outliers]

    @property
    def moving_mass(self) -> float | None:
        """Mass of the handle without the actuator, kg; None for several axes."""
        return None


@dataclass(frozen=True)
class OneAxisResult(_Result[Identification]):
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
        """Warnings for readers of the metrics."""
        return super().notes + [POOLED_NOTE] * (len(self.found.grips) > 1)

    @property
    def fits(self) -> dict[str, HandleFit]:
        """Fit of each grip and, for several grips, of all grips together."""
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

    def with_errors(
        self, rig: RigParameters, sweep: SweepParameters, on_arrival: bool
    ) -> OneAxisResult:
        """Return the result with the errors of its models against the simulated rig.

        Parameters
        ----------
        rig : RigParameters
        sweep : SweepParameters
            Excitation of the comparison.
        on_arrival : bool
            True if forces took effect on arrival. The forces' age adds to the rig's own delay and
            is part of the models, so the identified delay counts as the true one.
        """
        errors = model_errors(self.found, rig, sweep, self.band, on_arrival)
        return replace(self, truth=rig.master.handle, errors=errors)

    def sentences(self) -> Iterator[str]:
        """Yield sentences on errors against the true response, and on the hardware's delay."""
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
        """Return the parameters of each node that describe the handle, and its controllers.

        The compensator reports the fits' warnings.

        Parameters
        ----------
        age : float
            Age of forces applied on arrival, s. A controller compensates it, as part of the delay,
            but it is not part of the simulated handle's own delay.
        model : Path
            File of the metrics, from which a compensator of several axes reads its plant.
        """
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
        from haptic_accel.analysis import identification_plots as plots

        identified = next(iter(self.found.grips.values()))
        return {
            "fig4_sweep.png": plots.sweep_plot(identified.trials[0], sweep),
            "fig5_models.png": plots.model_plot(self.found),
            "coherence.png": plots.coherence_plot(self.found),
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
        True if forces took effect on arrival. The forces' age adds to the rig's own delay and is
        part of the models, so the identified delay counts as the true one.

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
    return {
        "discrete": ModelError.of(found.discrete.response(true.frequency) / true.response),
        "physical": ModelError.of(found.fit.response(true.frequency, rate) / true.response),
    }


@dataclass(frozen=True)
class ThreeAxisResult(_Result[ThreeAxisIdentification]):
    """Result of the identification of a handle with three coils.

    The error is that of the model ``plant``.
    """

    template = "identification_three_axes.html.j2"
    model_file = MODEL_FILE
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

    def with_errors(
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
        """Yield sentences on the model error, coherence, coupling and delays."""
        from haptic_accel.analysis.identification_plots import ANISOTROPY

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
            f" {NAMES[axis]}; {ANISOTROPY}: {response.condition.max():.1f} at most;"
            f" condition number of the coils' directions: {self.found.plant.condition:.2g}"
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
        del age  # a simulated device has no parameter for the age
        damping = float(np.mean([fit.handle.b_s for fit in self.fits.values()]))
        actuator = vars(self.actuator) | {"b_s": damping}
        plant = {"model": str(model), "doubt": "; ".join(self.doubts)}
        return {
            EVERY_NODE: {ACTUATOR: plain(actuator)},
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
        from haptic_accel.analysis import identification_plots as plots

        del sweep
        return {
            "response.png": plots.response_plot(self.found),
            "coherence.png": plots.multiple_coherence_plot(self.found),
            "condition.png": plots.condition_plot(self.found),
        }


def _with_intervals(fit: HandleFit) -> dict[str, Any]:
    """Return the metrics of a fit with 95 % intervals by parameter."""
    intervals = {
        name: [fit.value(name) - INTERVAL * error, fit.value(name) + INTERVAL * error]
        for name, error in fit.standard_errors.items()
    }
    return {**fit_metrics(fit), "intervals": intervals}


def plant_error(modelled: ComplexArray, true: ComplexArray) -> ModelError:
    """Return the largest errors of a plant's response, without elements that are too weak.

    Parameters
    ----------
    modelled, true : ndarray, shape (n, 3, 3)
        Responses at frequencies of `COMPARED`, m/s^2 per N.
    """
    own = np.abs(np.diagonal(true, axis1=1, axis2=2))[:, np.newaxis, :]
    return ModelError.of((modelled / true)[np.abs(true) > WEAKEST * own])


# Figures


Result: TypeAlias = OneAxisResult | ThreeAxisResult
"""Result of an identification with one coil, or with three."""


def write_report(
    result: Result, folder: Path, sweep: SweepParameters, settings: Mapping[str, str]
) -> Path:
    """Write a self-contained page with parameters, models and plots; return its path.

    Parameters
    ----------
    folder : Path
        Folder, created if necessary. The page refers to a file ``handle.yaml`` in it. The plots
        are also saved in the folder.
    sweep : SweepParameters
        Excitation of the handle.
    settings : mapping of str to str
        Arguments of the run, shown as a table.
    """
    folder.mkdir(parents=True, exist_ok=True)
    index = folder / "index.html"
    write(
        index,
        result.template,
        result=result,
        found=result.found,
        settings=settings,
        columns=list(result.fits),
        parameters=parameter_rows(result.fits, result.truth),
        simulated=result.truth is not None,
        number=number,
        parameter_file=PARAMETER_FILE,
        pictures=pictures(result.figures(sweep), folder),
    )
    return index


# Tables


@dataclass(frozen=True)
class Row:
    """Row of the parameter table: true value, and value and error of each fit."""

    name: str
    text: str
    unit: str
    true: str
    cells: list[tuple[str, str]]


def _quantities() -> Iterator[tuple[str, str, str, float]]:
    """Yield name, label, unit, and factor to that unit of all quantities that may be fitted."""
    for name, (_, quantity) in own_schema(HandleParameters).items():
        yield name, quantity.text, quantity.unit, 1.0
    yield "friction", "dry friction of the actuator's bearing", "N", 1.0
    yield (
        "delay",
        "delay of the hardware, in addition to latency, hold and one sample",
        "µs",
        MICROSECONDS,
    )
    for name, (_, quantity) in own_schema(MountParameters).items():
        yield f"mount_{name}", "mount of the accelerometer", quantity.unit or "1", 1.0


def parameter_rows(
    by_column: Mapping[str, HandleFit], truth: HandleParameters | None
) -> list[Row]:
    """Return the table of fitted and known parameters.

    Parameters
    ----------
    by_column : mapping of str to HandleFit
        Fits, one per column.
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
                "unit": quantity.unit,
            }
            for name, (_, quantity) in own_schema(HandleParameters).items()
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
    """Round numbers to six digits for a parameter file."""
    return {name: float(f"{value:.6g}") for name, value in values.items()}


# Figures of a page

_DPI = 130  # pixels per inch
_CSS_DPI = 96  # pixels per inch of a page
_DIGITS = 5  # significant digits of a value with unknown error
_MOST_DIGITS = 7  # maximum, for a very small error
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

"""``haptic-accel identify``: from the paper's sweep to a parameter file for one's own handle."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from haptic_accel.core.identification import (
    DEFAULT_FREE,
    MOUNT,
    DiscreteModel,
    FrequencyResponse,
    HandleFit,
    IdentificationTrial,
    RecordingError,
    SweepParameters,
    approximate_model,
    check_recording,
    dft_ratio,
    fit_handle,
    identify_discrete,
    kept_repeats,
    run_identification,
)
from haptic_accel.core.model import (
    ApproximateModel,
    ComplexArray,
    FloatArray,
    HandleParameters,
    handle_model,
)
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.rig.master_rig import MasterRigParameters, StructureParameters, held
from haptic_accel.startup.arguments import parse_arguments
from haptic_accel.startup.graph import graph_parameters, rig_parameters
from haptic_accel.startup.process import DONE, FAILED
from haptic_accel.tools.experiment import check_writable, make_folder

ORDER = 7
"""Of the discrete model: eq. (3) has 4, the accelerometer 1, its mount 2."""

LOWEST_COMPARED = 15.0
"""Below it the compensator's high-pass lets nothing through (paper), Hz."""

UNEXPLAINED = 2.0
"""Residual, in standard deviations of the noise, above which a model is said to lack something."""

MOUNT_START = StructureParameters(frequency=280.0, damping=0.15)
"""Where the search for a mode of the accelerometer's mount starts, as on the paper's rig."""

MASS_LIKE = 60.0
"""Between suspension and structure, where handles are little more than their mass, Hz."""

POINTS = 400
"""Frequencies at which models are drawn."""

DEGREES = 180 / math.pi


@dataclass(frozen=True)
class Identification:
    """What was found of a handle.

    Attributes
    ----------
    responses : list of FrequencyResponse
        The paper's DFT ratio of each trial.
    fit : HandleFit
        Physical parameters, all trials pooled.
    discrete : DiscreteModel
        What a compensator can use where physics does not explain all.
    approximate : ApproximateModel
        The paper's kind of invertible model.
    band : tuple of float
        Of the sweep, Hz.
    """

    responses: list[FrequencyResponse]
    fit: HandleFit
    discrete: DiscreteModel
    approximate: ApproximateModel
    band: tuple[float, float]


@dataclass(frozen=True)
class ModelError:
    """Largest differences of a model's response from the true one over a band."""

    magnitude_db: float
    phase_deg: float


def identify(
    words: Sequence[str],
    *,
    lockstep: bool,
    trials: int,
    sweep: SweepParameters,
    json_file: Path | None,
    out: Path | None,
) -> int:
    """Run the paper's procedure, fit, and write parameter file, figures and numbers.

    Parameters
    ----------
    words : sequence of str
        Arguments of the graph as ``key:=value``: rig, rate, seed and config count.
    lockstep : bool
        Without ROS, on the simulated handle.
    trials : int
        Each from rest; pooled.
    sweep : SweepParameters
        The excitation.
    json_file, out : Path, optional
        Where to write figures, and everything else.
    """
    if not lockstep:
        raise ParameterError("identify: only with --lockstep, on the simulated handle")
    arguments = parse_arguments(words)
    parameters = rig_parameters(graph_parameters(arguments)).master
    rig = _of_one_user(parameters, arguments.seed)
    folder = out or Path("results") / f"identify_{datetime.now():%Y-%m-%d_%H-%M-%S}"
    make_folder(folder)
    if json_file:
        check_writable(json_file)
    recorded = run_identification(rig, sweep, arguments.rate, arguments.seed, trials)
    try:
        found = evaluate(recorded, sweep, rig.accelerometer.range, rig.accelerometer.bandwidth)
    except RecordingError as reason:
        print(f"haptic-accel: {reason}", file=sys.stderr)
        return FAILED
    # Not beyond what was excited, nor where the true response lies in the accelerometer's noise.
    band = max(LOWEST_COMPARED, sweep.start_frequency), min(0.9 * sweep.end_frequency, 400.0)
    errors = _errors(found, rig, sweep, arguments.rate, band)
    (folder / "handle.yaml").write_text(parameter_file(found), encoding="utf-8")
    _draw_sweep(recorded[0], sweep).savefig(folder / "fig4_sweep.png", dpi=120)
    _draw_models(found, arguments.rate).savefig(folder / "fig5_models.png", dpi=120)
    if json_file:
        figures = _figures(found, errors, band)
        json_file.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    _print(found, rig.handle, errors, band)
    if any(trial.status["travel_stops_hit"] for trial in recorded):
        print("the actuator hit its stops: use a smaller amplitude, do not use the fit")
    print(f"parameters: {folder / 'handle.yaml'}")
    return DONE


def _print(
    found: Identification,
    truth: HandleParameters,
    errors: dict[str, ModelError],
    band: tuple[float, float],
) -> None:
    Console().print(_table(found, truth))
    for name, error in errors.items():
        print(
            f"{name} model against the true response, {band[0]:g} to {band[1]:g} Hz: at most"
            f" {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
        )
    if found.fit.residual > UNEXPLAINED:
        print(
            f"the physical model leaves {found.fit.residual:.1f} times the noise unexplained, of"
            " which its standard errors know nothing"
        )


def evaluate(
    recorded: Sequence[IdentificationTrial],
    sweep: SweepParameters,
    acceleration_range: float,
    bandwidth: float,
) -> Identification:
    """Estimate, fit and choose models from recordings of one handle held in one way.

    Parameters
    ----------
    recorded : sequence of IdentificationTrial
    sweep : SweepParameters
        What excited the handle.
    acceleration_range, bandwidth : float
        Of the accelerometer, m/s^2 either way and Hz.

    Raises
    ------
    RecordingError
        A recording is of no use, and why.
    """
    responses = []
    for trial in recorded:
        force = kept_repeats(trial.actuator_force, sweep, trial.rate)
        acceleration = kept_repeats(trial.handle_acceleration, sweep, trial.rate)
        check_recording(force, acceleration, trial.rate, sweep.band, acceleration_range)
        responses.append(dft_ratio(force, acceleration, trial.rate, sweep.band, sweep.repeats - 1))
    fit = _fitted(responses, bandwidth)
    first = recorded[0]
    discrete = identify_discrete(
        np.concatenate([trial.actuator_force for trial in recorded]),
        np.concatenate([_centred(trial.handle_acceleration) for trial in recorded]),
        ORDER,
        first.rate,
    )
    return Identification(responses, fit, discrete, approximate_model(fit.handle), sweep.band)


def _fitted(responses: Sequence[FrequencyResponse], bandwidth: float) -> HandleFit:
    """Fit the handle alone; where that leaves much unexplained, with a mode of the mount too."""
    rigid = fit_handle(responses, low_pass_frequency=bandwidth)
    if rigid.residual <= UNEXPLAINED:
        return rigid
    free = (*DEFAULT_FREE, *MOUNT)
    moving = fit_handle(responses, free=free, mount=MOUNT_START, low_pass_frequency=bandwidth)
    return moving if moving.residual < rigid.residual / 2 else rigid


def parameter_file(found: Identification) -> str:
    """Return a ROS parameter file that ``config:=FILE`` takes: the handle and its controllers."""
    handle, fit = asdict(found.fit.handle), found.fit
    content = {
        "master_device": {
            "ros__parameters": {
                "simulated": {
                    "handle": _plain(handle),
                    "structure": _plain(asdict(fit.mount)),
                    "actuator": {"delay": float(f"{max(0.0, fit.delay):.6f}")},
                }
            }
        },
        "compensator": {
            "ros__parameters": {
                "constant": _plain({"mass": fit.handle.m_h}),
                "dynamic": _plain(asdict(found.approximate)),
            }
        },
    }
    head = (
        "# A handle as identified; use with config:=FILE. SI units.\n"
        f"# Band {fit.band[0]:.4g} to {fit.band[1]:.4g} Hz, delay {fit.delay * 1e6:.0f} us beside"
        f" the loop's own sample,\n# residual {fit.residual:.2f} (1: noise alone).\n"
    )
    return head + yaml.safe_dump(content, sort_keys=False)


def _plain(values: dict[str, Any]) -> dict[str, float]:
    return {name: float(f"{value:.6g}") for name, value in values.items()}


def _of_one_user(rig: MasterRigParameters, seed: int) -> MasterRigParameters:
    """Return the rig with the grip of one user, whatever the seeds of the noise."""
    handle = held(rig.handle, rig.grip, seed)
    return replace(rig, handle=handle, grip=replace(rig.grip, variation=0.0))


def _centred(values: FloatArray) -> FloatArray:
    return np.asarray(values - values.mean())


def _errors(
    found: Identification,
    rig: MasterRigParameters,
    sweep: SweepParameters,
    rate: float,
    band: tuple[float, float],
) -> dict[str, ModelError]:
    """Compare models with what the rig does without noise, friction and converters."""
    clean = replace(
        rig,
        actuator=replace(rig.actuator, coulomb_friction=0.0, bits=32),
        accelerometer=replace(rig.accelerometer, noise_density=0.0, bits=32),
    )
    (trial,) = run_identification(clean, sweep, rate)
    truth = dft_ratio(
        kept_repeats(trial.actuator_force, sweep, rate),
        kept_repeats(_centred(trial.handle_acceleration), sweep, rate),
        rate,
        band,
        sweep.repeats - 1,
    )
    models = {
        "discrete": found.discrete.response(truth.frequency),
        "physical": found.fit.response(truth.frequency, rate),
    }
    return {name: _error(response, truth.response) for name, response in models.items()}


def _error(response: ComplexArray, truth: ComplexArray) -> ModelError:
    ratio = response / truth
    return ModelError(
        float(np.max(np.abs(20 * np.log10(np.abs(ratio))))),
        float(np.max(np.abs(np.angle(ratio))) * DEGREES),
    )


def _figures(
    found: Identification, errors: dict[str, ModelError], band: tuple[float, float]
) -> dict[str, Any]:
    """Return the figures for a JSON file; the discrete model is what the errors are of."""
    units = {name: given.unit for name, (_, given) in schema(HandleParameters).items()}
    values = asdict(found.fit.handle)
    return {
        "parameters": {
            name: {
                "value": value,
                "standard_error": found.fit.standard_errors.get(name),
                "unit": units[name],
            }
            for name, value in values.items()
        },
        "delay_s": found.fit.delay,
        "delay_standard_error_s": found.fit.standard_errors.get("delay"),
        "max_magnitude_error_db": errors["discrete"].magnitude_db,
        "max_phase_error_deg": errors["discrete"].phase_deg,
        "band_hz": list(band),
        "physical_model": asdict(errors["physical"]),
        "mount": asdict(found.fit.mount),
        "residual": found.fit.residual,
        "approximate_model": asdict(found.approximate),
        "discrete_model": {
            "sections": found.discrete.sections.tolist(),
            "delay_samples": found.discrete.delay_samples,
            "rate_hz": found.discrete.rate,
        },
    }


def _table(found: Identification, truth: HandleParameters) -> Table:
    table = Table(title="the handle, all trials pooled")
    for heading in ("", "found", "standard error", "true", "unit"):
        table.add_column(heading, justify="right" if heading else "left")
    true = asdict(truth)
    for name, (_, given) in schema(HandleParameters).items():
        error = found.fit.standard_errors.get(name)
        table.add_row(
            name,
            f"{getattr(found.fit.handle, name):.4g}",
            "known" if error is None else f"{error:.2g}",
            f"{true[name]:.4g}",
            given.unit,
        )
    mount = asdict(found.fit.mount)
    for name, unit in (("frequency", "Hz"), ("damping", "")):
        error = found.fit.standard_errors.get(f"mount_{name}")
        if error is not None:
            table.add_row(f"mount's {name}", f"{mount[name]:.4g}", f"{error:.2g}", "", unit)
    delay_error = found.fit.standard_errors.get("delay", math.nan)
    table.add_row("delay", f"{found.fit.delay * 1e6:.1f}", f"{delay_error * 1e6:.2g}", "", "us")
    return table


def _draw_sweep(trial: IdentificationTrial, sweep: SweepParameters) -> Figure:
    """Draw force and acceleration over time, the paper's Fig. 4."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    force, acceleration = figure.subplots(2, 1, sharex=True)
    time = np.arange(len(trial.actuator_force)) / trial.rate
    force.plot(time, trial.actuator_force, linewidth=0.5)
    acceleration.plot(time, trial.handle_acceleration, linewidth=0.5)
    for panel, label in (
        (force, "actuator force (N)"),
        (acceleration, "handle acceleration (m/s²)"),
    ):
        panel.set_ylabel(label)
        panel.axvspan(0, sweep.duration, color="0.9", label="not evaluated")
        panel.grid(alpha=0.3)
    force.legend(loc="upper right")
    acceleration.set_xlabel("time (s)")
    return figure


def _draw_models(found: Identification, rate: float) -> Figure:
    """Draw magnitude and phase of data and models, the paper's Fig. 5."""
    figure = Figure(figsize=(10, 8), layout="constrained")
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    for index, data in enumerate(found.responses):
        label = "data (DFT ratio)" if index == 0 else ""
        _draw_response(magnitude, phase, data.frequency, data.response, label, "0.75", 1)
    low, high = found.band
    frequency = np.geomspace(low, min(high, 0.499 * rate), POINTS)
    mass = np.full(len(frequency), 1 / found.fit.handle.m_h, dtype=np.complex128)
    for label, response, color in (
        ("full model, as sampled", found.fit.response(frequency, rate), "C0"),
        ("discrete model", found.discrete.response(frequency), "C3"),
        ("eq. (3) alone", handle_model(found.fit.handle).response(frequency), "C2"),
        ("approximate model", found.approximate.model().response(frequency), "C1"),
        ("mass model", mass, "C4"),
    ):
        _draw_response(magnitude, phase, frequency, response, label, color, 1.6)
    magnitude.set_ylabel("acceleration over force (m/s² per N)")
    magnitude.set_xscale("log")
    magnitude.set_yscale("log")
    phase.set_ylabel("phase (degrees)")
    phase.set_xlabel("frequency (Hz)")
    magnitude.legend()
    for panel in (magnitude, phase):
        panel.grid(alpha=0.3, which="both")
    return figure


def _draw_response(
    magnitude: Axes,
    phase: Axes,
    frequency: FloatArray,
    response: ComplexArray,
    label: str,
    color: str,
    width: float,
) -> None:
    magnitude.plot(frequency, np.abs(response), color=color, label=label, linewidth=width)
    unwrapped = np.unwrap(np.angle(response)) * DEGREES
    # Whole turns say nothing: all curves are near zero where the handle is a mass.
    middle = int(np.searchsorted(frequency, MASS_LIKE))
    unwrapped -= 360 * np.round(unwrapped[min(middle, len(unwrapped) - 1)] / 360)
    phase.plot(frequency, unwrapped, color=color, linewidth=width)

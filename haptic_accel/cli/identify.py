"""``haptic-accel identify``: from the paper's sweep to a parameter file for one's own handle."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from haptic_accel.analysis.identification_report import ModelError, write_identification_report
from haptic_accel.bags.excitation import read_excited, read_force_age
from haptic_accel.cli.options import (
    Verb,
    json_option,
    listed_words,
    lockstep_option,
    out_option,
    word_options,
    words,
)
from haptic_accel.cli.output import results_folder
from haptic_accel.cli.running import StopOnSignal, conclude, progress_bar
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.identification.estimate import FrequencyResponse, RecordingError, dft_ratio
from haptic_accel.core.identification.evaluation import (
    UNEXPLAINED,
    Identification,
    centred,
    identify_handle,
)
from haptic_accel.core.identification.fit import DEFAULT_FREE, HandleFit
from haptic_accel.core.identification.sweep import (
    SAMPLES_MISSING,
    IdentificationTrial,
    SweepParameters,
    find_trials,
    kept_repeats,
)
from haptic_accel.core.model import (
    ACTUATOR,
    POSTURES,
    AccelerometerParameters,
    ComplexArray,
    HandleParameters,
    Suspension,
    held,
)
from haptic_accel.core.parameters import ParameterError, own_schema, schema
from haptic_accel.core.process import DONE, FAILED, INTERRUPTED
from haptic_accel.core.trial import RigParameters, run_identification
from haptic_accel.devices.recordings import read_recording
from haptic_accel.graph.arguments import AVERAGE_GRIP, SIMULATED, IdentifyArguments
from haptic_accel.graph.node_parameters import node_parameters
from haptic_accel.graph.processes import graph_parameters, identification_graph
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.graph.words import parse_words

LOWEST_COMPARED = 15.0
"""Below it the compensator's high-pass lets nothing through (paper), Hz."""

HIGHEST_COMPARED = 400.0
"""Above it the true response lies in the accelerometer's noise, Hz."""

MOST_MISSING = 0.01
"""Share of its samples that a trial can do without (assumed)."""

COLUMNS = ("actuator_force", "handle_acceleration")
"""Columns of a CSV file, N and m/s^2."""

DEGREES = 180 / math.pi

Recorded = dict[str, list[IdentificationTrial]]
"""Trials by the name of the grip."""


class _StoppedError(Exception):
    """The procedure did not come to its end, which has been shown; the exit status."""

    def __init__(self, status: int) -> None:
        super().__init__(f"status {status}")
        self.status = status


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel identify --lockstep --grips pinch,hook",
        "haptic-accel identify master:=serial config:=mine.yaml",
        "haptic-accel identify --from results/identify/bag",
    ],
)
@words(IdentifyArguments)
@lockstep_option
@click.option(
    "--grips",
    type=listed_words,
    default="",
    show_default=False,
    metavar="GRIP,GRIP,...",
    help="Grips to hold the handle with, one after the other; fitted separately and pooled.",
)
@click.option(
    "--from",
    "sources",
    multiple=True,
    metavar="[GRIP=]FILE",
    help="Bag of an identification, or CSV file with columns"
    f" {' and '.join(COLUMNS)}, to evaluate in place of a run; may be given many times.",
)
@click.option(
    "--recording-rate",
    type=float,
    default=0.0,
    metavar="HZ",
    help="Sampling rate of the CSV files, Hz.",
)
@click.option(
    "--free",
    type=listed_words,
    default=",".join(DEFAULT_FREE),
    metavar="NAME,NAME,...",
    help="Parameters of the model to fit.",
)
@word_options([*schema(SweepParameters), "trials", "rig"])
@json_option
@out_option
def identify(
    words: Sequence[str],
    *,
    lockstep: bool,
    grips: Sequence[str],
    sources: Sequence[str],
    recording_rate: float,
    free: Sequence[str],
    json_file: Path | None,
    out: Path | None,
) -> int:
    """Excite the handle with the paper's sweep and fit its model.

    Writes a parameter file for config:=FILE, and the paper's figures 4 and 5.
    """
    arguments = parse_words(words, IdentifyArguments)
    grips = _checked_grips(grips, arguments)
    if lockstep and arguments.master != SIMULATED:
        raise ParameterError(f"master = {arguments.master!r}: with --lockstep must be simulated")
    if lockstep and sources:
        raise ParameterError("from: not with --lockstep, which makes its own recordings")
    for grip in grips:
        identification_graph(replace(arguments, grip=grip))  # everything wrong is found first
    folder = results_folder(out, "identify_")
    try:
        if sources:
            recorded = _read(sources, arguments, recording_rate)
        elif lockstep:
            recorded = _run_lockstep(arguments, grips)
        else:
            recorded = _run_live(arguments, grips, folder)
        actuator, sensor = _bench(arguments)
        found = identify_handle(
            recorded,
            arguments.sweep,
            sensor.range,
            sensor.bandwidth,
            known=HandleParameters(
                m_a=actuator.m_a, k_s=actuator.k_s, b_s=actuator.b_s or HandleParameters.b_s
            ),
            free=free,
        )
    except RecordingError as reason:
        print(f"haptic-accel: {reason}", file=sys.stderr)
        return FAILED
    except _StoppedError as stopped:
        return stopped.status
    paths = [Path(source.rpartition("=")[2]) for source in sources]
    if not (lockstep or sources):
        paths = [_bag(arguments, grip, grips, folder) for grip in grips]
    ages = [read_force_age(path) for path in paths if path.is_dir()]
    age = fmean(ages) if ages else 0.0
    _conclude(found, actuator, arguments, lockstep, sources, age, folder, json_file)
    return DONE


def _checked_grips(grips: Sequence[str], arguments: IdentifyArguments) -> list[str]:
    for grip in grips:
        if grip not in POSTURES:
            raise ParameterError(f"grips = {grip!r}: must be among {', '.join(POSTURES)}")
    if len(set(grips)) < len(grips):
        raise ParameterError(f"grips = {', '.join(grips)}: must hold each grip once")
    return list(grips) or [arguments.grip]


def _bench(
    arguments: IdentifyArguments,
) -> tuple[ActuatorParameters, AccelerometerParameters]:
    """Return what is known of actuator and accelerometer."""
    _, known = node_parameters("identifier", graph_parameters(arguments)["identifier"])
    return known[ACTUATOR], known["accelerometer"]


# Recordings


def _run_lockstep(arguments: IdentifyArguments, grips: Sequence[str]) -> Recorded:
    return {
        grip: run_identification(
            _rig(replace(arguments, grip=grip)).master,
            arguments.sweep,
            arguments.rate,
            arguments.seed,
            arguments.trials,
        )
        for grip in grips
    }


def _run_live(arguments: IdentifyArguments, grips: Sequence[str], folder: Path) -> Recorded:
    """Run the graph once for each grip, and read its bags."""
    recorded: Recorded = {}
    bags = {grip: _bag(arguments, grip, grips, folder) for grip in grips}
    for grip, bag in bags.items():
        _ask_for(grip, arguments, len(grips))
        _run_graph(replace(arguments, grip=grip, bag=str(bag)))
        recorded[grip] = _trials(bag, arguments)
    return recorded


def _trials(bag: Path, arguments: IdentifyArguments) -> list[IdentificationTrial]:
    """Return a bag's trials, without those of which too much is missing.

    Raises
    ------
    RecordingError
        None is left.
    """
    force, acceleration, missing = read_excited(bag, arguments.rate)
    found = find_trials(force, acceleration, arguments.sweep, arguments.rate, missing)
    most = MOST_MISSING * len(found[0].actuator_force)
    whole = [trial for trial in found if trial.status[SAMPLES_MISSING] <= most]
    if len(whole) < len(found):
        counts = ", ".join(str(trial.status[SAMPLES_MISSING]) for trial in found)
        reason = (
            f"{bag}: {len(found) - len(whole)} of {len(found)} trials left out, of which more than"
            f" {100 * MOST_MISSING:g} % of the samples are missing ({counts})"
        )
        if not whole:
            raise RecordingError(reason)
        print(reason, file=sys.stderr)
    return whole


def _bag(arguments: IdentifyArguments, grip: str, grips: Sequence[str], folder: Path) -> Path:
    if arguments.bag:
        return Path(arguments.bag) / grip if len(grips) > 1 else Path(arguments.bag)
    return folder / "bags" / grip


def _ask_for(grip: str, arguments: IdentifyArguments, count: int) -> None:
    """Let a person take the handle; a simulated hand needs no time."""
    if arguments.master != SIMULATED and count > 1 and sys.stdin.isatty():
        input(f"hold the handle with the {grip} grip, then press Enter")


def _run_graph(arguments: IdentifyArguments) -> None:
    sweep = arguments.sweep
    repeats = arguments.trials * sweep.repeats
    with (
        StopOnSignal() as stop,
        progress_bar() as progress,
    ):
        task = progress.add_task(f"{arguments.grip} grip: starting", total=repeats)

        def follow(executable: str, line: str) -> None:
            if executable == "identifier" and "trial " in line:
                # As the node says it: "trial 2 of 4, repeat 3 of 3".
                told = line[line.rindex("trial ") :]
                trial, repeat = int(told.split()[1]), int(told.split()[5])
                done = (trial - 1) * sweep.repeats + repeat - 1
                progress.update(task, description=f"{arguments.grip} grip: {told}", completed=done)
                if not progress.console.is_terminal:
                    progress.console.print(f"{arguments.grip} grip: {told}", highlight=False)

        outcome = Supervisor(identification_graph(arguments), on_line=follow).run(stop)
        if outcome.first and outcome.status == 0:
            progress.update(task, completed=repeats, description=f"{arguments.grip} grip: done")
    if not outcome.first:
        print(f"interrupted; recorded so far: {arguments.bag}", file=sys.stderr)
        raise _StoppedError(INTERRUPTED)
    status = conclude(outcome)
    if status != DONE:
        raise _StoppedError(status)


def _read(sources: Sequence[str], arguments: IdentifyArguments, recording_rate: float) -> Recorded:
    """Read trials from bags and CSV files."""
    recorded: Recorded = {}
    for source in sources:
        grip, separator, path = source.partition("=")
        if not separator:
            grip, path = arguments.grip, source
        if Path(path).is_dir():
            trials = _trials(Path(path), arguments)
        else:
            rate = recording_rate or arguments.rate
            force, acceleration = (
                read_recording(path, rate, rate, column=column) for column in COLUMNS
            )
            trials = find_trials(force, acceleration, arguments.sweep, rate)
        recorded.setdefault(grip, []).extend(trials)
    rates = {trial.rate for trials in recorded.values() for trial in trials}
    if len(rates) > 1:
        raise ParameterError(f"from: recordings of {len(rates)} rates, must be of one")
    return recorded


def _rig(arguments: IdentifyArguments) -> RigParameters:
    """Return the simulated master as one user holds it, whatever the seeds of the noise."""
    _, devices = node_parameters("master_device", graph_parameters(arguments)["master_device"])
    master = RigParameters(devices[SIMULATED]).master
    handle = held(master.handle, master.grip, arguments.seed)
    grip = replace(master.grip, variation=0.0, posture=AVERAGE_GRIP)
    return RigParameters(replace(master, handle=handle, grip=grip))


# Results


def _conclude(
    found: Identification,
    actuator: ActuatorParameters,
    arguments: IdentifyArguments,
    lockstep: bool,
    sources: Sequence[str],
    age: float,
    folder: Path,
    json_file: Path | None,
) -> None:
    sweep, rate = arguments.sweep, found.discrete.rate
    band = (
        max(LOWEST_COMPARED, sweep.start_frequency),
        min(0.9 * sweep.end_frequency, HIGHEST_COMPARED),
    )
    truth, errors = None, {}
    grips = list(found.grips)
    if arguments.master == SIMULATED and not sources and len(grips) == 1:
        rig = _rig(replace(arguments, grip=grips[0]))
        truth, errors = rig.master.handle, _errors(found, rig, sweep, rate, band, lockstep)
    notes = _notes(found)
    (folder / "handle.yaml").write_text(parameter_file(found, actuator, age), encoding="utf-8")
    index = write_identification_report(
        found,
        sweep,
        folder,
        settings=_settings(arguments, lockstep, sources),
        truth=truth,
        errors=errors,
        band=band,
        notes=notes,
    )
    if json_file:
        figures = _figures(found, errors, band)
        json_file.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    console = Console()
    console.print(_table(found, truth))
    for name, error in errors.items():
        print(
            f"{name} model against the true response, {band[0]:g} to {band[1]:g} Hz: at most"
            f" {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
        )
    for note in notes:
        print(note)
    if found.fit.residual > UNEXPLAINED:
        print(
            f"the physical model leaves {found.fit.residual:.1f} times the noise unexplained, of"
            " which its standard errors know nothing"
        )
    print(f"parameters: {folder / 'handle.yaml'}")
    print(f"report: {index}")


def _settings(
    arguments: IdentifyArguments, lockstep: bool, sources: Sequence[str]
) -> dict[str, str]:
    run = "lockstep" if lockstep else "live graph"
    given = {name: str(value) for name, value in asdict(arguments).items() if value != ""}
    return {"run": "recordings: " + ", ".join(sources) if sources else run, **given}


def _notes(found: Identification) -> list[str]:
    """Return what the reader of the figures must know."""
    notes = []
    stopped = [
        name
        for name, grip in found.grips.items()
        if any(trial.status.get("travel_stops_hit") for trial in grip.trials)
    ]
    if stopped:
        notes.append(
            f"the actuator hit its stops ({', '.join(stopped)}): use a smaller amplitude, do not"
            " use the fit"
        )
    if len(found.grips) > 1:
        notes.append(
            "all grips pooled are a compromise between them, the discrete model most of all; for"
            " the best model of one grip identify it alone"
        )
    return notes


def parameter_file(found: Identification, actuator: ActuatorParameters, age: float = 0.0) -> str:
    """Return a ROS parameter file that ``config:=FILE`` takes: the handle and its controllers.

    Parameters
    ----------
    found : Identification
    actuator : ActuatorParameters
        As far as it is known without the identification.
    age : float
        Age of the forces that came through the live graph, s. It is part of the delay that a
        controller compensates, but not of the simulated handle's own delay.
    """
    fit = found.fit
    handle = _plain({name: getattr(fit.handle, name) for name in ("m_h", "k_u", "b_u")})
    mount = _plain(asdict(fit.mount))
    suspension = {name: getattr(fit.handle, name) for name in own_schema(Suspension)}
    content = {
        "/**": {"ros__parameters": {ACTUATOR: _plain(asdict(actuator) | suspension)}},
        "master_device": {
            "ros__parameters": {
                "simulated": {
                    "handle": handle,
                    "mount": mount,
                    "drive": {"delay": float(f"{max(0.0, fit.delay - age):.6f}")},
                }
            }
        },
        "compensator": {
            "ros__parameters": {
                "constant": _plain({"mass": fit.handle.m_h}),
                "dynamic": _plain(asdict(found.approximate)),
                "plant": {
                    "handle": handle,
                    "mount": mount,
                    "delay": float(f"{max(0.0, fit.delay):.6f}"),
                    "bandwidth": fit.low_pass_frequency,
                },
            }
        },
    }
    head = (
        "# A handle as identified; use with config:=FILE. SI units.\n"
        f"# Band {fit.band[0]:.4g} to {fit.band[1]:.4g} Hz, delay {fit.delay * 1e6:.0f} us beside"
        f" the loop's own sample,\n# residual {fit.residual:.2f} (1: noise alone).\n"
    )
    return head + yaml.safe_dump(content, sort_keys=False)


def _plain(values: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(f"{value:.6g}") for name, value in values.items()}


def _errors(
    found: Identification,
    rig: RigParameters,
    sweep: SweepParameters,
    rate: float,
    band: tuple[float, float],
    lockstep: bool,
) -> dict[str, ModelError]:
    """Compare models with what the rig does without noise, friction and converters.

    In the live graph the age of the forces adds to the rig's own delay, and the models have it
    rightly: there the delay that was found is taken for the true one.
    """
    master = rig.master
    delay = master.drive.delay if lockstep else max(0.0, found.fit.delay)
    clean = replace(
        master,
        drive=replace(master.drive, coulomb_friction=0.0, bits=32, delay=delay),
        accelerometer=replace(master.accelerometer, noise_density=0.0, bits=32),
    )
    (trial,) = run_identification(clean, sweep, rate)
    truth = _ratio(trial, sweep, band)
    models: dict[str, Callable[[FrequencyResponse], ComplexArray]] = {
        "discrete": lambda at: found.discrete.response(at.frequency),
        "physical": lambda at: found.fit.response(at.frequency, rate),
    }
    return {name: _error(model(truth), truth.response) for name, model in models.items()}


def _ratio(
    trial: IdentificationTrial, sweep: SweepParameters, band: tuple[float, float]
) -> FrequencyResponse:
    force = kept_repeats(trial.actuator_force, sweep, trial.rate)
    acceleration = kept_repeats(centred(trial.handle_acceleration), sweep, trial.rate)
    return dft_ratio(force, acceleration, trial.rate, band, sweep.repeats - 1)


def _error(response: ComplexArray, truth: ComplexArray) -> ModelError:
    ratio = response / truth
    return ModelError(
        float(np.max(np.abs(20 * np.log10(np.abs(ratio))))),
        float(np.max(np.abs(np.angle(ratio))) * DEGREES),
    )


def _figures(
    found: Identification, errors: Mapping[str, ModelError], band: tuple[float, float]
) -> dict[str, Any]:
    """Return the figures for a JSON file; the discrete model is what the errors are of."""
    discrete = errors.get("discrete")
    return {
        **_fit_figures(found.fit),
        "max_magnitude_error_db": discrete.magnitude_db if discrete else None,
        "max_phase_error_deg": discrete.phase_deg if discrete else None,
        "band_hz": list(band),
        "physical_model": asdict(errors["physical"]) if errors else None,
        "grips": {name: _fit_figures(grip.fit) for name, grip in found.grips.items()},
        "approximate_model": asdict(found.approximate),
        "discrete_model": {
            "sections": found.discrete.sections.tolist(),
            "delay_samples": found.discrete.delay_samples,
            "rate_hz": found.discrete.rate,
        },
    }


def _fit_figures(fit: HandleFit) -> dict[str, Any]:
    units = {name: given.unit for name, (_, given) in own_schema(HandleParameters).items()}
    return {
        "parameters": {
            name: {
                "value": value,
                "standard_error": fit.standard_errors.get(name),
                "unit": units[name],
            }
            for name, value in asdict(fit.handle).items()
        },
        "delay_s": fit.delay,
        "delay_standard_error_s": fit.standard_errors.get("delay"),
        "mount": asdict(fit.mount),
        "residual": fit.residual,
    }


def _table(found: Identification, truth: HandleParameters | None) -> Table:
    table = Table(title="the handle, all trials pooled")
    others = list(found.grips) if len(found.grips) > 1 else []
    true = asdict(truth) if truth else {}
    for heading in ("", "found", "standard error", *others, *(["true"] if true else []), "unit"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, (_, given) in own_schema(HandleParameters).items():
        error = found.fit.standard_errors.get(name)
        table.add_row(
            name,
            f"{getattr(found.fit.handle, name):.4g}",
            "known" if error is None else f"{error:.2g}",
            *(f"{getattr(found.grips[grip].fit.handle, name):.4g}" for grip in others),
            *([f"{true[name]:.4g}"] if true else []),
            given.unit,
        )
    blank = [""] if true else []
    mount = asdict(found.fit.mount)
    for name, unit in (("frequency", "Hz"), ("damping", "")):
        error = found.fit.standard_errors.get(f"mount_{name}")
        if error is not None:
            of_grips = [f"{getattr(found.grips[grip].fit.mount, name):.4g}" for grip in others]
            table.add_row(
                f"mount's {name}", f"{mount[name]:.4g}", f"{error:.2g}", *of_grips, *blank, unit
            )
    delay_error = found.fit.standard_errors.get("delay", math.nan)
    delays = [f"{found.grips[grip].fit.delay * 1e6:.1f}" for grip in others]
    table.add_row(
        "delay",
        f"{found.fit.delay * 1e6:.1f}",
        f"{delay_error * 1e6:.2g}",
        *delays,
        *blank,
        "us",
    )
    return table

"""``haptic-accel identify``: from the paper's sweep to a parameter file for one's own handle."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from haptic_accel.analysis.identification_report import (
    ModelError,
    explained,
    fits_by_column,
    parameter_rows,
    write_identification_report,
)
from haptic_accel.bags.excitation import read_excited, read_force_age
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import (
    Verb,
    json_option,
    listed_words,
    lockstep_option,
    out_option,
    word_options,
    words,
)
from haptic_accel.cli.output import results_folder, save
from haptic_accel.cli.running import StopOnSignal, conclude, progress_bar
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.identification.estimate import RecordingError, dft_ratio
from haptic_accel.core.identification.evaluation import Identification, centred, identify_handle
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
"""Frequency below which the compensator's high-pass passes nothing (paper), Hz."""

HIGHEST_COMPARED = 400.0
"""Frequency above which the true response lies in the accelerometer's noise, Hz."""

MOST_MISSING = 0.01
"""Largest share of missing samples with which a trial is evaluated (assumed)."""

COLUMNS = ("actuator_force", "handle_acceleration")
"""Columns of a CSV file, N and m/s^2."""

Recorded = dict[str, list[IdentificationTrial]]
"""Trials by the name of the grip."""


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
    _, known = node_parameters("identifier", graph_parameters(arguments)["identifier"])
    actuator, sensor = known[ACTUATOR], known["accelerometer"]
    try:
        if lockstep:
            recorded, age = _run_lockstep(arguments, grips), 0.0
        else:
            places = _named(sources, arguments) if sources else _run_live(arguments, grips, folder)
            recorded, age = _read(places, arguments, recording_rate)
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
        raise StoppedError(FAILED, str(reason)) from None
    truth, errors = None, {}
    band = (
        max(LOWEST_COMPARED, arguments.sweep.start_frequency),
        min(0.9 * arguments.sweep.end_frequency, HIGHEST_COMPARED),
    )
    if arguments.master == SIMULATED and not sources and len(grips) == 1:
        rig = _rig(replace(arguments, grip=grips[0]))
        truth, errors = rig.master.handle, _errors(found, rig, arguments.sweep, band, lockstep)
    run = "lockstep" if lockstep else "live graph"
    if sources:
        run = "recordings: " + ", ".join(sources)
    notes = _notes(found)
    parameters = folder / "handle.yaml"
    parameters.write_text(parameter_file(found, actuator, age), encoding="utf-8")
    page = write_identification_report(
        found,
        arguments.sweep,
        folder,
        settings={"run": run}
        | {name: str(value) for name, value in asdict(arguments).items() if value != ""},
        truth=truth,
        errors=errors,
        band=band,
        notes=notes,
    )
    save(_metrics(found, errors, band), json_file)
    Console().print(_table(found, truth))
    for name, error in errors.items():
        print(
            f"{name} model against the true response, {band[0]:g} to {band[1]:g} Hz: at most"
            f" {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
        )
    print(*notes, explained(found), f"parameters: {parameters}", f"report: {page}", sep="\n")
    return DONE


def _checked_grips(grips: Sequence[str], arguments: IdentifyArguments) -> list[str]:
    for grip in grips:
        if grip not in POSTURES:
            raise ParameterError(f"grips = {grip!r}: must be among {', '.join(POSTURES)}")
    if len(set(grips)) < len(grips):
        raise ParameterError(f"grips = {', '.join(grips)}: must hold each grip once")
    return list(grips) or [arguments.grip]


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


def _run_live(
    arguments: IdentifyArguments, grips: Sequence[str], folder: Path
) -> Iterator[tuple[str, Path]]:
    """Run the graph once for each grip; yield each grip and its bag."""
    bags = Path(arguments.bag) if arguments.bag else folder / "bags"
    for grip in grips:
        bag = bags if arguments.bag and len(grips) == 1 else bags / grip
        if arguments.master != SIMULATED and len(grips) > 1 and sys.stdin.isatty():
            input(f"hold the handle with the {grip} grip, then press Enter")
        _run_graph(replace(arguments, grip=grip, bag=str(bag)))
        yield grip, bag


def _run_graph(arguments: IdentifyArguments) -> None:
    repeats = arguments.sweep.repeats
    with StopOnSignal() as stop, progress_bar() as progress:
        task = progress.add_task(
            f"{arguments.grip} grip: starting", total=arguments.trials * repeats
        )

        def follow(executable: str, line: str) -> None:
            if executable == "identifier" and "trial " in line:
                # The node's line ends with "trial 2 of 4, repeat 3 of 3".
                place = line[line.rindex("trial ") :]
                trial, repeat = int(place.split()[1]), int(place.split()[5])
                done = (trial - 1) * repeats + repeat - 1
                progress.update(
                    task, description=f"{arguments.grip} grip: {place}", completed=done
                )
                if not progress.console.is_terminal:
                    progress.console.print(f"{arguments.grip} grip: {place}", highlight=False)

        outcome = Supervisor(identification_graph(arguments), on_line=follow).run(stop)
        if outcome.first and outcome.status == 0:
            progress.update(
                task,
                completed=arguments.trials * repeats,
                description=f"{arguments.grip} grip: done",
            )
    if not outcome.first:
        raise StoppedError(INTERRUPTED, f"interrupted; recorded so far: {arguments.bag}")
    status = conclude(outcome)
    if status != DONE:
        raise StoppedError(status)


def _named(sources: Sequence[str], arguments: IdentifyArguments) -> Iterator[tuple[str, Path]]:
    """Yield grip and path of each source, ``GRIP=PATH`` or ``PATH``."""
    for source in sources:
        grip, separator, path = source.partition("=")
        yield (grip, Path(path)) if separator else (arguments.grip, Path(source))


def _read(
    places: Iterable[tuple[str, Path]], arguments: IdentifyArguments, recording_rate: float
) -> tuple[Recorded, float]:
    """Read trials from bags and CSV files, and the mean age of the forces in the bags, s."""
    recorded: Recorded = {}
    ages = []
    for grip, path in places:
        if path.is_dir():
            trials = _trials(path, arguments)
            ages.append(read_force_age(path))
        else:
            rate = recording_rate or arguments.rate
            force, acceleration = (
                read_recording(str(path), rate, rate, column=column) for column in COLUMNS
            )
            trials = find_trials(force, acceleration, arguments.sweep, rate)
        recorded.setdefault(grip, []).extend(trials)
    rates = {trial.rate for trials in recorded.values() for trial in trials}
    if len(rates) > 1:
        raise ParameterError(f"from: recordings of {len(rates)} rates, must be of one")
    return recorded, fmean(ages) if ages else 0.0


def _trials(bag: Path, arguments: IdentifyArguments) -> list[IdentificationTrial]:
    """Return the trials of a bag, without those that miss too many samples.

    Raises
    ------
    RecordingError
        No trial is left.
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


def _rig(arguments: IdentifyArguments) -> RigParameters:
    """Return the simulated rig with its master as one user holds it, for any seed of the noise."""
    _, devices = node_parameters("master_device", graph_parameters(arguments)["master_device"])
    master = RigParameters(devices[SIMULATED]).master
    handle = held(master.handle, master.grip, arguments.seed)
    grip = replace(master.grip, variation=0.0, posture=AVERAGE_GRIP)
    return RigParameters(replace(master, handle=handle, grip=grip))


# Results


def _notes(found: Identification) -> list[str]:
    """Return warnings to the reader of the metrics."""
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
        Actuator as known without the identification.
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
    band: tuple[float, float],
    lockstep: bool,
) -> dict[str, ModelError]:
    """Compare models with the response of the rig without noise, friction and converters.

    In the live graph the age of the forces adds to the rig's own delay, and belongs into the
    models: there the delay that was found is taken for the true one.
    """
    master, rate = rig.master, found.discrete.rate
    delay = master.drive.delay if lockstep else max(0.0, found.fit.delay)
    clean = replace(
        master,
        drive=replace(master.drive, coulomb_friction=0.0, bits=32, delay=delay),
        accelerometer=replace(master.accelerometer, noise_density=0.0, bits=32),
    )
    (trial,) = run_identification(clean, sweep, rate)
    force, acceleration = (
        kept_repeats(values, sweep, rate)
        for values in (trial.actuator_force, centred(trial.handle_acceleration))
    )
    true = dft_ratio(force, acceleration, rate, band, sweep.repeats - 1)
    return {
        "discrete": _error(found.discrete.response(true.frequency) / true.response),
        "physical": _error(found.fit.response(true.frequency, rate) / true.response),
    }


def _error(ratio: ComplexArray) -> ModelError:
    return ModelError(
        float(np.max(np.abs(20 * np.log10(np.abs(ratio))))),
        float(np.max(np.abs(np.angle(ratio))) * (180 / math.pi)),
    )


def _metrics(
    found: Identification, errors: Mapping[str, ModelError], band: tuple[float, float]
) -> dict[str, Any]:
    """Return the metrics for a JSON file; its errors without a model are the discrete model's."""
    discrete = errors.get("discrete")
    return {
        **_fit_metrics(found.fit),
        "max_magnitude_error_db": discrete.magnitude_db if discrete else None,
        "max_phase_error_deg": discrete.phase_deg if discrete else None,
        "band_hz": list(band),
        "physical_model": asdict(errors["physical"]) if errors else None,
        "grips": {name: _fit_metrics(grip.fit) for name, grip in found.grips.items()},
        "approximate_model": asdict(found.approximate),
        "discrete_model": {
            "sections": found.discrete.sections.tolist(),
            "delay_samples": found.discrete.delay_samples,
            "rate_hz": found.discrete.rate,
        },
    }


def _fit_metrics(fit: HandleFit) -> dict[str, Any]:
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
        "delay_standard_error_s": fit.standard_errors.get("delay"),
        "mount": asdict(fit.mount),
        "residual": fit.residual,
    }


def _table(found: Identification, truth: HandleParameters | None) -> Table:
    table = Table(title="the handle, with standard errors")
    columns = [name for name, _ in fits_by_column(found)]
    for heading in ("", "unit", *(["true"] if truth else []), *columns):
        table.add_column(heading, justify="right" if heading in columns else "left")
    for row in parameter_rows(found, truth):
        cells = [
            f"{value} ± {error}" if error[0].isdigit() else f"{value} {error}"
            for value, error in row.cells
        ]
        table.add_row(row.name, row.unit, *([row.true] if truth else []), *cells)
    return table

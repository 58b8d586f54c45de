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

"""``haptic-accel identify``: parameter file for a handle, from the paper's sweep."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean

import click

from haptic_accel.analysis import identification_report as report
from haptic_accel.analysis.identification_results import (
    identification_metrics,
    model_errors,
    parameter_file,
    rig_as_held,
)
from haptic_accel.bags.excitation import force_age, last_values, read_excited
from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.cli import options
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.output import results_folder, save
from haptic_accel.cli.running import progress_bar, run_to_end, stop_on_signal
from haptic_accel.cli.tables import print_table
from haptic_accel.cli.workers import Workers
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.evaluation import (
    DEFAULT_FREE,
    Identification,
    identify_handle,
)
from haptic_accel.core.identification.stops import LIMITED, STOPS_HIT, check_stops, check_travel
from haptic_accel.core.model import ACTUATOR, POSTURES, HandleParameters
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.process import INTERRUPTED
from haptic_accel.core.trial import run_identification
from haptic_accel.devices.audio import AUDIO
from haptic_accel.graph.arguments import SIMULATED, IdentifyArguments
from haptic_accel.graph.locks import sole_graph
from haptic_accel.graph.node_parameters import node_parameters
from haptic_accel.graph.processes import graph_parameters, identification_graph
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.materials.recordings import read_recording

LOWEST_COMPARED = 15.0
"""Frequency below which the compensator's high-pass passes nothing (paper), Hz."""

HIGHEST_COMPARED = 400.0
"""Frequency above which the true response lies in the accelerometer's noise, Hz."""

MOST_MISSING = 0.01
"""Largest share of missing samples with which a trial is evaluated (assumed)."""

COLUMNS = ("actuator_force", "handle_acceleration")
"""Columns of a CSV file, N and m/s^2."""

Recorded = dict[str, list[sweeps.IdentificationTrial]]
"""Trials by the name of the grip."""


@options.verb(
    "haptic-accel identify --lockstep --grips pinch,hook",
    "haptic-accel identify master:=serial params_file:=mine.yaml",
    "haptic-accel identify --from results/identify/bag",
)
@options.arguments(IdentifyArguments)
@options.lockstep_option
@click.option(
    "--grips",
    type=options.some_of(POSTURES),
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
    "--recording-rate", default=0.0, metavar="HZ", help="Sampling rate of the CSV files, Hz."
)
@click.option(
    "--free",
    type=options.listed_words,
    default=",".join(DEFAULT_FREE),
    metavar="NAME,NAME,...",
    help="Parameters of the model to fit.",
)
@options.word_options([*schema(sweeps.SweepParameters), "trials", "rig"])
@options.workers_options
@options.json_option
@options.out_option
def identify(
    arguments: IdentifyArguments,
    *,
    lockstep: bool,
    grips: Sequence[str],
    sources: Sequence[str],
    recording_rate: float,
    free: Sequence[str],
    workers: Workers,
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Excite the handle with the paper's sweep and fit its model.

    Writes a parameter file for params_file:=FILE, and the paper's figures 4 and 5.
    """
    if len(set(grips)) < len(grips):
        raise ParameterError(f"grips = {', '.join(grips)}: must hold each grip once")
    if lockstep and arguments.master != SIMULATED:
        raise ParameterError(f"master = {arguments.master!r}: with --lockstep must be simulated")
    if lockstep and sources:
        raise ParameterError("from: not with --lockstep, which makes its own recordings")
    by_grip = {grip: replace(arguments, grip=grip) for grip in grips or [arguments.grip]}
    if arguments.bag and len(grips) > 1:
        bags = {grip: str(Path(arguments.bag) / grip) for grip in grips}
        by_grip = {grip: replace(each, bag=bags[grip]) for grip, each in by_grip.items()}
    for each in by_grip.values():
        identification_graph(each)  # everything wrong is found first
    _, known = node_parameters("identifier", graph_parameters(arguments)["identifier"])
    actuator, sensor = known[ACTUATOR], known["accelerometer"]
    with nullcontext() if lockstep or sources else sole_graph(arguments.namespace):
        folder = results_folder(out, "identify_")
        try:
            if lockstep:
                with stop_on_signal() as stop:
                    runs = workers.map(_run_lockstep, list(by_grip.values()), stop)
                    recorded, age = dict(zip(by_grip, runs, strict=False)), 0.0
                if len(recorded) < len(by_grip):
                    raise StoppedError("interrupted", INTERRUPTED)
            elif sources:
                recorded, age = _read(_named(sources, arguments.grip), arguments, recording_rate)
            else:
                recorded, age = _read(_run_live(by_grip, folder), arguments, recording_rate)
            check_stops(recorded)
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
            doubts = [
                check_travel(name, trial, grip.fit.handle, actuator.travel)
                for name, grip in found.grips.items()
                for trial in grip.trials
            ]
        except RecordingError as reason:
            raise StoppedError(str(reason)) from None
    truth, errors = None, {}
    lowest, highest = arguments.sweep.start_frequency, 0.9 * arguments.sweep.end_frequency
    band = max(LOWEST_COMPARED, lowest), min(highest, HIGHEST_COMPARED)
    if arguments.master == SIMULATED and not sources and len(by_grip) == 1:
        rig = rig_as_held(*by_grip.values())
        on_arrival = not (lockstep or arguments.latency)
        truth, errors = (
            rig.master.handle,
            model_errors(found, rig, arguments.sweep, band, on_arrival),
        )
    latency = next(iter(recorded.values()))[0].latency
    run = "lockstep" if lockstep else "live graph"
    if sources:
        run = "recordings: " + ", ".join(sources)
    described = replace(arguments, latency=latency)
    settings = {name: str(value) for name, value in asdict(described).items() if value != ""}
    doubt = max(doubts)  # that of the largest travel, or none
    notes = [doubt] * bool(doubt) + list(_notes(found))
    parameters = folder / "handle.yaml"
    parameters.write_text(parameter_file(found, actuator, age, doubt), encoding="utf-8")
    page = report.write_identification_report(
        found,
        arguments.sweep,
        folder,
        settings={"run": run, **settings},
        truth=truth,
        errors=errors,
        band=band,
        notes=notes,
    )
    save(identification_metrics(found, errors, band, latency), json_file)
    print_table(report.parameter_table(found, truth))
    for name, error in errors.items():
        print(
            f"{name} model against the true response, {band[0]:g} to {band[1]:g} Hz: at most"
            f" {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
        )
    print(
        f"delay of the hardware: {found.fit.delay * 1e6:.0f} us, in addition to the graph's"
        f" latency of {latency} samples"
    )
    if arguments.actuator == AUDIO:
        _, devices = node_parameters("master_device", graph_parameters(arguments)["master_device"])
        scale = devices[AUDIO].largest_force / found.fit.handle.m_h
        print(f"audio.full_scale: {scale:.4g} N per kg of the handle's mass without m_a")
    print(*notes, report.explained(found), sep="\n")
    print(f"parameters: {parameters}", f"report: {page}", sep="\n")


# Recordings


def _run_lockstep(arguments: IdentifyArguments) -> list[sweeps.IdentificationTrial]:
    return run_identification(
        rig_as_held(arguments).master,
        arguments.sweep,
        arguments.rate,
        arguments.seed,
        arguments.trials,
        arguments.latency,
    )


def _run_live(
    by_grip: Mapping[str, IdentifyArguments], folder: Path
) -> Iterator[tuple[str, Path]]:
    """Run the graph once for each grip; yield each grip and its bag."""
    for grip, arguments in by_grip.items():
        bag = Path(arguments.bag or folder / "bags" / grip)
        if arguments.master != SIMULATED and len(by_grip) > 1 and sys.stdin.isatty():
            input(f"hold the handle with the {grip} grip, then press Enter")
        _run_graph(replace(arguments, bag=str(bag)))
        yield grip, bag


def _run_graph(arguments: IdentifyArguments) -> None:
    repeats = arguments.sweep.repeats
    grip, total = f"{arguments.grip} grip", arguments.trials * repeats
    with stop_on_signal() as stop, progress_bar() as progress:
        task = progress.add_task(f"{grip}: starting", total=total)

        def follow(executable: str, line: str) -> None:
            if executable == "identifier" and "trial " in line:
                # The node's line ends with "trial 2 of 4, repeat 3 of 3".
                place = line[line.rindex("trial ") :]
                trial, repeat = int(place.split()[1]), int(place.split()[5])
                done = (trial - 1) * repeats + repeat - 1
                progress.update(task, description=f"{grip}: {place}", completed=done)
                if not progress.console.is_terminal:
                    progress.console.print(f"{grip}: {place}", highlight=False)

        supervisor = Supervisor(identification_graph(arguments), on_line=follow)
        run_to_end(supervisor, stop, f"interrupted; recorded so far: {arguments.bag}")
        progress.update(task, completed=total, description=f"{grip}: done")


def _named(sources: Sequence[str], grip: str) -> Iterator[tuple[str, Path]]:
    """Yield grip and path of each source, ``GRIP=PATH``, or ``PATH`` with the grip given."""
    for source in sources:
        name, separator, path = source.partition("=")
        yield (name, Path(path)) if separator else (grip, Path(source))


def _read(
    places: Iterable[tuple[str, Path]], arguments: IdentifyArguments, recording_rate: float
) -> tuple[Recorded, float]:
    """Read trials from bags and CSV files, and the mean age of forces without a due time, s."""
    recorded: Recorded = {}
    ages = []
    for grip, path in places:
        if os.path.isdir(path):
            bag = read_bag(path)
            trials = _trials(bag, arguments)
            ages.append(force_age(bag))
        else:
            rate = recording_rate or arguments.rate
            force, acceleration = (
                read_recording(str(path), rate, rate, column=column) for column in COLUMNS
            )
            trials = sweeps.find_trials(force, acceleration, arguments.sweep, rate)
        recorded.setdefault(grip, []).extend(trials)
    every = [trial for trials in recorded.values() for trial in trials]
    for name, count in (
        ("rates", len({trial.rate for trial in every})),
        ("latencies", len({trial.latency for trial in every})),
    ):
        if count > 1:
            raise ParameterError(f"from: recordings of {count} {name}, must be of one")
    return recorded, fmean(ages) if ages else 0.0


def _trials(bag: Bag, arguments: IdentifyArguments) -> list[sweeps.IdentificationTrial]:
    """Return the trials of a bag, without those that miss too many samples.

    Raises
    ------
    RecordingError
        No trial is left.
    """
    force, acceleration, missing = read_excited(bag, arguments.rate)
    found = sweeps.find_trials(
        force, acceleration, arguments.sweep, arguments.rate, missing, bag.latency
    )
    # The device knows; in which trial it was, nobody does.
    values = last_values(bag, "master_device")
    for trial in found:
        trial.counters.update((key, int(values.get(key, 0))) for key in (STOPS_HIT, *LIMITED))
    most = MOST_MISSING * len(found[0].actuator_force)
    whole = [trial for trial in found if trial.counters[sweeps.SAMPLES_MISSING] <= most]
    if len(whole) < len(found):
        counts = ", ".join(str(trial.counters[sweeps.SAMPLES_MISSING]) for trial in found)
        reason = (
            f"{bag.path}: {len(found) - len(whole)} of {len(found)} trials left out, as each lacks"
            f" more than {100 * MOST_MISSING:g} % of its samples (missing by trial: {counts});"
            " record again with less load on the machine, which haptic-accel doctor checks, or at"
            " a lower rate:="
        )
        if not whole:
            raise RecordingError(reason)
        print(reason, file=sys.stderr)
    return whole


# Results


def _notes(found: Identification) -> Iterator[str]:
    """Yield warnings to the reader of the metrics."""
    if len(found.grips) > 1:
        yield (
            "models of all grips pooled are a compromise between them, the discrete model most of"
            " all; for the best model of one grip, identify that grip alone"
        )

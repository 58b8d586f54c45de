# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel identify``: parameter file of a handle, from the paper's sweep."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import click

from haptic_accel.analysis import identification, identification_result
from haptic_accel.analysis.identification_result import Result, parameter_table, write_report
from haptic_accel.cli import options, output
from haptic_accel.cli.running import run_to_end, shown_stages, stop_on_signal
from haptic_accel.cli.tables import print_table
from haptic_accel.cli.workers import Workers
from haptic_accel.core import process
from haptic_accel.core.axes import ALL_AXES, Axes
from haptic_accel.core.identification import sweep
from haptic_accel.core.identification.estimate import SMALLER, RecordingError
from haptic_accel.core.identification.evaluation import DEFAULT_FREE
from haptic_accel.core.identification.fit import check_free
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.devices.audio import AUDIO
from haptic_accel.graph.domain import sole_graph
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup import files
from haptic_accel.setup.arguments import SIMULATED, IdentifyArguments, assigned
from haptic_accel.setup.processes import identification_graph
from haptic_accel.setup.setup import Setup

LESS = math.sqrt(0.5)
"""Factor of the amplitude for a repetition of a run that was too strong: half the power."""

SMALLEST_SHARE = 0.05
"""Fraction of the default amplitudes below which no run is tried."""

_ByGrip: TypeAlias = Mapping[str, IdentifyArguments]
_Advise: TypeAlias = Callable[[RecordingError], str]
_Measured: TypeAlias = tuple[Setup[IdentifyArguments], identification.Recordings, Result]


@options.verb(
    "haptic-accel identify --lockstep --grips pinch,hook",
    "haptic-accel identify params_file:=rig.yaml --update rig.yaml",
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
    f" {' and '.join(identification.COLUMNS)}, to evaluate in place of a run; may be given many"
    " times.",
)
@click.option(
    "--recording-rate",
    default=0.0,
    metavar="HZ",
    help="Sampling rate of CSV files without a column of times, Hz; by default that of the graph.",
)
@click.option(
    "--free",
    type=options.listed_words,
    default=",".join(DEFAULT_FREE),
    metavar="NAME,NAME,...",
    help="Parameters of the model to fit.",
)
@options.update_option("device, rate and handle")
@options.word_options([*schema(sweep.SweepParameters), "trials", "rig"])
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
    update: Path | None,
    workers: Workers,
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Excite the handle with the paper's sweep and fit its model.

    Writes a parameter file for params_file:=FILE, and the paper's figures 4 and 5. Where the
    default amplitudes are too strong for the handle, the run is repeated with smaller ones.
    """
    by_grip: _ByGrip = _by_grip(arguments, grips)
    setup = Setup.of(next(iter(by_grip.values())))
    if identification.identified_axes(setup) == ALL_AXES:
        identification.check_one_grip(by_grip)
    if lockstep and arguments.master != SIMULATED:
        raise ParameterError(f"master = {arguments.master!r}: with --lockstep must be simulated")
    if lockstep and sources:
        raise ParameterError("from: not with --lockstep, which makes its own recordings")
    check_free(free)
    for each in by_grip.values():
        identification_graph(each)  # find all errors before the first run
    kept = [
        *(["--lockstep"] if lockstep else []),
        *(["--grips", ",".join(grips)] if grips else []),
        *(["--free", ",".join(free)] if tuple(free) != DEFAULT_FREE else []),
        *(["--update", str(update)] if update else []),
    ]

    def measure(by_grip: _ByGrip, run: int, advise: _Advise) -> _Measured:
        setups = {grip: Setup.of(each) for grip, each in by_grip.items()}
        first = next(iter(setups.values()))
        if lockstep:
            recorded = identification.Recordings(_run_lockstep(setups, workers))
        else:
            shown = _shown(identification.named(sources, arguments.grip))
            recordings = shown if sources else _run_live(setups, folder, run)
            recorded = identification.read_recordings(recordings, first.arguments, recording_rate)
        for error in recorded.left_out:
            print(advise(error), file=sys.stderr)
        with shown_stages(identification.evaluation_stages(recorded.trials)) as show:
            return first, recorded, identification.evaluate(recorded.trials, first, free, show)

    with nullcontext() if lockstep or sources else sole_graph(arguments.namespace):
        folder = output.results_folder(out, "identify_")
        with output.removed_if_empty(folder):
            setup, recorded, result = _weak_enough(by_grip, measure, kept, fixed=bool(sources))
    arguments = replace(arguments, **_amplitudes(setup.arguments))
    if arguments.master == SIMULATED and not sources and len(by_grip) == 1:
        on_arrival = not (lockstep or arguments.latency)
        result = result.with_errors(identification.rig_as_held(setup), arguments.sweep, on_arrival)
    run = "lockstep" if lockstep else "live graph"
    if sources:
        run = "recordings: " + ", ".join(sources)
    described = asdict(replace(arguments, latency=result.latency))
    settings = {name: str(value) for name, value in described.items() if value != ""}
    parameters, model = folder / identification_result.PARAMETER_FILE, Path(result.model_file)
    if result.model_file:
        output.save(result.metrics(), folder / model)
    nodes = result.parameters(recorded.age, model)
    parameters.write_text(result.heading + files.parameter_text(nodes), encoding="utf-8")
    page = write_report(result, folder, arguments.sweep, {"run": run, **settings})
    output.save(result.metrics(), json_file)
    print_table(parameter_table(result.fits, result.truth))
    print(*result.sentences(), sep="\n")
    if arguments.actuator == AUDIO and result.moving_mass:
        _, devices = setup.node("master_device")
        scale = devices[AUDIO].largest_force / result.moving_mass
        process.notify_supervisor(process.FULL_SCALE, value=scale)
        print(f"audio.full_scale: {scale:.4g} N per kg of the handle's mass without m_a")
    print(*result.notes, result.explained, sep="\n")
    print(f"parameters: {update or parameters}", f"report: {page}", sep="\n")
    if update:
        nodes = result.parameters(recorded.age, (folder / model).resolve())
        nodes[files.EVERY_NODE] |= {"rate": arguments.rate}
        nodes.setdefault("master_device", {}).update(
            device=arguments.master,
            actuator_device=arguments.actuator,
            accelerometer_device=arguments.accelerometers,
        )
        files.update_parameter_file(update, nodes)
    print(output.next_command(*_next(arguments, update, parameters)))


def _weak_enough(
    by_grip: _ByGrip,
    measure: Callable[[_ByGrip, int, _Advise], _Measured],
    kept: Sequence[str],
    *,
    fixed: bool,
) -> _Measured:
    """Measure, and repeat with less force while the default amplitudes are too strong.

    Parameters
    ----------
    by_grip : dict
        Arguments by grip. Amplitudes other than the default ones are not changed.
    measure : callable
        Function of arguments by grip, number of the run, and advice on an error; returns a result.
    kept : sequence of str
        Options of the command that the advice repeats.
    fixed : bool
        True if recordings exist already.

    Returns
    -------
    tuple
        Setup, recordings and result of the last run.

    Raises
    ------
    StoppedError
        A recording is unusable; the message has the reason and the advice.
    """
    first = _amplitudes(next(iter(by_grip.values())))
    fixed = fixed or first != _amplitudes(IdentifyArguments)
    run, share = 1, 1.0
    while True:
        advise = partial(_advised, next(iter(by_grip.values())), kept)
        try:
            return measure(by_grip, run, advise)
        except RecordingError as error:
            run, share = run + 1, LESS * share
            if fixed or error.factors != SMALLER or share < SMALLEST_SHARE:
                process.notify_supervisor(process.UNUSABLE, reason=str(error))
                raise output.StoppedError(advise(error)) from None
            print(f"{error}; repeated with {100 * share:.0f} % of the amplitudes")
        less = {name: share * value for name, value in first.items()}
        by_grip = {grip: replace(each, **less) for grip, each in by_grip.items()}


def _amplitudes(arguments: IdentifyArguments | type[IdentifyArguments]) -> dict[str, Any]:
    """Return the amplitudes of arguments, or the default ones, N."""
    return {name: getattr(arguments, name) for name in SMALLER}


def _advised(arguments: IdentifyArguments, kept: Sequence[str], error: RecordingError) -> str:
    """Return the reason of an error and, if known, the command that records again."""
    values = {name: getattr(arguments, name) for name in error.factors}
    changes = {name: type(value)(value * error.factors[name]) for name, value in values.items()}
    try:
        changed = replace(arguments, **changes, bag="")
    except ParameterError:
        return str(error)
    if not changes or changed.end_frequency >= changed.rate / 2:
        return str(error)
    return f"{error}; {output.next_command('identify', *assigned(changed), *kept)}"


def _shown(recordings: Iterable[tuple[str, Path]]) -> Iterator[tuple[str, Path]]:
    """Yield grip and path of each source, and show the path while it is read."""
    recordings = list(recordings)
    with shown_stages([f"reading {path}" for _, path in recordings]) as begin:
        for grip, path in recordings:
            begin(f"reading {path}")
            yield grip, path


def _next(arguments: IdentifyArguments, update: Path | None, parameters: Path) -> list[str]:
    """Return the command that runs the identified handle, with settings that no file has."""
    names = ("rig",) if update else ("rig", "master", "actuator", "accelerometers", "rate")
    settings = {name: getattr(arguments, name) for name in names}
    known = schema(IdentifyArguments)
    assignments = [
        f"{name}:={value:g}" if isinstance(value, float) else f"{name}:={value}"
        for name, value in settings.items()
        if value != known[name][0]
    ]
    assignments = ["controller:=adaptive", *assignments]
    return files.teleop_command(arguments.params_file, update or parameters, *assignments)


def _by_grip(arguments: IdentifyArguments, grips: Sequence[str]) -> dict[str, IdentifyArguments]:
    """Return the arguments of each grip, with separate bags."""
    if len(set(grips)) < len(grips):
        raise ParameterError(f"grips = {', '.join(grips)}: must hold each grip once")
    by_grip = {grip: replace(arguments, grip=grip) for grip in grips or [arguments.grip]}
    if arguments.bag and len(grips) > 1:
        bags = {grip: str(Path(arguments.bag) / grip) for grip in grips}
        by_grip = {grip: replace(each, bag=bags[grip]) for grip, each in by_grip.items()}
    return by_grip


def _run_lockstep(
    setups: Mapping[str, Setup[IdentifyArguments]], workers: Workers
) -> dict[str, list[sweep.IdentificationTrial]]:
    with stop_on_signal() as stop:
        runs = workers.map(identification.run_lockstep, list(setups.values()), stop)
        trials = dict(zip(setups, runs, strict=False))
    if len(trials) < len(setups):
        raise output.StoppedError("interrupted", process.INTERRUPTED)
    return trials


def _run_live(
    setups: Mapping[str, Setup[IdentifyArguments]], folder: Path, run: int
) -> Iterator[tuple[str, Path]]:
    """Run the graph once for each grip; yield each grip and its bag, numbered from run 2 on."""
    for grip, setup in setups.items():
        arguments = setup.arguments
        bag = Path(arguments.bag or folder / "bags" / grip)
        bag = bag.with_name(f"{bag.name}_{run}") if run > 1 else bag
        if arguments.master != SIMULATED and len(setups) > 1 and sys.stdin.isatty():
            input(f"hold the handle with the {grip} grip, then press Enter")
        _run_graph(replace(arguments, bag=str(bag)), identification.identified_axes(setup))
        yield grip, bag


def _run_graph(arguments: IdentifyArguments, axes: Axes) -> None:
    trials = arguments.trials
    repeats = sweep.repeats_of_trial(axes, arguments.sweep)
    grip = f"{arguments.grip} grip: "
    progress = [
        f"{grip}trial {trial} of {trials}, repeat {repeat} of {repeats}"
        for trial in range(1, trials + 1)
        for repeat in range(1, repeats + 1)
    ]
    too_strong: list[str] = []
    with stop_on_signal() as stop, shown_stages(progress) as begin:

        def follow(_: str, event: Mapping[str, Any]) -> None:
            if event["event"] == process.REPEAT and event["done"] < len(progress):
                begin(progress[event["done"]])
            elif event["event"] == process.TOO_STRONG:
                too_strong.append(event["reason"])

        supervisor = Supervisor(identification_graph(arguments), on_event=follow)
        try:
            run_to_end(supervisor, stop, f"interrupted; recorded so far: {arguments.bag}")
        except output.StoppedError:
            if too_strong:
                raise RecordingError(too_strong[0], SMALLER) from None
            raise

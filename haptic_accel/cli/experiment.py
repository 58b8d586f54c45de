# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel experiment``: the paper's experiment, live or in lockstep."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from haptic_accel.analysis import experiment as table
from haptic_accel.analysis.loading import analyse
from haptic_accel.analysis.metrics import MILLI
from haptic_accel.cli import options
from haptic_accel.cli.output import StoppedError, next_command, results_folder, save
from haptic_accel.cli.report import print_analysis
from haptic_accel.cli.running import run_to_end, stop_on_signal
from haptic_accel.cli.studies import Journal, Show, run_side_by_side, run_study
from haptic_accel.cli.tables import print_table
from haptic_accel.cli.workers import Stop, Workers
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.domain import sole_graph
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup import arguments as names
from haptic_accel.setup.processes import arrangement, graph
from haptic_accel.setup.words import assigned_keys

network_option = partial(
    click.option, cls=options.GroupedOption, heading="Network between two hosts, in lockstep"
)

COMPARED = ("none", "constant", "dynamic", "adaptive")
"""The paper's controllers, and the controller with the least error."""

DURATION = 10.0
"""Default length of a condition, s."""

UNFINISHED = "unfinished.part"
"""File that marks the folder of an unfinished experiment, with its results."""

OVERHEAD = 4.0
"""Estimated time for starting and stopping the graph, s, for the time left."""


@options.verb(
    "haptic-accel experiment --lockstep --seeds 8 --controllers none,dynamic,inverse",
    "haptic-accel experiment --lockstep --delay 20 --jitter 10 --loss 0.1",
    "haptic-accel experiment surface:=text duration:=5",
)
@options.words(names.GraphArguments)
@options.lockstep_option
@options.controllers_option(CONTROLLERS, default=COMPARED)
@options.word_options(["rig", "rate", "grip", "recording", "recording_rate"])
@click.option(
    "--seeds",
    type=click.IntRange(1, 1000),
    default=1,
    help="Number of users and pieces of material, in lockstep.",
)
@network_option(
    "--delay", type=click.FloatRange(0.0, 1e4), metavar="MS", help="One-way delay, ms."
)
@network_option(
    "--jitter",
    type=click.FloatRange(0.0, 1e4),
    metavar="MS",
    help="Largest deviation of the delay, ms.",
)
@network_option(
    "--loss", type=click.FloatRange(0.0, 1.0), metavar="SHARE", help="Share of packets lost."
)
@options.workers_options
@options.json_option
@options.out_option
def experiment(
    words: Sequence[str],
    *,
    lockstep: bool,
    json_file: Path | None,
    out: Path | None,
    seeds: int,
    controllers: Sequence[str],
    delay: float | None,
    jitter: float | None,
    loss: float | None,
    workers: Workers,
) -> None:
    """Run the paper's three surfaces under its three controllers and `adaptive`.

    Prints Table II beside the paper's, and writes a report with its figures 9, 10 and 11.
    surface and controller restrict the conditions; duration is that of one condition, 10 s by
    default. surface:=FILE.csv puts a recording in place of the surfaces.
    """
    keys = assigned_keys(words)
    arguments = _checked(names.parse_arguments(words), keys, seeds, lockstep)
    channel = _channel(delay, jitter, loss, lockstep)
    is_one = "surface" in keys or arguments.slave == names.VIRTUAL
    surfaces = [arguments.surface] if is_one else names.SURFACES
    plan = [
        replace(arguments, surface=surface, controller=controller, seed=arguments.seed + seed)
        for seed in range(seeds)
        for surface in surfaces
        for controller in ([arguments.controller] if "controller" in keys else controllers)
    ]
    # Find all wrong arguments before any run.
    processes = [graph(planned) for planned in plan]
    with nullcontext() if lockstep else sole_graph(arguments.namespace):
        folder = results_folder(out, unfinished=UNFINISHED)
        if not lockstep:
            click.echo(arrangement(processes[0]))
        conditions = table.recorded_conditions(plan, folder / "bags", channel, lockstep)
        (folder / UNFINISHED).touch()  # marks the folder for the continuation
        again = () if out else (next_command(*sys.argv[1:], "--out", str(folder)),)
        study = (conditions, "conditions", str, Journal(folder / UNFINISHED, *again))
        if lockstep:
            found, end = run_side_by_side(workers, table.run_lockstep, *study)
        else:
            found, end = run_study(_run_live, *study)
    done = {conditions[index].bag: conditions[index].arguments for index in found}
    run = table.Run(arguments, done, channel, lockstep, {})
    whole = not done or _report(run, folder, json_file, workers)
    if end or not whole:
        raise end or StoppedError


def _checked(
    arguments: names.GraphArguments, keys: Sequence[str], seeds: int, lockstep: bool
) -> names.GraphArguments:
    """Return the arguments with a condition's duration; refuse those that cannot be run."""
    names.check_both_arms(arguments)
    if arguments.master == names.POINTER:
        raise ParameterError(f"master = '{names.POINTER}': an experiment has no user to move it")
    if "duration" not in keys:
        arguments = replace(arguments, duration=DURATION)
    elif arguments.duration < 1:
        raise ParameterError(
            f"duration = {arguments.duration:g}: must be at least 1 s in an experiment"
        )
    if seeds > 1 and not lockstep:
        raise ParameterError(f"seeds = {seeds}: must be 1 without --lockstep")
    if lockstep:
        names.check_lockstep(arguments, "with --lockstep")
    for key in keys:
        if key in ("bag", "record"):
            raise ParameterError(f"{key}: set by an experiment, which records to its own folder")
    return arguments


def _channel(
    delay: float | None, jitter: float | None, loss: float | None, lockstep: bool
) -> ChannelParameters | None:
    """Return the requested network, from times in ms; None if none is requested."""
    if delay is jitter is loss is None:
        return None
    if not lockstep:
        raise ParameterError("delay, jitter and loss: a simulated network needs --lockstep")
    return ChannelParameters((delay or 0.0) / MILLI, (jitter or 0.0) / MILLI, loss or 0.0)


def _run_live(
    conditions: Sequence[table.RecordedCondition], stop: Stop, show: Show
) -> Iterator[tuple[int, str]]:
    """Run the conditions in turn through the graph; yield indices, and lines with errors."""
    for index, condition in enumerate(conditions):
        bag, arguments = condition.bag, condition.arguments
        table.set_aside(bag)

        def is_stopped(index: int = index, started: float = time.monotonic()) -> bool:
            part = (time.monotonic() - started) / (arguments.duration + OVERHEAD)  # noqa: B023
            show(index + min(part, 1.0))
            return stop()

        run_to_end(Supervisor(graph(replace(arguments, bag=str(bag)))), is_stopped)
        trials = analyse([bag]).trials
        error = trials[0].metrics["nrmse_percent"] if trials else math.nan
        yield index, table.condition_line(arguments, error)
        if stop():
            return


def _report(run: table.Run, folder: Path, json_file: Path | None, workers: Workers) -> bool:
    """Analyse the bags; print results, and write report and JSON; return true if all succeeded."""
    with stop_on_signal() as stop:
        analysis = analyse(list(run.done), spread=partial(workers.map, stop=stop))
    if not run.lockstep:
        run = replace(run, expected=_in_lockstep(run.done, workers))
    warnings = list(table.experiment_warnings(analysis, composed=run.arguments.composed))
    page = table.write_experiment(run, analysis, folder, *warnings)
    save(table.experiment_metrics(run, analysis), json_file)
    if comparison := table.lockstep_comparison(analysis, run.expected):
        print_table(comparison)
    print_analysis(analysis, None, *warnings, f"report: {page}")
    return {trial.segment.bag for trial in analysis.trials} == set(run.done)


def _in_lockstep(done: Mapping[Path, names.GraphArguments], workers: Workers) -> dict[Path, float]:
    """Return the errors of the same conditions in lockstep, %, by bag; empty for real devices."""
    simulated = {
        bag: args
        for bag, args in done.items()
        if args.master == names.SIMULATED and args.slave in (names.SIMULATED, names.VIRTUAL)
    }
    with stop_on_signal() as stop:
        errors = workers.map(table.lockstep_error, list(simulated.values()), stop)
        return dict(zip(simulated, errors, strict=False))

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel replay``: playback of a bag through the graph, or a controller alone."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from haptic_accel.analysis.replay import COLUMNS, PlayedCondition, play, progress, touching
from haptic_accel.cli import options
from haptic_accel.cli.output import make_folder, next_command, save
from haptic_accel.cli.running import run_shown
from haptic_accel.cli.studies import journal_of, run_side_by_side
from haptic_accel.cli.tables import print_table
from haptic_accel.cli.workers import Workers
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tables import ResultTable
from haptic_accel.devices.playback import NothingRecordedError
from haptic_accel.setup.arguments import PLAYED_TOPICS, GraphArguments
from haptic_accel.setup.processes import graph
from haptic_accel.setup.replay import (
    Replay,
    ReplayArguments,
    described_replay,
    expected_seconds,
    in_lockstep,
    play_command,
    replay_arguments,
)
from haptic_accel.setup.words import is_argument


@options.verb(
    "haptic-accel replay bags/text controller:=inverse",
    "haptic-accel replay bags/* --lockstep --controllers none,dynamic,inverse",
    "haptic-accel replay drag.csv loop:=true",
)
@options.words(
    ReplayArguments, GraphArguments, describe=described_replay, metavar="[BAG | key:=value ...]"
)
@options.lockstep_option
@options.controllers_option(CONTROLLERS)
@options.workers_options
@options.json_option
@click.option(
    "--out",
    type=options.FILE,
    metavar="FOLDER",
    help="New folder for a bag of each condition, with --lockstep.",
)
def replay(
    words: Sequence[str],
    *,
    lockstep: bool,
    controllers: Sequence[str],
    workers: Workers,
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Play a bag, or a CSV or WAV file, through the graph in place of the slave device.

    Plays the tool's acceleration and the slave's motion; a CSV or WAV file holds an
    acceleration alone. Other arguments default to those stored in the bag; the result is
    recorded as a new bag. The simulated user holds and moves the handle, which the coupler
    draws to the recorded path. rate is the speed, as in `ros2 bag play`; the sampling rate is
    that of the bag. With --lockstep any number of bags may be given; those in which nothing was
    recorded are named and skipped.
    """
    names = [word for word in words if not is_argument(word)]
    bags = [f"bag:={name}" for name in names]
    arguments = [word for word in words if is_argument(word)]
    if lockstep:
        each = [[bag, *arguments] for bag in bags] or [arguments]
        _play(_planned(each), controllers, workers, json_file, out)
        return
    for option, setting in (("controllers", controllers), ("json", json_file), ("out", out)):
        if setting:
            raise ParameterError(f"--{option}: only with --lockstep")
    if len(bags) > 1:
        raise ParameterError(f"bag = {' '.join(names)}: must be one bag, without --lockstep")
    requested = replay_arguments([*bags, *arguments])
    processes = graph(requested.graph)
    if requested.inherited:
        shown = " ".join(f"{name}:={value}" for name, value in requested.inherited.items())
        print(f"as in the bag: {shown}", flush=True)
    if requested.graph.slave == PLAYED_TOPICS:
        print(f"once it is ready, where ROS 2's tools are: {play_command(requested)}", flush=True)
    run_shown(processes, expected=expected_seconds(requested) if sys.stdout.isatty() else 0.0)


def _play(
    plan: Sequence[Replay],
    controllers: Sequence[str],
    workers: Workers,
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Play each bag through each controller, default: the bag's; print and write the metrics."""
    if out:
        names = Counter(_name(planned, each) for planned in plan for each in controllers or [""])
        name, count = names.most_common(1)[0]
        if count > 1:
            raise ParameterError(f"out: two bags would be called {name}")
        make_folder(out)
    conditions = [
        PlayedCondition(
            planned.own,
            replace(planned.graph, controller=controller),
            planned.touched,
            out / _name(planned, controller) if out else None,
        )
        for planned in plan
        for controller in controllers or [planned.graph.controller]
    ]
    journal = None if out else journal_of(json_file)
    found, end = run_side_by_side(workers, play, conditions, "conditions", progress, journal)
    done = [*found.values()]
    print_table(ResultTable.of(COLUMNS, done, left=3, title="Replayed in lockstep"))
    for bag, lost in {row["bag"]: row["lost"] for row in done}.items():
        if lost:
            print(f"{bag}: {lost} missing samples repeat the previous one")
    save({"lockstep": True, "conditions": done}, json_file)
    if end:
        raise end
    if out:
        print(next_command("analyze", str(out)))


def _planned(each: Sequence[Sequence[str]]) -> list[Replay]:
    """Return the replays that arguments request; find all errors before any run.

    Of several bags, those without samples are named and skipped.
    """
    plan: list[Replay] = []
    empty: list[NothingRecordedError] = []
    for assignments in each:
        try:
            plan.append(touching(in_lockstep(replay_arguments(assignments))))
        except NothingRecordedError as error:
            empty.append(error)
    if not plan:
        raise empty[0]
    for none in empty:
        print(f"skipped: {none}", file=sys.stderr)
    return plan


def _name(planned: Replay, controller: str) -> str:
    """Return the name of a condition's bag."""
    return f"{Path(planned.own.bag).stem}_{controller}"

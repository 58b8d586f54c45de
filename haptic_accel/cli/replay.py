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

"""``haptic-accel replay``: a bag once more through the graph, or through a controller alone."""

from __future__ import annotations

import shutil
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click

from haptic_accel.cli import options
from haptic_accel.cli.output import make_folder, save
from haptic_accel.cli.running import run_shown
from haptic_accel.cli.studies import beside, run_side_by_side
from haptic_accel.cli.tables import print_table
from haptic_accel.cli.workers import Workers
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tables import Column, ResultTable, Row
from haptic_accel.core.track import Track
from haptic_accel.core.trial import Trial
from haptic_accel.devices.playback import NothingRecordedError
from haptic_accel.graph.arguments import PLAYED_TOPICS, GraphArguments
from haptic_accel.graph.lockstep import lockstep_trial, record_trial
from haptic_accel.graph.processes import graph
from haptic_accel.graph.replay import (
    Replay,
    ReplayArguments,
    described_replay,
    expected_seconds,
    in_lockstep,
    play_command,
    replay_arguments,
    replayed_track,
)

COLUMNS = (
    Column("bag", "bag", value=lambda row: Path(row["bag"]).name),
    Column("surface", "surface"),
    Column("controller", "controller"),
    Column("after_samples", "after\nsamples"),
    Column("nrmse_percent", "NRMSE\n%", digits=2),
    Column("slope_actual_on_desired", "slope\na on d", digits=3),
    Column("slope_desired_on_actual", "slope\nd on a", digits=3),
    Column("r2", "R²", digits=3),
)
"""Columns of the table; the slopes are of actual on desired, and the reverse."""


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
    names = [word for word in words if ":=" not in word]
    bags = [f"bag:={name}" for name in names]
    arguments = [word for word in words if ":=" in word]
    if lockstep:
        each = [[bag, *arguments] for bag in bags] or [arguments]
        _play(_planned(each), controllers, workers, json_file, out)
        return
    for option, given in (("controllers", controllers), ("json", json_file), ("out", out)):
        if given:
            raise ParameterError(f"--{option}: only with --lockstep")
    if len(bags) > 1:
        raise ParameterError(f"bag = {' '.join(names)}: must be one, without --lockstep")
    asked = replay_arguments([*bags, *arguments])
    processes = graph(asked.graph)
    if asked.inherited:
        shown = " ".join(f"{name}:={value}" for name, value in asked.inherited.items())
        print(f"as in the bag: {shown}", flush=True)
    if asked.graph.slave == PLAYED_TOPICS:
        print(f"in another terminal, once it is ready: {play_command(asked)}", flush=True)
    run_shown(processes, expected=expected_seconds(asked) if sys.stdout.isatty() else 0.0)


@dataclass(frozen=True)
class PlayedCondition:
    """A bag, the graph that it is played through, and the bag of the result."""

    own: ReplayArguments
    graph: GraphArguments
    touched: str
    out: Path | None


def _play(
    plan: Sequence[Replay],
    controllers: Sequence[str],
    workers: Workers,
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Play each bag through each controller, or its own; print and write the metrics."""
    if out:
        names = Counter(_name(asked, each) for asked in plan for each in controllers or [""])
        name, count = names.most_common(1)[0]
        if count > 1:
            raise ParameterError(f"out: two bags would be called {name}")
        make_folder(out)
    conditions = [
        PlayedCondition(
            asked.own,
            replace(asked.graph, controller=controller),
            asked.touched,
            out / _name(asked, controller) if out else None,
        )
        for asked in plan
        for controller in controllers or [asked.graph.controller]
    ]
    journal = None if out else beside(json_file)
    found, end = run_side_by_side(workers, _played, conditions, "conditions", _line, journal)
    done = [*found.values()]
    print_table(ResultTable.of(COLUMNS, done, left=3, title="Replayed in lockstep"))
    for bag, lost in {row["bag"]: row["lost"] for row in done}.items():
        if lost:
            print(f"{bag}: {lost} samples are missing and hold the one before")
    save({"lockstep": True, "conditions": done}, json_file)
    if end:
        raise end


def _played(condition: PlayedCondition) -> Row:
    """Play a bag through a controller; record the result if a bag is given for it."""
    start = time.time_ns()
    track = replayed_track(condition.own, condition.graph)
    trial = lockstep_trial(condition.graph, track=track)
    trial = replace(trial, surface=condition.touched)
    metrics = _metrics(condition.own.bag, trial, track)
    if condition.out:
        shutil.rmtree(condition.out, ignore_errors=True)  # that of a lost process
        record_trial(condition.out, trial, condition.graph, start)
    return metrics


def _line(row: Row) -> str:
    return f"{Path(row['bag']).name} / {row['controller']}: {row['nrmse_percent']:.2f} %"


def _planned(each: Sequence[Sequence[str]]) -> list[Replay]:
    """Return the replays that words ask for: all that can be wrong is found before any runs.

    Among several bags, those in which nothing was recorded are named and left out.
    """
    plan: list[Replay] = []
    empty: list[NothingRecordedError] = []
    for words in each:
        try:
            plan.append(_touching(in_lockstep(replay_arguments(words))))
        except NothingRecordedError as error:
            empty.append(error)
    if not plan:
        raise empty[0]
    for none in empty:
        print(f"skipped: {none}", file=sys.stderr)
    return plan


def _touching(asked: Replay) -> Replay:
    """Return a replay with the surface of its bag, without the bag that was read."""
    from haptic_accel.analysis.segments import surface_of

    touched = surface_of(asked.bag) if asked.bag else asked.graph.surface
    return replace(asked, bag=None, touched=touched)


def _metrics(bag: str, trial: Trial, track: Track) -> Row:
    """Return the metrics of a bag played through a controller."""
    try:
        evaluation = trial.evaluate()
    except ValueError as error:
        raise ParameterError(f"{bag}: {error}") from None
    return {
        "bag": bag,
        "surface": trial.surface,
        "controller": trial.controller,
        **asdict(evaluation),
        "seconds": trial.seconds,
        "rate_hz": trial.rate,
        "latency_samples": trial.latency,
        "after_samples": trial.after,
        "lost": int(track.lost.sum()),
    }


def _name(asked: Replay, controller: str) -> str:
    """Return the name of a condition's bag."""
    return f"{Path(asked.own.bag).stem}_{controller}"

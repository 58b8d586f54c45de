"""``haptic-accel replay``: a bag once more through the graph, or through a controller alone."""

from __future__ import annotations

import shlex
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from haptic_accel.cli.options import (
    FILE,
    Verb,
    controllers_option,
    json_option,
    lockstep_option,
    words,
)
from haptic_accel.cli.output import make_folder, save
from haptic_accel.cli.running import StopOnSignal, conclude, show
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE
from haptic_accel.core.topics import PLAYED, SLAVE_SIGNALS
from haptic_accel.core.track import Track, played_at
from haptic_accel.core.trial import Trial
from haptic_accel.devices.playback import SLAVE, ReplayParameters, read_track, start_offset
from haptic_accel.graph.arguments import PLAYED_TOPICS, REPLAY, SIMULATED, GraphArguments
from haptic_accel.graph.lockstep import lockstep_trial, record_trial
from haptic_accel.graph.processes import Process, graph
from haptic_accel.graph.replay import Replay, ReplayArguments, described_replay, replay_arguments
from haptic_accel.graph.supervisor import Supervisor

Metrics = dict[str, Any]

COLUMNS = ("NRMSE\n%", "slope\na on d", "slope\nd on a", "R²")
"""Headings of the table's figures; the slopes are of actual on desired, and the reverse."""

NAME_WIDTH = 19
"""Characters of a bag's name on one line: as many as the default one has."""


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel replay bags/text controller:=inverse",
        "haptic-accel replay bags/* --lockstep --controllers none,dynamic,inverse",
        "haptic-accel replay drag.csv loop:=true",
    ],
)
@words(
    ReplayArguments, GraphArguments, describe=described_replay, metavar="[BAG | key:=value ...]"
)
@lockstep_option
@controllers_option(CONTROLLERS)
@json_option
@click.option(
    "--out",
    type=FILE,
    metavar="FOLDER",
    help="New folder for a bag of each condition, with --lockstep.",
)
def replay(
    words: Sequence[str],
    *,
    lockstep: bool,
    controllers: Sequence[str],
    json_file: Path | None,
    out: Path | None,
) -> int:
    """Play a bag, or a CSV or WAV file, through the graph in place of the slave device.

    Plays the tool's acceleration and the slave's motion; a CSV or WAV file holds an
    acceleration alone. Other arguments default to those stored in the bag; the result is
    recorded as a new bag. The simulated user holds and moves the handle, which the coupler
    draws to the recorded path. rate is the speed, as in `ros2 bag play`; the sampling rate is
    that of the bag. With --lockstep any number of bags may be given.
    """
    if lockstep:
        return replay_lockstep(words, controllers=controllers, json_file=json_file, out=out)
    for option, given in (("controllers", controllers), ("json", json_file), ("out", out)):
        if given:
            raise ParameterError(f"--{option}: only with --lockstep")
    return replay_live(words)


def replay_live(words: Sequence[str]) -> int:
    """Play a bag through the graph until it is over or stopped; return the exit status.

    Parameters
    ----------
    words : sequence of str
        A bag, and arguments as ``key:=value``.

    Raises
    ------
    ParameterError
        An argument is wrong, or the bag cannot be replayed.
    """
    processes = _prepared(words)
    with StopOnSignal() as stop:
        outcome = Supervisor(processes, on_line=show).run(stop)
    return conclude(outcome)


def replay_lockstep(
    words: Sequence[str],
    *,
    controllers: Sequence[str] = (),
    json_file: Path | None = None,
    out: Path | None = None,
) -> int:
    """Play bags through controllers without ROS, the same result every time.

    Parameters
    ----------
    words : sequence of str
        Bags, and arguments as ``key:=value`` that hold for all of them.
    controllers : sequence of str
        Each plays every bag; the one of the arguments, or of the bag, where there are none.
    json_file : Path, optional
        File for the metrics as JSON.
    out : Path, optional
        Folder to make, for a bag of each condition.

    Raises
    ------
    ParameterError
        An argument is wrong, or a bag cannot be replayed.
    """
    bags, arguments = _sorted(words)
    each = [_with_bag([bag], arguments) for bag in bags] or [arguments]
    # All that can be wrong is found before anything runs.
    plan = [_in_lockstep(replay_arguments(given)) for given in each]
    if out:
        _check_names([asked.own.bag for asked in plan], controllers)
        make_folder(out)
    done: list[Metrics] = []
    for asked in plan:
        track = _track(asked)
        for controller in controllers or [asked.graph.controller]:
            arguments_of_trial = replace(asked.graph, controller=controller)
            start = time.time_ns()
            trial = lockstep_trial(arguments_of_trial, track=track)
            done.append(_metrics(asked.own.bag, trial, track))
            if out:
                record_trial(out / _name(asked.own.bag, controller), trial, asked.graph, start)
    console = Console()
    console.print(_table(done))
    for bag, lost in {row["bag"]: row["lost"] for row in done}.items():
        if lost:
            console.print(f"{bag}: {lost} samples are missing and hold the one before")
    save({"lockstep": True, "conditions": done}, json_file)
    return DONE


def play_command(asked: Replay) -> str:
    """Return the line that has `ros2 bag play` publish what the graph waits for."""
    assert asked.bag is not None
    own = asked.own
    found = [
        (name, f"/{PLAYED}/{topic.name}")
        for topic in SLAVE_SIGNALS
        for name in sorted(asked.bag.counts)
        if name.endswith(f"/{topic.name}")
    ]
    words = ["ros2", "bag", "play", own.bag, "--topics", *(name for name, _ in found)]
    words += ["--remap", *(f"{name}:={played}" for name, played in found)]
    offset = start_offset(asked.bag, own.start)
    words += ["--start-offset", f"{offset:.3f}"] if offset else []
    words += ["--loop"] if own.loop else []
    return shlex.join(words)


def _prepared(words: Sequence[str]) -> list[Process]:
    """Return the graph that replays a bag, after telling what a user should know before."""
    bags, arguments = _sorted(words)
    if len(bags) > 1:
        raise ParameterError(f"bag = {' '.join(bags)}: must be one, without --lockstep")
    asked = replay_arguments(_with_bag(bags, arguments))
    processes = graph(asked.graph)
    for line in _announced(asked):
        print(line, flush=True)
    return processes


def _sorted(words: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return bags, and arguments."""
    bags: list[str] = []
    arguments: list[str] = []
    for word in words:
        (arguments if ":=" in word else bags).append(word)
    return bags, arguments


def _with_bag(bags: Sequence[str], arguments: Sequence[str]) -> list[str]:
    return [*(f"bag:={bag}" for bag in bags), *arguments]


def _announced(asked: Replay) -> list[str]:
    """Return what a user should know before it starts."""
    lines = []
    if asked.inherited:
        shown = " ".join(f"{name}:={value}" for name, value in asked.inherited.items())
        lines.append(f"as in the bag: {shown}")
    if asked.graph.slave == PLAYED_TOPICS:
        lines.append(f"in another terminal, once it is ready: {play_command(asked)}")
    return lines


def _in_lockstep(asked: Replay) -> Replay:
    """Return a replay without the bag that was read, and with the simulated handle.

    Raises
    ------
    ParameterError
        It asks for what only a graph can do, or for what the graph would refuse.
    """
    own = asked.own
    if own.loop:
        raise ParameterError("loop = true: not with --lockstep, which plays a bag once")
    if asked.graph.slave != REPLAY:
        raise ParameterError("source, slave: not with --lockstep, which replays the slave")
    if asked.graph.master == REPLAY:
        raise ParameterError("master = 'replay': not with --lockstep, which simulates the handle")
    arguments = replace(asked.graph, master=SIMULATED)
    graph(arguments)
    return replace(asked, graph=arguments, bag=None)


def _track(asked: Replay) -> Track:
    """Return what is played, at the rate of the graph."""
    own, rate = asked.own, asked.graph.rate
    parameters = ReplayParameters(
        own.bag,
        rate=asked.graph.recording_rate,
        column=asked.graph.recording_column,
        start=own.start,
    )
    return played_at(read_track(parameters, SLAVE, rate), rate, own.rate)


def _metrics(bag: str, trial: Trial, track: Track) -> Metrics:
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
        "lost": int(track.lost.sum()),
    }


def _name(bag: str, controller: str) -> str:
    """Return what the bag of a condition is called."""
    return f"{Path(bag).stem}_{controller}"


def _check_names(bags: Sequence[str], controllers: Sequence[str]) -> None:
    """Refuse conditions whose bags would be called the same."""
    names = Counter(_name(bag, name) for bag in bags for name in controllers or [""])
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise ParameterError(f"out: two bags would be called {twice[0]}")


def _table(done: Sequence[Metrics]) -> Table:
    """Return the metrics as a table."""
    table = Table(title="Replayed in lockstep", show_edge=False)
    table.add_column("bag", overflow="fold", min_width=NAME_WIDTH)
    for heading in ("surface", "controller"):
        table.add_column(heading, no_wrap=True)
    for heading in COLUMNS:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in done:
        table.add_row(
            Path(row["bag"]).name,
            row["surface"],
            row["controller"],
            f"{row['nrmse_percent']:.2f}",
            f"{row['slope_actual_on_desired']:.3f}",
            f"{row['slope_desired_on_actual']:.3f}",
            f"{row['r2']:.3f}",
        )
    return table

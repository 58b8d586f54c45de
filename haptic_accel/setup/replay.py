# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments of a replay and its graph, with defaults from the bag."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptic_accel.core.parameters import Checked, ParameterError, checked, like, parameter, schema
from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.core.topics import MASTER, PLAYED, SLAVE, SLAVE_SIGNALS
from haptic_accel.core.track import SHORTEST, Track, played_at
from haptic_accel.devices import playback
from haptic_accel.materials.folders import is_recording
from haptic_accel.setup import arguments as names
from haptic_accel.setup.arguments import PLAYED_TOPICS, REPLAY, GraphArguments, parse_arguments
from haptic_accel.setup.node_parameters import HIGHEST_RATE
from haptic_accel.setup.processes import graph
from haptic_accel.setup.setup import recorded_arguments
from haptic_accel.setup.words import assigned_keys, described, parse_assignments, unknown_key

if TYPE_CHECKING:
    from haptic_accel.bags.reading import Bag

INHERITED = ("controller", "rig", "grip", "surface", "master", "params_file", "seed")
"""Arguments of the graph that default to the recorded values in the bag."""

ONE_HOST = ("side", "peer", "transport", "keys", "insecure")
"""Arguments of the graph that a replay does not have."""

REPLAYED = ("replay", "replay_speed", "replay_loop", "replay_start", "rate", "duration", "bag")
"""Arguments of the graph that are set by arguments of the replay."""


@dataclass(frozen=True)
class ReplayArguments(Checked):
    """Replay: source and playback."""

    bag: str = parameter("", "bag, or CSV or WAV file, to play")
    rate: float = like(playback.ReplayParameters, "speed")
    loop: bool = like(playback.ReplayParameters, "loop")
    start: float = like(playback.ReplayParameters, "start")
    duration: float = parameter(
        0.0,
        "duration to replay; 0: whole recording, or until stopped with loop:=true",
        unit="s",
        low=0.0,
        high=1e5,
    )
    sampling_rate: float = parameter(
        0.0,
        f"sampling rate; 0 for that of the bag, or {DEFAULT_RATE:g} Hz with a CSV or WAV file",
        unit="Hz",
        low=0.0,
        high=HIGHEST_RATE,
    )
    source: str = parameter(
        "device",
        "player: the replay device, or `ros2 bag play` on its topics",
        choices=("device", PLAYED_TOPICS),
    )
    output: str = parameter("", "folder of the bag to write; empty for bags/<date and time>")


@dataclass(frozen=True)
class Replay:
    """A requested replay.

    Attributes
    ----------
    own : ReplayArguments
    graph : GraphArguments
        Arguments of the graph.
    inherited : dict
        Arguments from the bag.
    bag : Bag or None
        Bag with these arguments; None for a CSV or WAV file.
    touched : str
        Surface that the tool touched during the recording, for a table of results.
    """

    own: ReplayArguments
    graph: GraphArguments
    inherited: dict[str, Any]
    bag: Bag | None
    touched: str = ""


def replay_arguments(assignments: Iterable[str]) -> Replay:
    """Read ``key:=value`` arguments, and missing values from the bag.

    Parameters
    ----------
    assignments : iterable of str
        Values of `ReplayArguments` and, for the rest, of `GraphArguments`.

    Raises
    ------
    ParameterError
        An argument is invalid, or the bag is missing or cannot be replayed.
    """
    own, specified = _parsed(assignments)
    bag = None
    if playback.is_bag(own.bag):
        from haptic_accel.bags.reading import read_bag_with_warnings

        bag = read_bag_with_warnings(Path(own.bag))
    specified = {"slave": PLAYED_TOPICS if own.source == PLAYED_TOPICS else REPLAY, **specified}
    specified = GraphArguments.filled(specified)
    inherited = _inherited(bag, specified) if bag else {}
    values: dict[str, Any] = {**inherited, **specified}
    _check_source(own, values, bag)
    values |= {
        # Set also with `ros2 bag play`, because the recording must name its source.
        "replay": str(Path(own.bag).absolute()),
        "replay_speed": own.rate,
        "replay_loop": own.loop,
        "replay_start": own.start,
        "rate": _sampling_rate(own, values["slave"], bag),
        "duration": own.duration / own.rate,
        "bag": own.output,
    }
    return Replay(own, GraphArguments(**values), inherited, bag)


def described_replay() -> list[tuple[str, str, str]]:
    """Return name, default and description of every argument; an empty default is the bag's."""
    rest = []
    for name, default, text in described(GraphArguments):
        if name in INHERITED:
            rest.append((name, "", f"{text}; empty as in the bag, or {default or 'none'}"))
        elif name == "slave":
            rest.append((name, "", f"{text}; empty by source"))
        elif name not in (*REPLAYED, *ONE_HOST):
            rest.append((name, default, text))
    return [*described(ReplayArguments), *rest]


def _parsed(assignments: Iterable[str]) -> tuple[ReplayArguments, dict[str, Any]]:
    """Return the arguments of a replay, and those specified for its graph."""
    known = [name for name, _, _ in described_replay()]
    own: list[str] = []
    rest: list[str] = []
    for assignment in assignments:
        key = assignment.partition(":=")[0]
        if key not in known:
            raise unknown_key(key, known)
        (own if key in schema(ReplayArguments) else rest).append(assignment)
    parsed = parse_assignments(own, ReplayArguments)
    if not parsed.bag:
        raise ParameterError("bag = '': must be a bag, or a CSV or WAV file")
    if not os.path.exists(parsed.bag):
        raise ParameterError(f"bag = '{parsed.bag}': no such bag or file")
    if 0 < parsed.duration < SHORTEST:
        raise ParameterError(
            f"duration = {parsed.duration:g}: must be 0, or {SHORTEST:g} s at least"
        )
    graph, keys = parse_arguments(rest), assigned_keys(rest)
    return parsed, {name: getattr(graph, name) for name in schema(GraphArguments) if name in keys}


def _check_source(own: ReplayArguments, values: dict[str, Any], bag: Bag | None) -> None:
    """Refuse a source without the requested signals, and a replay that plays nothing."""
    if own.source == PLAYED_TOPICS and bag is None:
        raise ParameterError(f"bag = '{own.bag}': must be a bag with source:={PLAYED_TOPICS}")
    if own.source == PLAYED_TOPICS and own.rate != 1.0:
        raise ParameterError(
            f"rate = {own.rate:g}: must be 1 with source:={PLAYED_TOPICS},"
            " whose stamps keep their spacing"
        )
    if {REPLAY, PLAYED_TOPICS}.isdisjoint((values["slave"], values.get("master"))):
        raise ParameterError(
            f"slave = '{values['slave']}': must be {REPLAY}, or come with master:={REPLAY}"
        )


def _sampling_rate(own: ReplayArguments, slave: str, bag: Bag | None) -> float:
    """Return the graph's rate: as specified, or the rate of the replayed arm."""
    arm = SLAVE if slave in (REPLAY, PLAYED_TOPICS) else MASTER
    rate = own.sampling_rate or (playback.bag_rate(bag, arm) if bag else DEFAULT_RATE)
    return float(checked("sampling_rate", rate, *schema(GraphArguments)["rate"]))


def _inherited(bag: Bag, specified: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a bag's recording that apply to its replay.

    Raises
    ------
    ParameterError
        An argument is no longer allowed.
    """
    recorded = recorded_arguments(bag.metadata)
    found = {name: recorded[name] for name in INHERITED if name in recorded.keys() - specified}
    if found.get("master") == REPLAY:
        del found["master"]
    slave = specified["slave"]
    is_other = names.VIRTUAL in (slave, recorded.get("slave")) and slave != recorded.get("slave")
    if is_other or (is_recording(str(recorded.get("surface", ""))) and slave != names.SIMULATED):
        found.pop("surface", None)
    try:
        GraphArguments(**found)
    except ParameterError as error:
        raise ParameterError(f"{bag.path}: was recorded with {error}") from None
    return found


def play_command(replay: Replay) -> str:
    """Return the command line of `ros2 bag play` with the topics for the graph."""
    assert replay.bag is not None
    own = replay.own
    found = [
        (name, f"{replay.graph.namespace}/{PLAYED}/{topic.name}")
        for topic in SLAVE_SIGNALS
        for name in sorted(replay.bag.counts)
        if name.endswith(f"/{topic.name}")
    ]
    command = ["ros2", "bag", "play", own.bag, "--topics", *(name for name, _ in found)]
    command += ["--remap", *(f"{name}:={played}" for name, played in found)]
    offset = playback.start_offset(replay.bag, own.start)
    command += ["--start-offset", f"{offset:.3f}"] if offset else []
    command += ["--loop"] if own.loop else []
    return shlex.join(command)


def expected_seconds(replay: Replay) -> float:
    """Return the duration of a replay, s; 0 if unknown."""
    if replay.own.loop or replay.graph.slave != REPLAY:
        return replay.graph.duration
    return replayed_track(replay.own.bag, replay.graph, replay.own.duration).seconds


def in_lockstep(replay: Replay) -> Replay:
    """Return a replay adapted to lockstep, with the simulated handle.

    Raises
    ------
    ParameterError
        The replay needs a live graph, or the graph would refuse it.
    """
    if replay.own.loop:
        raise ParameterError("loop = true: not with --lockstep, which plays a bag once")
    if replay.graph.slave != REPLAY:
        raise ParameterError("source, slave: not with --lockstep, which replays the slave")
    if replay.graph.master == REPLAY:
        raise ParameterError("master = 'replay': not with --lockstep, which simulates the handle")
    arguments = replace(replay.graph, master=names.SIMULATED)
    graph(arguments)
    return replace(replay, graph=arguments)


def replayed_track(file: str, arguments: GraphArguments, seconds: float = 0.0) -> Track:
    """Return the played track of the slave at the graph's rate.

    Parameters
    ----------
    file : str
        Bag, or CSV or WAV file.
    arguments : GraphArguments
    seconds : float
        Duration of the recording to play, s; 0 for all.

    Raises
    ------
    ParameterError
        The track cannot be read.
    """
    parameters = playback.ReplayParameters(
        file,
        rate=arguments.recording_rate,
        column=arguments.recording_column,
        start=arguments.replay_start,
    )
    track = playback.read_track(parameters, SLAVE, arguments.rate)
    if seconds:
        track = track.part(slice(round(seconds * track.rate)))
    return played_at(track, arguments.rate, arguments.replay_speed)

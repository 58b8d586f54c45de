# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lockstep run of a condition of the graph, recorded as by the graph's recorder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from haptic_accel.bags.trial_metadata import LOCKSTEP, PREFIX, RUN, custom_data
from haptic_accel.bags.writing import write_trial
from haptic_accel.core.axes import Axes
from haptic_accel.core.model import FloatArray
from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.track import Track, quieted
from haptic_accel.core.trial import GripChange, Trial, run_trial
from haptic_accel.devices.simulated import played, textured
from haptic_accel.materials.scenes import read_scene
from haptic_accel.setup import replay
from haptic_accel.setup.arguments import SCENE, VIRTUAL, GraphArguments
from haptic_accel.setup.node_parameters import PASSIVE
from haptic_accel.setup.setup import Setup


def lockstep_trial(
    setup: Setup[GraphArguments],
    *,
    track: Track | None = None,
    recording: FloatArray | None = None,
    grips: Sequence[GripChange] = (),
    channel: ChannelParameters | None = None,
    law: str = PASSIVE,
) -> Trial:
    """Run a graph without ROS.

    Parameters
    ----------
    setup : Setup
        Simulated master, and simulated slave unless there is a track.
    track : Track, optional
        Recorded slave at the graph's rate, played to its end from the sample after the first
        force.
    recording : ndarray, optional
        Tool acceleration at the graph's rate that replaces the simulated or recorded one, m/s^2.
    grips : sequence of GripChange
        Changes of grip, in order of time.
    channel, law
        Network between the arms, as for `run_trial`.
    """
    arguments, rig = setup.arguments, setup.rig()
    compensation, controllers = setup.node("compensator")
    scene = None
    if arguments.slave == VIRTUAL and track is None:
        scene = read_scene(Path(setup.values["slave_device"][SCENE]))
    if track is None:
        duration = arguments.duration
        if recording is None:
            axes = Axes.parsed(rig.slave.tool.axes)
            recording = played(rig.slave.recording, arguments.rate, axes)  # type: ignore[attr-defined]
    else:
        duration = track.seconds + (arguments.latency + 1) / arguments.rate
    return run_trial(
        arguments.controller,
        rig,
        duration=duration,
        rate=arguments.rate,
        latency=arguments.latency,
        seed=arguments.seed,
        recording=recording,
        replayed=track,
        scene=scene,
        texture=textured(rig.slave.surface, arguments.rate, arguments.seed),
        compensation=compensation,
        controllers=controllers,
        grips=grips,
        channel=channel,
        law=law,
        composed=arguments.composed,
    )


def replayed_track(arguments: GraphArguments) -> Track:
    """Return the track that ``slave:=replay`` plays, to the end of its rest.

    Raises
    ------
    ParameterError
        The track cannot be read, or is played in a loop.
    """
    if arguments.replay_loop:
        raise ParameterError("replay_loop = true: must be false in lockstep")
    return quieted(replay.replayed_track(arguments.replay, arguments))


def record_trial(bag: Path, trial: Trial, setup: Setup[GraphArguments], start: int) -> None:
    """Write a trial as a bag with the metadata of a live graph's bag.

    Parameters
    ----------
    bag : Path
        Folder to make.
    trial : Trial
    setup : Setup
        Setup of the trial.
    start : int
        Stamp of the first sample, system time in ns.

    Raises
    ------
    ParameterError
        The folder exists already, or cannot be written.
    """
    custom = custom_data(setup.metadata())
    write_trial(bag, trial, custom | {PREFIX + RUN: json.dumps(LOCKSTEP)}, start)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The arguments of a replay: what a bag says itself, and what a user says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bag_maker import of_trial, write_bag
from haptic_accel.core import topics
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import run_trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.node_parameters import node_schema
from haptic_accel.setup.processes import graph
from haptic_accel.setup.replay import described_replay, play_command, replay_arguments

DATA = Path(__file__).parents[1] / "data"
BAG = f"bag:={DATA / 'text'}"


def test_the_bag_s_arguments_hold_but_for_those_given() -> None:
    asked = replay_arguments([f"bag:={DATA / 'text'}", "controller:=constant", "seed:=3"])
    assert asked.graph.surface == asked.inherited["surface"] == "text"
    assert asked.graph.rig == "paper"
    assert (asked.graph.controller, asked.graph.seed) == ("constant", 3)
    assert {"controller", "seed"}.isdisjoint(asked.inherited)
    assert asked.graph.rate == 1000.0
    assert asked.graph.slave == "replay"
    assert asked.graph.replay == str(DATA / "text")


@pytest.mark.parametrize(
    ("recorded", "words", "surface"),
    [
        ({"slave": "virtual", "surface": "workshop"}, [], ""),
        ({"slave": "virtual", "scene": "mine.yaml", "surface": "plywood"}, [], ""),
        ({"slave": "virtual", "scene": "mine.yaml"}, ["slave:=virtual"], "mine.yaml"),
        ({"surface": "drag.csv"}, [], ""),
        ({"surface": "recording", "recording": "drag.csv"}, [], ""),
        ({"surface": "recording", "recording": "drag.csv"}, ["slave:=simulated"], "drag.csv"),
    ],
)
def test_a_scene_or_a_recording_holds_for_a_slave_that_takes_it(
    tmp_path: Path, recorded: dict[str, str], words: list[str], surface: str
) -> None:
    written = of_trial(run_trial(duration=1.0))
    written.metadata["arguments"] |= recorded
    write_bag(tmp_path / "old", written)
    words = [f"bag:={tmp_path / 'old'}", "master:=replay", *words]
    assert replay_arguments(words).graph.surface == surface


def test_rate_is_the_speed_and_sampling_rate_the_graph_s() -> None:
    asked = replay_arguments([f"bag:={DATA / 'text'}", "rate:=0.5", "sampling_rate:=2000"])
    assert (asked.graph.replay_speed, asked.graph.rate) == (0.5, 2000.0)


def test_duration_is_of_the_recording_and_the_graph_s_of_the_clock() -> None:
    assert replay_arguments([BAG, "rate:=0.5", "duration:=0.6"]).graph.duration == 1.2
    assert replay_arguments([BAG, "rate:=0.5"]).graph.duration == 0.0


def test_a_bag_whose_arguments_are_no_longer_there_says_so(tmp_path: Path) -> None:
    bag = shutil.copytree(DATA / "text", tmp_path / "old")
    description = bag / "metadata.yaml"
    text = description.read_text().replace('"controller": "dynamic"', '"controller": "gone"')
    assert "gone" in text
    description.write_text(text)
    with pytest.raises(ParameterError, match="old: was recorded with controller = 'gone'"):
        replay_arguments([f"bag:={bag}"])


def test_every_argument_can_be_given_as_it_is_described_and_empty_ones_be_left_out() -> None:
    words = [f"{name}:={default}" for name, default, _ in described_replay()]
    given = [word for word in words if not word.endswith(":=")]
    asked, plain = replay_arguments([BAG, *given]), replay_arguments([BAG])
    assert (asked.own, asked.graph) == (plain.own, plain.graph)
    names = [name for name, _, _ in described_replay()]
    assert len(names) == len(set(names))
    assert {"bag", "rate", "loop", "controller", "record", "seed"} <= set(names)


def test_the_graph_has_the_replay_device_or_what_moves_played_stamps() -> None:
    by_device, by_topics = (
        {p.executable: p.parameters for p in graph(replay_arguments([BAG, source]).graph)}
        for source in ("source:=device", "source:=topics")
    )
    slave = by_device["composed"]["slave_device"]
    assert (slave["device"], slave["replay.file"]) == ("replay", str(DATA / "text"))
    assert "slave_device" not in by_topics
    assert by_topics["restamper"]["restamper"]["rate"] == 1000.0
    for process in (by_device, by_topics):
        for parameters in process.values():
            for node, values in parameters.items():
                assert set(values) <= set(node_schema(node))


def test_the_handle_can_be_replayed_too() -> None:
    asked = replay_arguments([BAG, "master:=replay", "slave:=simulated"])
    nodes = {node: own for p in graph(asked.graph) for node, own in p.parameters.items()}
    assert nodes["master_device"]["replay.file"] == str(DATA / "text")
    assert nodes["slave_device"]["device"] == "simulated"


def test_a_recording_that_nobody_plays_is_refused() -> None:
    with pytest.raises(ParameterError, match="replay = .*must come with slave:=replay"):
        graph(GraphArguments(replay=str(DATA / "text")))
    with pytest.raises(ParameterError, match="replay.file = ''"):
        graph(GraphArguments(slave="replay"))


def test_the_line_for_ros2_bag_play_names_every_topic_the_graph_waits_for() -> None:
    asked = replay_arguments([f"bag:={DATA / 'text'}", "source:=topics", "loop:=true"])
    line = play_command(asked)
    assert line.startswith(f"ros2 bag play {DATA / 'text'} --topics /slave/tool/acceleration ")
    for topic in topics.SLAVE_SIGNALS:
        assert f" /{topic.name}:=/played/{topic.name}" in line
    assert line.endswith("--loop")
    words = [f"bag:={DATA / 'text'}", "source:=topics", "namespace:=left"]
    for topic in topics.SLAVE_SIGNALS:
        played = f" /{topic.name}:=/left/played/{topic.name}"
        assert played in play_command(replay_arguments(words))

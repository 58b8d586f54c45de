# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.setup.arguments import GraphArguments, assigned, parse_arguments
from haptic_accel.setup.files import current_arguments, parameter_text
from haptic_accel.setup.setup import Setup
from haptic_accel.setup.words import described


def test_words_have_their_types() -> None:
    words = ["rate:=4000", "seed:=7", "record:=False", "bag:=12", "surface:=a:=b"]
    arguments = parse_arguments(words)
    assert arguments.rate == 4000.0
    assert arguments.seed == 7
    assert arguments.record is False
    assert arguments.bag == "12"
    assert arguments.surface == "a:=b"


def test_every_argument_is_described_with_its_default() -> None:
    names = [name for name, _, _ in described(GraphArguments)]
    listed = ["controller", "surface", "master", "slave", "rate", "duration", "record"]
    listed += ["bag", "params_file", "seed"]
    assert set(listed) <= set(names)
    texts = {name: text for name, _, text in described(GraphArguments)}
    assert "[Hz]" in texts["rate"]
    assert "none, constant, dynamic" in texts["controller"]
    # What is shown as a default can be given as a word.
    words = [f"{name}:={default}" for name, default, _ in described(GraphArguments)]
    assert parse_arguments(words) == GraphArguments()


@given(st.lists(st.text(), max_size=4))
def test_any_words_are_read_or_refused_in_one_line(words: list[str]) -> None:
    try:
        parse_arguments(words)
    except ParameterError as error:
        assert "\n" not in str(error).replace("\\n", "")


@given(st.sampled_from(["rate", "seed", "duration", "recording_rate"]), st.text())
def test_any_value_of_a_number_is_read_or_refused_by_name(key: str, value: str) -> None:
    try:
        arguments = parse_arguments([f"{key}:={value}"])
    except ParameterError as error:
        assert key in str(error)
    else:
        assert getattr(arguments, key) == float(value)


def test_assigned_texts_give_the_same_arguments_and_leave_to_files_what_they_decide(
    tmp_path: Path,
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(parameter_text({"/**": {"rate": 500.0}}))
    words = [f"params_file:={mine}", "namespace:=/left", "duration:=0.1", "record:=false"]
    arguments = parse_arguments(["latency:=3", *words])
    assert arguments.rate == 500.0
    assert sorted(assigned(arguments)) == sorted(["latency:=3", *words])
    assert parse_arguments(assigned(arguments)) == arguments


def test_the_virtual_slave_touches_a_scene() -> None:
    assert parse_arguments(["slave:=virtual"]).surface == "workshop"
    assert parse_arguments(["slave:=virtual", "surface:=mine.yaml"]).surface == "mine.yaml"
    assert parse_arguments(["surface:=text"]).surface == "text"


def test_the_hand_of_a_page_begins_with_the_best_controller(tmp_path: Path) -> None:
    pointer = "master:=pointer"
    assert parse_arguments([pointer]).controller == "adaptive"
    assert parse_arguments([pointer, "controller:=dynamic"]).controller == "dynamic"
    assert parse_arguments(["master:=simulated"]).controller == "dynamic"
    mine = tmp_path / "mine.yaml"
    mine.write_text(parameter_text({"compensator": {"controller": "dynamic"}}))
    assert parse_arguments([pointer, f"params_file:={mine}"]).controller == "dynamic"
    mine.write_text(parameter_text({"master_device": {"device": "pointer"}}))
    assert parse_arguments([f"params_file:={mine}"]).controller == "adaptive"


def test_a_recording_is_for_the_simulated_slave() -> None:
    assert parse_arguments(["surface:=drag.csv"]).surface == "drag.csv"
    with pytest.raises(ParameterError, match=r"surface = 'drag\.wav': .* slave:=simulated"):
        parse_arguments(["surface:=drag.wav", "slave:=serial"])


@pytest.mark.parametrize(
    ("words", "samples"),
    [("latency:=2ms", 2), ("latency:=1.5ms rate:=4e3", 6), ("latency:=0ms", 0), ("latency:=3", 3)],
)
def test_a_latency_is_a_number_of_samples_or_a_time(words: str, samples: int) -> None:
    assert parse_arguments(words.split()).latency == samples


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1.5ms", "1.5 samples at 1000 Hz, must be a whole number of samples, such as 1ms or 2ms"),
        ("soon", "must be a whole number"),
        ("ms", "must be a whole number"),
        ("-1ms", "must be a whole number, from 0 to 20"),
    ],
)
def test_a_latency_between_samples_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ParameterError, match=f"latency = .*{text}.*: {reason}|= -1: {reason}"):
        parse_arguments([f"latency:={text}"])


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("latency:=4", r"latency = 4: must be at least 5 samples, 1\.25 ms, with frame = 4"),
        ("latency:=6 rate:=4002", r"frame = 4: must divide rate = 4002 Hz into whole frames"),
        ("latency:=6 composed:=false", r"frame = 4: must be 1 with composed:=false"),
        (
            "latency:=6 side:=slave peer:=b insecure:=true",
            r"frame = 4: must be 1 with side:=slave",
        ),
        ("latency:=6 slave:=can", r"must be 1 with the device can, .*; simulated, virtual"),
        ("latency:=6 actuator:=audio", r"frame = 4: must be 1 with the device audio"),
    ],
)
def test_a_frame_that_cannot_be_held_is_refused(words: str, reason: str) -> None:
    given = ["rate:=4000", "frame:=4", *words.split()]
    unique = {word.partition(":=")[0]: word for word in given}
    with pytest.raises(ParameterError, match=reason):
        resolve(list(unique.values()))


def resolve(words: list[str]) -> None:
    """Resolve the parameters of both device nodes."""
    setup = Setup.of(parse_arguments(words))
    for node in ("master_device", "slave_device"):
        setup.node(node)


def test_the_rate_of_a_file_decides_a_latency_in_time(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(parameter_text({"**": {"rate": 2000.0}} | {"coupler": {"rate": 2000.0}}))
    found = parse_arguments([f"params_file:={mine}", "latency:=1.5ms"])
    assert (found.rate, found.latency) == (2000.0, 3)


@pytest.mark.parametrize(
    ("recorded", "surface"),
    [
        ({"surface": "text", "scene": "workshop", "recording": ""}, "text"),
        ({"slave": "virtual", "surface": "plywood", "scene": "mine.yaml"}, "mine.yaml"),
        ({"slave": "virtual", "surface": "workshop"}, "workshop"),
        ({"surface": "recording", "recording": "drag.csv"}, "drag.csv"),
        ({"slave": "replay", "surface": "recording", "recording": ""}, ""),
        ({"slave": "none"}, ""),
        ({"slave": "none", "surface": "plywood"}, "plywood"),
        ({"surface": "drag.csv"}, "drag.csv"),
    ],
)
def test_what_older_bags_call_otherwise_is_read(recorded: dict[str, str], surface: str) -> None:
    now = current_arguments(recorded)
    known = {name: value for name, value in now.items() if name in schema(GraphArguments)}
    assert GraphArguments(**known).surface == surface

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of conditions as settings of the graph, and of the check that it can deliver them."""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile
from types import SimpleNamespace

import pytest

from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.kits.study.conditions import arguments, channel, check_deliverable, live
from haptic_accel.kits.study.folder import templates
from haptic_accel.kits.study.protocol import Protocol, Value
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.materials.folders import config_folder
from haptic_accel.setup.arguments import GraphArguments

REDUCTIONS = schema(GraphArguments)["reduction"][1].choices

PROTOCOL = """title: Study
task: {task}
question: Which was stronger?
instructions: Touch twice.
consent: {{version: "1", text: I agree.}}
graph: {graph}
factors: {factors}
"""


def protocol(folder: Path, factors: str, graph: str = "{}", rest: str = "") -> Protocol:
    path = folder / "study.yaml"
    path.write_text(PROTOCOL.format(task="preference", graph=graph, factors=factors) + rest)
    return read_protocol(path)


def refusal(found: Protocol) -> str:
    with pytest.raises(ParameterError) as caught:
        check_deliverable(found)
    return str(caught.value).removeprefix(f"{found.source}:")


@pytest.mark.parametrize("path", templates().values(), ids=lambda path: path.stem)
def test_each_template_can_be_delivered(path: Path) -> None:
    found = read_protocol(path)
    if "none" in found.factors.get("reduction", ()) and "none" not in REDUCTIONS:
        pytest.skip("the graph cannot switch between three axes and a reduction yet")
    check_deliverable(found)


def test_what_holds_from_the_start_and_what_changes_live_are_apart(tmp_path: Path) -> None:
    found = protocol(
        tmp_path,
        "{latency: [1, 3], controller: [none, adaptive], gain: [0.5, 2], network: [0, '50+-10']}",
        "{seed: 4}",
    )
    assert {arguments(found, each).latency for each in found.conditions} == {1, 3}
    assert {arguments(found, each).controller for each in found.conditions} == {"dynamic"}
    assert {arguments(found, each).seed for each in found.conditions} == {4}
    expected = {"controller": "adaptive", "gain": 2.0, "network": "50+-10"}
    assert live(found, found.conditions[-1]) == expected


def test_a_recording_is_under_the_tool_from_the_start_and_a_surface_changes(
    tmp_path: Path,
) -> None:
    (tmp_path / "drag.csv").write_text("a\n" + "0.0\n1.0\n" * 500)
    found = protocol(tmp_path, "{surface: [vinyl, drag.csv]}", "{recording_rate: 1000}")
    vinyl, drag = found.conditions
    assert live(found, vinyl) == {"surface": "vinyl"}
    assert live(found, drag) == {}
    assert arguments(found, vinyl).surface == "plywood"
    assert arguments(found, drag).surface == str(tmp_path / "drag.csv")
    check_deliverable(found)


def test_files_beside_the_protocol_are_found_from_any_folder(tmp_path: Path) -> None:
    copyfile(config_folder() / "surfaces" / "vinyl.yaml", tmp_path / "own.yaml")
    copyfile(config_folder() / "rigs" / "ideal.yaml", tmp_path / "rig.yaml")
    found = protocol(tmp_path, "{surface: [own.yaml, text]}", "{params_file: rig.yaml}")
    assert live(found, found.conditions[0]) == {"surface": str(tmp_path / "own.yaml")}
    assert arguments(found, found.conditions[0]).params_file == str(tmp_path / "rig.yaml")
    check_deliverable(found)


@pytest.mark.parametrize(
    ("value", "delay", "jitter", "loss"),
    [
        (0.0, 0.0, 0.0, 0.0),
        (12.5, 0.0125, 0.0, 0.0),
        ("50+-10", 0.05, 0.01, 0.0),
        ("50,2%", 0.05, 0.0, 0.02),
        ("50+-10,2.5%", 0.05, 0.01, 0.025),
    ],
)
def test_a_network_is_a_delay_with_jitter_and_loss(
    value: Value, delay: float, jitter: float, loss: float
) -> None:
    assert channel(value) == ChannelParameters(delay, jitter, loss)


@pytest.mark.parametrize(
    ("factors", "graph", "message"),
    [
        ("{surface: [text, wood]}", "{}", "factors.surface = 'wood': must be one of plywood,"),
        ("{surface: [text, wood.csv]}", "{}", "factors.surface = 'wood.csv': must be one of ply"),
        ("{controller: [none, best]}", "{}", "factors.controller = 'best': must be one of none, "),
        ("{gain: [1, 5]}", "{}", "factors.gain = 5.0: must be from 0 to 4"),
        ("{gain: [1, high]}", "{}", "factors.gain = 'high': must be from 0 to 4"),
        ("{network: [0, slow]}", "{}", "factors.network = slow: must be a one-way delay in ms,"),
        ("{network: [0, '5,200%']}", "{}", "loss = 2.0: must be from 0 to 1"),
        ("{latency: [0, 1000]}", "{}", "factors.latency = 1000: must be a whole number, from 0"),
        ("{gain: [0, 1]}", "{rig: papre}", "graph.rig = 'papre': must be one of ideal, paper,"),
        (
            "{gain: [0, 1]}",
            "{master: absent}",
            "graph.master = 'absent': must be one of simulated",
        ),
        (
            "{surface: [text, vinyl]}",
            "{slave: can}",
            "factors.surface = text: must come with slave:= one of simulated, virtual, not can",
        ),
    ],
)
def test_what_cannot_be_delivered_is_named(
    factors: str, graph: str, message: str, tmp_path: Path
) -> None:
    line, _, found = refusal(protocol(tmp_path, factors, graph)).partition(": ")
    assert found.startswith(message)
    assert line == {"factors": "7", "graph": "6"}.get(message.partition(".")[0], "1")


def test_a_texture_that_is_not_there_is_named(tmp_path: Path) -> None:
    oak = "materials: {oak: {texture: oak.yaml}}\nobjects: {bench: {shape: plane, material: oak}}"
    (tmp_path / "scene.yaml").write_text(oak)
    found = protocol(tmp_path, "{surface: [workshop, scene.yaml]}", "{slave: virtual}")
    assert "scene.yaml:1: materials.oak.texture = 'oak.yaml': must be one of" in refusal(found)


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("levels: {factor: latency, reference: 1, values: [2, 500]}", "latency = 500: must be"),
        ("language: tlh", "language = 'tlh': must be one of de, en, es, fr, or a"),
        ("limits: {minutes: 1}", "limits.minutes = 1: must be at least 3, the expected duration"),
    ],
)
def test_a_section_that_cannot_be_delivered_is_named(
    rest: str, message: str, tmp_path: Path
) -> None:
    found = protocol(tmp_path, "{gain: [0, 1]}", rest=f"{rest}\n")
    assert refusal(found).startswith(f"8: {message}")


def test_a_disk_without_room_for_the_bags_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = protocol(tmp_path, "{gain: [0, 1]}")
    check_deliverable(found)
    full = SimpleNamespace(free=100_000_000)
    monkeypatch.setattr("shutil.disk_usage", lambda _: full)
    with pytest.raises(ParameterError, match=r"0\.1 GB are free: must be at least \d+\.\d GB"):
        check_deliverable(found)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Setup of a graph: resolved once, written to a bag, and read back."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError, warn_once
from haptic_accel.setup.arguments import GraphArguments, parse_arguments
from haptic_accel.setup.node_parameters import node_schema
from haptic_accel.setup.setup import Setup, known_arguments


@pytest.mark.parametrize(
    "words",
    [
        ["rig:=ideal", "controller:=inverse", "surface:=vinyl", "seed:=3"],
        ["rig:=three_axis", "reduction:=sum", "record:=false"],
        ["slave:=virtual", "rate:=2000", "latency:=2"],
        ["coupling:=passive", "grip:=pinch"],
    ],
)
def test_a_bag_gives_back_the_setup_that_was_written(words: list[str]) -> None:
    setup = Setup.of(parse_arguments(words))
    again = Setup.from_metadata(json.loads(setup.metadata()))
    assert again.arguments == setup.arguments
    assert again.rig() == setup.rig()
    assert again.node("compensator") == setup.node("compensator")
    assert again.node("coupler") == setup.node("coupler")


def test_an_older_bag_is_read_by_the_present_names() -> None:
    written = json.loads(Setup.of(GraphArguments()).metadata())
    written["arguments"] |= {"slave": "virtual", "scene": "workshop"}
    written["arguments"].pop("surface")
    written["parameters"]["master_device"] |= {"can_serial.handle.port": "/dev/ttyACM7"}
    written["parameters"]["master_device"].pop("serial.port")
    setup = Setup.from_metadata(written)
    assert setup.arguments.surface == "workshop"
    assert setup.node("master_device")[1]["serial"].port == "/dev/ttyACM7"


def test_without_arguments_or_with_a_wrong_one_a_bag_has_no_setup() -> None:
    with pytest.raises(ParameterError, match="does not state the arguments"):
        Setup.from_metadata({"parameters": {}})
    wrong = {"arguments": asdict(GraphArguments()) | {"rate": -1.0}, "parameters": {}}
    with pytest.raises(ParameterError, match="rate = -1"):
        Setup.from_metadata(wrong)


def test_a_bag_without_arguments_reveals_them_by_the_parameters_of_its_nodes() -> None:
    setup = Setup.of(parse_arguments(["controller:=inverse", "rate:=500", "seed:=4"]))
    written = json.loads(setup.metadata())
    found = known_arguments({"parameters": written["parameters"]})
    assert (found["controller"], found["rate"], found["seed"]) == ("inverse", 500.0, 4)
    assert known_arguments({}) == {}


def test_a_change_is_of_a_copy() -> None:
    setup = Setup.of(GraphArguments(rig="ideal"))
    stiff = setup.changed({"coupler": {"k_m": 321.0}})
    assert stiff.rig().coupling.k_m == 321.0
    assert setup.rig().coupling.k_m != 321.0
    assert stiff.arguments == setup.arguments


def test_every_parameter_of_a_running_node_is_in_the_metadata(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("coupler: {ros__parameters: {k_m: 321.0}}")
    setup = Setup.of(GraphArguments(params_file=str(mine)))
    written = json.loads(setup.metadata())["parameters"]
    assert set(written) == {"master_device", "slave_device", "coupler", "compensator"}
    for node, own in written.items():
        assert set(own) == set(node_schema(node))
    assert written["coupler"]["k_m"] == 321.0


PRESET = "master_device: {ros__parameters: {audio.preset: dualsense}}\n"
PLANT_FOUND = "compensator: {ros__parameters: {plant.delay: 0.001}}\n"


@pytest.mark.parametrize(
    ("content", "changes", "is_told"),
    [
        (PRESET, {}, True),
        (PRESET, {"controller": "inverse"}, True),
        (PRESET, {"controller": "none"}, False),
        (PRESET, {"controller": "constant"}, False),
        (PRESET, {"actuator": "device"}, False),
        (PRESET + PLANT_FOUND, {}, False),
        (PLANT_FOUND, {}, False),
    ],
)
def test_a_controller_that_needs_a_plant_tells_that_a_preset_has_none(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    content: str,
    changes: dict[str, str],
    is_told: bool,
) -> None:
    warn_once.cache_clear()
    file = tmp_path / "pad.yaml"
    file.write_text(content)
    given = {"actuator": "audio", "controller": "adaptive", **changes}
    Setup.of(GraphArguments(params_file=str(file), **given))
    told = (
        f"controller = {given['controller']}: needs the handle's plant, which is unknown with"
        " audio.preset = dualsense: a first touch, not a bench; the plant is taken as the rig's"
        " until `identify actuator:=audio` has found it, or use none or constant"
    )
    assert caplog.messages == [told] * is_told

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

"""Setup of a graph: resolved once, written to a bag, and read back."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments, parse_arguments
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


def test_an_identification_has_its_own_nodes_and_sweep() -> None:
    setup = Setup.of(IdentifyArguments(end_frequency=300.0))
    assert setup.nodes == ["master_device", "identifier", "recorder"]
    assert setup.node("identifier")[0].end_frequency == 300.0
    assert setup.node("identifier")[0].listeners == 2

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files: reading and updates."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import ODD_TEXTS, accepted, fuzz, mutated
from haptic_accel.core.model import HandleParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import config_folder, preset_file
from haptic_accel.setup.arguments import GraphArguments, parse_arguments
from haptic_accel.setup.files import (
    check_updatable,
    parameter_text,
    read_parameter_file,
    surface_parameters,
    teleop_command,
    update_parameter_file,
)
from haptic_accel.setup.node_parameters import NODES, build_parameters, node_schema
from haptic_accel.setup.setup import Setup


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "mine.yaml"


def test_values_that_nodes_share_are_read_back(tmp_path: Path) -> None:
    file, handle = tmp_path / "handle.yaml", {"m_h": 0.2}
    handled = {"handle": handle}
    nodes = {"master_device": {"simulated": handled}, "compensator": {"plant": handled}}
    file.write_text(parameter_text(nodes))
    values = read_parameter_file(file)
    assert values["master_device"] == {"simulated.handle.m_h": 0.2}
    assert values["compensator"] == {"plant.handle.m_h": 0.2}


@pytest.mark.parametrize("rig", ["ideal", "paper"])
def test_a_rig_says_what_the_devices_know(rig: str) -> None:
    values = read_parameter_file(preset_file("rig", rig))
    _, masters = build_parameters("master_device", values["master_device"])
    _, slaves = build_parameters("slave_device", values["slave_device"])
    # Table I in both.
    assert masters["simulated"].handle == HandleParameters()
    assert (masters["simulated"].mount.frequency > 0) == (rig == "paper")
    assert (slaves["simulated"].accelerometer.noise_density > 0) == (rig == "paper")


def test_a_rig_there_is_none_of_is_refused_with_those_there_are() -> None:
    with pytest.raises(ParameterError, match=r"rig = 'mine'.*ideal, paper.*\.yaml"):
        preset_file("rig", "mine")


def test_the_default_file_says_what_the_code_does() -> None:
    values = read_parameter_file(config_folder() / "teleop.yaml")
    for executable in NODES:
        schema = node_schema(executable)
        for name, value in values[executable].items():
            default = schema[name][0]
            expected = default if isinstance(default, str) else pytest.approx(default, rel=1e-3)
            assert value == expected, name


@pytest.mark.parametrize("surface", ["plywood", "text", "vinyl"])
def test_a_surface_file_leaves_nothing_of_the_surface_before(surface: str) -> None:
    # `ros2 param load` changes what the file names and nothing else.
    named = read_parameter_file(preset_file("surface", surface))["slave_device"]
    assert set(named) == set(surface_parameters(surface))


def test_a_file_may_give_every_node_the_clock_that_it_has(file: Path) -> None:
    file.write_text("/**: {ros__parameters: {use_sim_time: false, rate: 500.0}}")
    assert read_parameter_file(file)["coupler"] == {"rate": 500.0}
    file.write_text("/**: {ros__parameters: {use_sim_time: true}}")
    with pytest.raises(ParameterError, match="use_sim_time = True: must be false: .* clock"):
        read_parameter_file(file)


def test_a_delay_in_samples_is_read_as_a_time_with_one_warning(
    file: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file.write_text("compensator: {ros__parameters: {adaptive: {granted_delay: 6}}}")
    later = tmp_path / "later.yaml"
    later.write_text("compensator: {ros__parameters: {adaptive.granted_time: 0.002}}")
    around = GraphArguments(params_file=str(file), rate=4000.0)
    values = Setup.of(around).values["compensator"]
    assert values["adaptive.granted_time"] == 0.0015
    assert "adaptive.granted_delay" not in values
    assert caplog.messages == [
        f"{file}: adaptive.granted_delay = 6 samples is adaptive.granted_time = 0.0015 s at"
        " 4000 Hz; it is read until the next release"
    ]
    both = replace(around, params_file=f"{file},{later}")
    assert Setup.of(both).values["compensator"]["adaptive.granted_time"] == 0.002


DELAY, CARD = ("compensator", "inverse"), ("master_device", "audio")


@pytest.mark.parametrize(
    ("node", "part", "given", "reason"),
    [
        (*DELAY, "{granted_delay: 2.5}", "granted_delay = 2.5: must be a whole number of samples"),
        (*DELAY, "{granted_delay: -1}", "granted_delay = -1: must be a whole number of samples"),
        (*DELAY, "{granted_delay: 2, granted_time: 0.002}", "granted_delay = 2: must be left out"),
        (*CARD, "{channel: 0}", "channel = 0: must be a whole number from 1; or give audio.chan"),
        (
            *CARD,
            "{channel: '3'}",
            "channel = 3: must be a whole number from 1; or give audio.chan",
        ),
        (*CARD, "{channel: 3, channels: '4'}", "channel = 3: must be left out"),
    ],
)
def test_a_former_name_that_means_nothing_or_two_things_is_refused(
    file: Path, node: str, part: str, given: str, reason: str
) -> None:
    file.write_text(f"{node}: {{ros__parameters: {{{part}: {given}}}}}")
    with pytest.raises(ParameterError, match=re.escape(f"{file}: {part}.{reason}")):
        Setup.of(GraphArguments(params_file=str(file)))


def test_a_former_channel_of_a_sound_card_is_read_with_one_warning(
    file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file.write_text("master_device: {ros__parameters: {audio: {channel: 3}}}")
    values = Setup.of(GraphArguments(params_file=str(file))).values["master_device"]
    assert values["audio.channels"] == "3"
    assert "audio.channel" not in values
    said = "audio.channel = 3 is audio.channels = '3'; it is read until the next release"
    assert caplog.messages == [f"{file}: {said}"]


names = st.sampled_from(["coupler", "/**", "compensator", "x", "ros__parameters", "k_m"])
trees = st.recursive(
    st.one_of(st.none(), st.booleans(), st.floats(), st.text(max_size=5)),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(names, inner, max_size=3),
    max_leaves=8,
)


values = st.one_of(
    st.sampled_from(ODD_TEXTS),
    st.sampled_from(["1e5", "-1", "true", "~", "[1, a]", "{a: 1}", "2001-01-01", "!!binary aGk="]),
    st.sampled_from(["'t'", "*a", "&a 1", "!!set {a}", "!!python/name:os.system", '"\\0\\e[2J"']),
)
lines = st.builds("    {}: {}".format, st.sampled_from(sorted(node_schema("coupler"))), values)
nested = trees.map(lambda tree: yaml.safe_dump(tree, default_flow_style=True))
FILES = [*config_folder().glob("*.yaml"), *config_folder().glob("*/*.yaml")]
shipped = st.sampled_from([file.read_text(encoding="utf-8") for file in FILES])
own = st.lists(lines, max_size=4).map(
    lambda given: "\n".join(["/**:", "  ros__parameters:", "    k_m: 300.0", *given])
)
pieces = values | st.sampled_from([*"\n#|>\0\t", ": ", "  ", "- ", "<<: ", "? "])


@fuzz
@given(mutated(own, pieces) | mutated(shipped, pieces) | nested)
def test_any_damage_to_a_file_is_refused_in_one_line(file: Path, text: str) -> None:
    file.write_bytes(text.encode())

    def read() -> None:
        found = read_parameter_file(file)
        for executable in NODES:
            build_parameters(executable, found[executable])

    accepted(read)


@pytest.mark.parametrize("value", ["1_000", "0x10", "\u0661\u0662", ".nan", "1:30", "0300"])
def test_what_is_no_plain_decimal_is_no_number(file: Path, value: str) -> None:
    file.write_text(f"coupler: {{ros__parameters: {{k_m: {value}}}}}", encoding="utf-8")
    found = read_parameter_file(file)["coupler"]
    with pytest.raises(ParameterError, match=rf"k_m = '{value}': must be from 0"):
        build_parameters("coupler", found)


@pytest.mark.parametrize(
    "text",
    ["[" * 10**5, "a: &a [*a]", '"\\n": {}', '/**: {ros__parameters: {"\\e[2J": 1}}', "x" * 8**8],
    ids=["nesting", "alias", "newline", "escape", "size"],
)
def test_what_is_hostile_is_refused_in_one_line(file: Path, text: str) -> None:
    file.write_text(text)
    assert not accepted(lambda: read_parameter_file(file))


RIG = """\
# The bench by the window.
master_device:
  ros__parameters:
    device: serial
    serial.port: "/dev/ttyACM0"  # the left socket
/**/compensator:
  ros__parameters: {constant: {mass: 0.1}}
"""


def test_an_update_keeps_comments_and_all_other_values(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG)
    update_parameter_file(
        rig,
        {
            "/**": {"actuator": {"m_a": 0.02}},
            "master_device": {"serial": {"port": "/dev/ttyACM1", "calibration": {"board": "1e5"}}},
            "compensator": {"constant": {"mass": 0.13}},
        },
    )
    text = rig.read_text()
    assert text.startswith("# The bench by the window.\n")
    assert "# the left socket" in text
    values = read_parameter_file(rig, "")
    assert values["master_device"]["device"] == "serial"
    assert values["master_device"]["serial.port"] == "/dev/ttyACM1"
    assert values["master_device"]["serial.calibration.board"] == "1e5"
    assert values["compensator"]["constant.mass"] == 0.13
    assert values["compensator"]["actuator.m_a"] == 0.02
    assert [path.name for path in tmp_path.iterdir()] == ["rig.yaml"]


def test_a_new_file_runs_the_rig_alone(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    board = {"device": "serial", "serial": {"port": "/dev/ttyACM0"}}
    update_parameter_file(rig, {"/**": {"rate": 500.0}, "master_device": board})
    arguments = parse_arguments([f"params_file:={rig}"])
    assert (arguments.master, arguments.rate) == ("serial", 500.0)
    assert Setup.of(arguments).values["master_device"]["serial.port"] == "/dev/ttyACM0"


@pytest.mark.parametrize(
    "text", ["", "\n", "# The bench by the window.", "\n  # left\n\n# right\n"]
)
def test_a_file_without_content_is_that_of_a_new_rig_and_keeps_its_comments(
    text: str, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(text)
    check_updatable(rig)
    assert rig.read_text() == text
    update_parameter_file(rig, {"master_device": {"device": "serial"}})
    assert read_parameter_file(rig)["master_device"]["device"] == "serial"
    assert rig.read_text().startswith(text)


def test_a_file_of_another_form_is_left_as_it_is(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("master_device: {device: serial}")
    with pytest.raises(ParameterError, match="must hold ros__parameters"):
        update_parameter_file(rig, {"/**": {"rate": 500.0}})
    assert rig.read_text() == "master_device: {device: serial}"


def test_values_for_every_node_hold_in_any_namespace(tmp_path: Path) -> None:
    file = tmp_path / "found.yaml"
    text = parameter_text({"/**": {"actuator": {"m_a": 0.02}}})
    for written in (text, text.replace("/**:", "/**//**:")):  # as before 0.2
        file.write_text(written)
        for namespace in ("", "/left"):
            assert read_parameter_file(file, namespace)["compensator"]["actuator.m_a"] == 0.02


def test_the_next_command_has_every_file(tmp_path: Path) -> None:
    expected = ["teleop", "params_file:=a.yaml,b.yaml"]
    assert teleop_command("a.yaml", Path("b.yaml")) == expected
    found = teleop_command("a.yaml,b.yaml", Path("b.yaml"), "rate:=500")
    assert found == [*expected, "rate:=500"]

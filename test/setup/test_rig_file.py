# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.files import parameter_text, read_parameter_file
from haptic_accel.setup.rig_file import check_updatable, teleop_command, update_parameter_file
from haptic_accel.setup.setup import Setup

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

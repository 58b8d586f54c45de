# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
from pathlib import Path

import pytest
import rclpy

from haptic_accel.core.topics import ACTUATOR_FORCE, TOOL_ACCELERATION
from haptic_accel.nodes.supervised_node import message_type, quality
from running import Start


@pytest.mark.quiet
def test_doctor_reports_another_graph(haptic_accel: Start, tmp_path: Path, domain: int) -> None:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("other", context=context)
    for topic in (TOOL_ACCELERATION, ACTUATOR_FORCE):
        node.create_publisher(message_type(topic), topic.name, quality(topic))
    command = haptic_accel("doctor", "--json", "found.json")
    assert command.end() == 0, command.text
    node.destroy_node()
    rclpy.shutdown(context=context)
    figures = json.loads((tmp_path / "found.json").read_text())
    findings = {finding["name"]: finding for finding in figures["findings"]}
    keys = {"name", "level", "found", "meaning", "fix"}
    assert all(set(each) == keys for each in findings.values())
    assert all(name in command.text for name in findings)
    assert findings["other graph"]["level"] == "problem"
    assert TOOL_ACCELERATION.name in findings["other graph"]["found"]
    assert ACTUATOR_FORCE.name in findings["other graph"]["found"]
    assert findings["domain"]["found"] == str(domain)


@pytest.mark.quiet
def test_a_ros_that_cannot_be_used_is_named_with_its_reason(
    haptic_accel: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "other" / "rclpy"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("raise ImportError('made for\\nanother Python')\n")
    monkeypatch.setenv("PYTHONPATH", str(broken.parent))
    command = haptic_accel("doctor", "--json", "found.json")
    assert command.end() == 1, command.text
    command.wait_for("^haptic-accel: rclpy cannot be used: .*made for another Python$")
    assert "Traceback" not in command.text
    figures = json.loads((tmp_path / "found.json").read_text())
    assert str(broken.parent) in str(figures["findings"])

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

"""A Python without ROS 2: what runs there, and what refuses in one line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_accel.graph.middleware import NEEDS_ROS, ROS_PACKAGES, check_ros


def without_ros(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a Python that has no ROS 2."""
    hidden = f"import sys; sys.modules.update(dict.fromkeys({sorted(ROS_PACKAGES)}))"
    command = [sys.executable, "-c", f"{hidden}; {code}"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def verb(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    code = f"from haptic_accel.cli.main import main; main({[*words]})"
    return without_ros(folder, code)


@pytest.mark.parametrize(
    "words",
    [
        ("teleop", "duration:=1"),
        ("teleop", "master:=pointer", "scope:=true"),
        ("experiment",),
        ("identify",),
        ("bench", "latency"),
        ("scope",),
        ("control", "controller:=none"),
        ("record", "start"),
        ("estop", "release:=true"),
    ],
)
def test_a_verb_that_needs_ros_says_so_in_one_line(tmp_path: Path, words: tuple[str, ...]) -> None:
    done = verb(tmp_path, *words)
    name = " ".join(words[:2]) if words[0] == "bench" else words[0]
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"haptic-accel: {name} {NEEDS_ROS}\n"
    assert not [*tmp_path.iterdir()]


def test_a_wrong_word_is_named_before_ros_is_missed(tmp_path: Path) -> None:
    done = verb(tmp_path, "control", "controller:=wrong")
    assert done.returncode == 2
    assert "controller = 'wrong'" in done.stderr


def test_a_node_says_that_it_needs_ros(tmp_path: Path) -> None:
    done = without_ros(tmp_path, "from haptic_accel.nodes.start import coupler; coupler()")
    assert (done.returncode, done.stderr) == (1, f"coupler {NEEDS_ROS}\n")


def test_doctor_reports_that_ros_is_not_installed(tmp_path: Path) -> None:
    done = verb(tmp_path, "doctor", "--json", "found.json")
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads((tmp_path / "found.json").read_text())["findings"]
    (ros,) = [finding for finding in found if finding["name"] == "ROS 2"]
    assert (ros["level"], ros["found"]) == ("warning", "not installed")


def test_an_installed_ros_passes() -> None:
    pytest.importorskip("rclpy")
    check_ros()

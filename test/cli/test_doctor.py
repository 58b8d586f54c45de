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

from __future__ import annotations

import fcntl
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rclpy

from haptic_accel.cli import doctor
from haptic_accel.cli.doctor import Finding
from haptic_accel.core.topics import ACTUATOR_FORCE, TOOL_ACCELERATION
from haptic_accel.nodes.middleware import middleware_defaults
from haptic_accel.nodes.topic_node import message_type, quality
from running import Command

Start = Callable[..., Command]

# CapEff of a privileged shell and of a Docker container with its default capabilities.
PRIVILEGED = "Name:\tpython\nCapEff:\t000001ffffffffff\n"
CONTAINER = "Name:\tpython\nCapEff:\t00000000a80425fb\n"


def loop(missed: int) -> dict[str, Any]:
    """Return what an empty loop measured in which so many ticks came too late."""
    return {"missed": missed, "of": 2000, "lateness_us": {"max": 412.3}}


@pytest.mark.parametrize(
    ("finding", "level", "words"),
    [
        (doctor.governor([]), "ok", ["VM"]),
        (doctor.governor(["performance"] * 4), "ok", ["performance"]),
        (doctor.governor(["performance", "powersave"]), "warning", ["powersave on 1 of 2"]),
        (doctor.realtime_permission(0, 0, PRIVILEGED), "ok", ["up to 99", "down to -20"]),
        (doctor.realtime_permission(0, 0, CONTAINER), "warning", ["up to 0", "down to 0"]),
        # RLIMIT_NICE of getrlimit(2): the ceiling of nice is 20 less its value.
        (doctor.realtime_permission(98, 30, CONTAINER), "ok", ["up to 98", "down to -10"]),
        (doctor.realtime_permission(-1, -1, ""), "ok", ["up to 99", "down to -20"]),
        (doctor.processor(1, ""), "problem", ["1"]),
        (doctor.processor(2, ""), "ok", ["2, too few for composed:=false"]),
        (doctor.processor(8, ""), "ok", ["8"]),
        (doctor.processor(8, "max 100000"), "ok", ["8"]),
        (doctor.processor(8, "150000 100000"), "warning", ["8", "1.5"]),
        (doctor.load(0.3, 2), "ok", ["0.3", "2 cores"]),
        (doctor.load(1.5, 2), "warning", ["1.5"]),
        (doctor.load(2.5, 2), "problem", ["2.5"]),
        (doctor.preemption("#1 SMP PREEMPT_DYNAMIC Debian", ""), "ok", ["PREEMPT_DYNAMIC"]),
        (doctor.preemption("#1 SMP", "1"), "ok", ["PREEMPT_RT"]),
        (doctor.preemption("#1 SMP Debian", "0"), "warning", ["not preemptible"]),
        (doctor.swap(0), "ok", ["0 MB"]),
        (doctor.swap(5_000_000), "warning", ["5 MB"]),
        (doctor.receive_buffer("4194304"), "ok", ["4194304"]),
        (doctor.receive_buffer("212992"), "warning", ["212992"]),
        (doctor.receive_buffer(""), "ok", ["unknown"]),
        (doctor.executor("EventsExecutor of rclpy.executors"), "ok", ["EventsExecutor"]),
        (doctor.executor("SingleThreadedExecutor"), "warning", ["SingleThreadedExecutor"]),
        (doctor.timer_slack("1"), "ok", ["1 ns"]),
        (doctor.timer_slack("50000"), "warning", ["50000 ns"]),
        (doctor.timer_slack(""), "ok", ["unknown"]),
        (doctor.middleware("rmw_fastrtps_cpp"), "ok", ["rmw_fastrtps_cpp"]),
        (doctor.middleware("rmw_cyclonedds_cpp"), "warning", ["rmw_cyclonedds_cpp"]),
        (doctor.rate_held(loop(2)), "ok", ["2 of 2000 ticks more than 0.25 periods late"]),
        (doctor.rate_held(loop(3)), "warning", ["3 of 2000", "the latest by 412 us"]),
        (doctor.domain(""), "ok", ["0"]),
        (doctor.domain("101"), "ok", ["101"]),
        (doctor.domain("102"), "warning", ["102"]),
        (doctor.other_graph([]), "ok", ["none"]),
        (doctor.other_graph(["slave/tool/acceleration"]), "problem", ["slave/tool/acceler"]),
    ],
)
def test_a_finding_has_a_level_and_if_not_ok_a_meaning_and_a_fix(
    finding: Finding, level: str, words: list[str]
) -> None:
    assert finding.level == level
    assert all(word in finding.found for word in words), finding
    assert bool(finding.meaning) == bool(finding.fix) == (level != "ok")
    assert "\n" not in finding.found + finding.meaning + finding.fix


@pytest.mark.parametrize(
    ("reach", "localhost_only", "level"),
    [
        ("LOCALHOST", "", "warning"),
        ("localhost", "0", "warning"),
        ("SUBNET", "1", "warning"),
        ("SUBNET", "", "warning"),
        ("", "", "warning"),
        ("SYSTEM_DEFAULT", "0", "warning"),
        ("OFF", "", "problem"),
    ],
)
def test_discovery_beyond_the_machine_is_a_choice_and_none_a_mistake(
    reach: str, localhost_only: str, level: str
) -> None:
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": reach, "ROS_LOCALHOST_ONLY": localhost_only}
    assert doctor.discovery_range(environment).level == level


def test_the_packages_own_range_and_profile_are_well() -> None:
    environment = {"ROS_LOCALHOST_ONLY": "", **middleware_defaults({})}
    assert doctor.discovery_range(environment).level == "ok"
    seen = doctor.discovery_range({**environment, "ROS_LOCALHOST_ONLY": "1"})
    assert "shared memory" in seen.meaning


@pytest.mark.parametrize(
    ("distribution", "variable"),
    [
        ("jazzy", "FASTRTPS_DEFAULT_PROFILES_FILE"),
        ("kilted", "FASTDDS_DEFAULT_PROFILES_FILE"),
        ("rolling", "FASTDDS_DEFAULT_PROFILES_FILE"),
    ],
)
def test_the_profile_is_the_one_that_this_fast_dds_reads(
    tmp_path: Path, distribution: str, variable: str
) -> None:
    ours, mine = tmp_path / "config" / "fastdds.xml", tmp_path / "mine.xml"
    ours.parent.mkdir()
    ours.touch()
    mine.touch()
    both = dict.fromkeys(("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"), ours)
    environment = {name: str(path) for name, path in both.items()}

    def profile(path: Path) -> Finding:
        return doctor.profile(distribution, {**environment, variable: str(path)}, ours.parent)

    assert "(this package)" in profile(ours).found
    assert profile(mine).level == "ok"
    assert str(mine) in profile(mine).found
    assert variable in profile(mine).found
    assert profile(tmp_path / "gone.xml").level == "problem"


def segment(folder: Path, name: str, size: int) -> Path:
    """Write a segment as Fast DDS does, and return its lock file."""
    (folder / name).write_bytes(bytes(size))
    lock = folder / f"{name}_el"
    lock.touch()
    return lock


def test_leftovers_are_the_segments_that_nobody_holds(tmp_path: Path) -> None:
    segment(tmp_path, "fastrtps_0123456789abcdef", 1_500_000)
    segment(tmp_path, "fastdds_fedcba9876543210", 1_000_000)
    segment(tmp_path, "fastrtps_port7411", 4_000_000)
    segment(tmp_path, "someone_elses", 4_000_000)
    before = sorted(tmp_path.iterdir())
    with segment(tmp_path, "fastrtps_aaaaaaaaaaaaaaaa", 8_000_000).open() as living:
        fcntl.flock(living, fcntl.LOCK_EX)
        finding = doctor.shared_memory(tmp_path)
    assert finding.level == "warning"
    assert "2 segments" in finding.found
    assert "2.5 MB" in finding.found
    assert set(before) < set(tmp_path.iterdir())


def test_no_leftovers_where_there_is_nothing(tmp_path: Path) -> None:
    assert "0 segments" in doctor.shared_memory(tmp_path).found
    gone = doctor.shared_memory(tmp_path / "not there")
    assert gone.level == "warning"
    assert "0 MB free" in gone.found


def ros(prefix: Path) -> tuple[Path, Path]:
    """Make what tells a ROS 2; return its prefix and its folder of Python packages."""
    packages = prefix / "lib" / "python3" / "site-packages"
    (packages / "rclpy").mkdir(parents=True)
    (prefix / "share" / "ament_index").mkdir(parents=True)
    return prefix, packages


def test_a_sourced_ros_is_a_problem_only_beside_one_of_the_environments_own(
    tmp_path: Path,
) -> None:
    venv, own_packages = ros(tmp_path / "venv")
    native, packages = ros(tmp_path / "opt")
    sourced = {"PYTHONPATH": f"/mine:{packages}", "AMENT_PREFIX_PATH": str(native)}
    mixed = doctor.sourced_ros(sourced, venv)
    assert mixed.level == "problem"
    assert str(packages) in mixed.found
    assert str(native) in mixed.found
    assert "/mine" not in mixed.found
    assert doctor.sourced_ros({"AMENT_PREFIX_PATH": str(native)}, venv).level == "problem"
    assert doctor.sourced_ros(sourced, tmp_path / "usr").level == "ok"
    assert doctor.sourced_ros({"PYTHONPATH": str(own_packages)}, venv).level == "ok"
    assert doctor.sourced_ros({}, venv).level == "ok"


def test_every_machine_can_be_looked_at() -> None:
    findings = list(doctor.machine_findings())
    assert len({finding.name for finding in findings}) == len(findings)
    assert {finding.level for finding in findings} <= {"ok", "warning", "problem"}


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
    assert all(
        set(each) == {"name", "level", "found", "meaning", "fix"} for each in findings.values()
    )
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


@pytest.mark.quiet
def test_a_file_that_cannot_be_written_is_named(haptic_accel: Start) -> None:
    command = haptic_accel("doctor", "--json", "no/such/folder.json")
    assert command.end() == 2, command.text
    assert (
        command.lines[-1]
        == "haptic-accel: json = 'no/such/folder.json': No such file or directory"
    )

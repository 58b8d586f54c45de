# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import Any

import psutil
import pytest

from haptic_accel.graph import machine
from haptic_accel.graph.domain import middleware_defaults
from haptic_accel.graph.machine import Finding
from running import called

# CapEff of a privileged shell and of a Docker container with its default capabilities.
PRIVILEGED = "Name:\tpython\nCapEff:\t000001ffffffffff\n"
CONTAINER = "Name:\tpython\nCapEff:\t00000000a80425fb\n"


RTPS, DDS = "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"


def loop(missed: int) -> dict[str, Any]:
    """Return what an empty loop measured in which so many ticks came too late."""
    return {"missed": missed, "of": 2000, "lateness_us": {"max": 412.3}}


@pytest.mark.parametrize(
    ("finding", "level", "words"),
    [
        (machine.governor([]), "ok", ["VM"]),
        (machine.governor(["performance"] * 4), "ok", ["performance"]),
        (machine.governor(["performance", "powersave"]), "warning", ["powersave on 1 of 2"]),
        (machine.realtime_permission(0, 0, PRIVILEGED), "ok", ["up to 99", "down to -20"]),
        (machine.realtime_permission(0, 0, CONTAINER), "warning", ["up to 0", "down to 0"]),
        # RLIMIT_NICE of getrlimit(2): the ceiling of nice is 20 less its value.
        (machine.realtime_permission(98, 30, CONTAINER), "ok", ["up to 98", "down to -10"]),
        (machine.realtime_permission(-1, -1, ""), "ok", ["up to 99", "down to -20"]),
        (machine.processor(1, ""), "problem", ["1"]),
        (machine.processor(2, ""), "ok", ["2, too few for composed:=false"]),
        (machine.processor(8, ""), "ok", ["8"]),
        (machine.processor(8, "max 100000"), "ok", ["8"]),
        (machine.processor(8, "150000 100000"), "warning", ["8", "1.5"]),
        (machine.load(0.3, 2), "ok", ["0.3", "2 cores"]),
        (machine.load(1.5, 2), "warning", ["1.5"]),
        (machine.load(2.5, 2), "problem", ["2.5"]),
        (machine.preemption("#1 SMP PREEMPT_DYNAMIC Debian", ""), "ok", ["PREEMPT_DYNAMIC"]),
        (machine.preemption("#1 SMP", "1"), "ok", ["PREEMPT_RT"]),
        (machine.preemption("#1 SMP Debian", "0"), "warning", ["not preemptible"]),
        (machine.swap(0), "ok", ["0 MB"]),
        (machine.swap(5_000_000), "warning", ["5 MB"]),
        (machine.receive_buffer("4194304"), "ok", ["4194304"]),
        (machine.receive_buffer("212992"), "warning", ["212992"]),
        (machine.receive_buffer(""), "ok", ["unknown"]),
        (machine.executor("EventsExecutor of rclpy.executors"), "ok", ["EventsExecutor"]),
        (machine.executor("SingleThreadedExecutor"), "warning", ["SingleThreadedExecutor"]),
        (machine.timer_slack("1"), "ok", ["1 ns"]),
        (machine.timer_slack("50000"), "warning", ["50000 ns"]),
        (machine.timer_slack(""), "ok", ["unknown"]),
        (machine.middleware("rmw_fastrtps_cpp"), "ok", ["rmw_fastrtps_cpp"]),
        (machine.middleware("rmw_cyclonedds_cpp"), "warning", ["rmw_cyclonedds_cpp"]),
        (machine.rate_held(loop(2)), "ok", ["2 of 2000 ticks more than 0.25 periods late"]),
        (machine.rate_held(loop(3)), "warning", ["3 of 2000", "the latest by 412 us"]),
        (machine.domain(""), "ok", ["0"]),
        (machine.domain("101"), "ok", ["101"]),
        (machine.domain("102"), "warning", ["102"]),
        (machine.other_graph([]), "ok", ["none"]),
        (machine.other_graph(["slave/tool/acceleration"]), "problem", ["slave/tool/acceler"]),
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
    ("reach", "localhost_only"),
    [
        *(("LOCALHOST", ""), ("localhost", "0"), ("SUBNET", "1"), ("SUBNET", ""), ("", "")),
        *(("SYSTEM_DEFAULT", "0"), ("OFF", "")),
    ],
)
def test_discovery_beyond_the_machine_is_a_choice_and_none_a_mistake(
    reach: str, localhost_only: str
) -> None:
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": reach, "ROS_LOCALHOST_ONLY": localhost_only}
    level = machine.discovery_range(environment).level
    assert level == ("problem" if reach == "OFF" else "warning")


def test_the_packages_own_range_and_profile_are_well() -> None:
    environment = {"ROS_LOCALHOST_ONLY": "", **middleware_defaults({})}
    assert machine.discovery_range(environment).level == "ok"
    seen = machine.discovery_range({**environment, "ROS_LOCALHOST_ONLY": "1"})
    assert "shared memory" in seen.meaning


PROFILES = [("jazzy", RTPS), ("kilted", DDS), ("rolling", DDS)]


@pytest.mark.parametrize(("distribution", "variable"), PROFILES)
def test_the_profile_is_the_one_that_this_fast_dds_reads(
    tmp_path: Path, distribution: str, variable: str
) -> None:
    ours, mine = tmp_path / "config" / "fastdds.xml", tmp_path / "mine.xml"
    ours.parent.mkdir()
    ours.touch()
    mine.touch()
    environment = dict.fromkeys((RTPS, DDS), str(ours))

    def profile(path: Path) -> Finding:
        return machine.profile(distribution, {**environment, variable: str(path)}, ours.parent)

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
        finding = machine.shared_memory(tmp_path)
    assert finding.level == "warning"
    assert "2 segments" in finding.found
    assert "2.5 MB" in finding.found
    assert set(before) < set(tmp_path.iterdir())


def test_no_leftovers_where_there_is_nothing(tmp_path: Path) -> None:
    assert "0 segments" in machine.shared_memory(tmp_path).found
    gone = machine.shared_memory(tmp_path / "not there")
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
    mixed = machine.sourced_ros(sourced, venv)
    assert mixed.level == "problem"
    assert str(packages) in mixed.found
    assert str(native) in mixed.found
    assert "/mine" not in mixed.found
    assert machine.sourced_ros({"AMENT_PREFIX_PATH": str(native)}, venv).level == "problem"
    assert machine.sourced_ros(sourced, tmp_path / "usr").level == "ok"
    assert machine.sourced_ros({"PYTHONPATH": str(own_packages)}, venv).level == "ok"
    assert machine.sourced_ros({}, venv).level == "ok"


@pytest.mark.parametrize("name", [b"python", b"\xff"])
def test_every_machine_can_be_looked_at_by_a_process_of_any_name(name: bytes) -> None:
    with called(name):
        findings = list(machine.machine_findings())
    assert len({finding.name for finding in findings}) == len(findings)
    assert {finding.level for finding in findings} <= {"ok", "warning", "problem"}


def test_the_swapped_memory_is_that_of_the_kernel() -> None:
    (check,) = (each for each in machine.machine_findings() if each.name == "swap")
    used = psutil.swap_memory().used / 1e6
    assert float(check.found.split()[0]) == pytest.approx(used, rel=0.1, abs=20.0)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The wheel, built from the source distribution, installed without a clone and without ROS."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import mkdtemp

import pytest

from haptic_accel.graph.domain import NEEDS_ROS

SOURCE = Path(__file__).resolve().parents[2]

USER = "nobody"
"""User for the commands, if the tests are run by root."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (SOURCE / ".git").exists(), reason="is not a clone"),
]


def environment() -> dict[str, str]:
    """Return the environment without ROS 2 and without this clone."""
    left_out = ("AMENT_", "COLCON_", "PYTHON", "ROS_", "RMW_", "_ROS_", "LD_LIBRARY_PATH")
    return {key: value for key, value in os.environ.items() if not key.startswith(left_out)}


def run(*command: str | Path, cwd: Path) -> None:
    done = subprocess.run(
        [*map(str, command)], env=environment(), cwd=cwd, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """Return an environment with the wheel, in a path with spaces that every user may read."""
    folder = Path(mkdtemp(prefix="a wheel "))
    folder.chmod(0o755)
    tracked = subprocess.run(
        ["git", "-C", SOURCE, "ls-files", "-z"], capture_output=True, text=True, check=True
    ).stdout
    for name in filter(None, tracked.split("\0")):
        target = folder / "source" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(SOURCE / name, target)
    # Without --sdist and --wheel, the wheel is built from the source distribution.
    run(sys.executable, "-m", "build", "--outdir", folder / "dist", ".", cwd=folder / "source")
    (wheel,) = (folder / "dist").glob("*.whl")
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, cwd=folder)
    run(interpreter(), "-m", "venv", "--without-pip", folder / "venv", cwd=folder)
    of_venv = ("--python", folder / "venv/bin/python")
    run(sys.executable, "-m", "pip", *of_venv, "install", "-q", wheel, cwd=folder)
    shutil.rmtree(folder / "source")
    work = folder / "work"
    work.mkdir()
    work.chmod(0o777)
    yield folder
    shutil.rmtree(folder)


def as_user(place: Path) -> list[str]:
    """Return the words that run a command as another user, if that user may run this Python."""
    if os.geteuid() != 0 or not shutil.which("setpriv"):
        return []
    other = ["setpriv", f"--reuid={USER}", "--regid=nogroup", "--clear-groups"]
    command = [*other, str(place / "venv/bin/haptic-accel"), "--version"]
    return other if subprocess.run(command, check=False).returncode == 0 else []


def interpreter() -> str:
    """Return the system's Python, which every user may run, or this one if that is too old."""
    system = "/usr/bin/python3"
    code = "import sys, venv; sys.exit(sys.version_info < (3, 10))"
    usable = os.access(system, os.X_OK) and not subprocess.run([system, "-c", code]).returncode
    return system if usable else sys.executable


def haptic_accel(place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [*as_user(place), str(place / "venv/bin/haptic-accel"), *words]
    home = environment() | {"HOME": str(place / "work")}
    return subprocess.run(
        command, env=home, cwd=place / "work", capture_output=True, text=True, check=False
    )


FREE_OF_ROS = (
    "experiment --lockstep duration:=1 --controllers none --jobs 1 --out out",
    "analyze out/bags/text_none --out report",
    "bag info out/bags/text_none",
    "replay out/bags/text_none --lockstep controller:=inverse",
    "design",
    "texture render plywood --speed 80 --force 1 --out wood.wav",
    "doctor",
)
"""Command lines that run in this order without ROS 2."""


def test_the_wheel_runs_without_ros_and_refuses_graphs_in_one_line(place: Path) -> None:
    """One test, as the commands build on each other, and the installation takes long."""
    for words in FREE_OF_ROS:
        done = haptic_accel(place, *words.split())
        assert (words, done.returncode, done.stderr) == (words, 0, "")
    for words in ("teleop", "experiment", "record start", "estop release:=true"):
        done = haptic_accel(place, *words.split())
        line = f"haptic-accel: {words.split()[0]} {NEEDS_ROS}\n"
        assert (words, done.returncode, done.stderr) == (words, 1, line)

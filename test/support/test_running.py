# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the separation of tests, and of the detection of a stalled machine."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from running import piped, processes_of, python, reserved_domain, wait_until

HERE = Path(__file__).parent
TESTS = HERE.parent


def test_a_domain_is_given_once_also_to_other_processes() -> None:
    script = "from running import reserved_domain as r\nwith r() as n: print(n, flush=1); input()"
    words = [sys.executable, "-c", script]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    others = [subprocess.Popen(words, cwd=HERE, **pipes) for _ in range(2)]
    with reserved_domain() as first, reserved_domain() as second:
        numbers = [int(other.stdout.readline()) for other in others if other.stdout]
        assert len({first, second, *numbers}) == 4
        for other in others:
            other.communicate("\n")


def test_a_domain_in_which_something_runs_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("running.DOMAINS", range(1, 3))
    environment = os.environ | {"ROS_DOMAIN_ID": "1"}
    with subprocess.Popen(["sleep", "60"], env=environment) as stranger:
        try:
            # The kernel shows the environment of a new process a moment after its start.
            wait_until(lambda: any(processes_of(1)), "the stranger is seen")
            for _ in range(5):
                with reserved_domain() as number:
                    assert number == 2
            assert stranger.poll() is None
        finally:
            stranger.kill()


def test_a_machine_that_stands_still_is_noticed() -> None:
    script = (
        "from running import StallWatch\n"
        "with StallWatch() as watch:\n  print(flush=True); input()\nprint(watch.longest)"
    )
    with piped(HERE, "-c", script) as child:
        assert child.stdout
        child.stdout.readline()
        child.send_signal(signal.SIGSTOP)
        threading.Event().wait(0.6)
        child.send_signal(signal.SIGCONT)
        printed, _ = child.communicate("\n")
    assert float(printed) >= 0.5


SUITE = """
import pytest
from running import MachineStoodStillError

RUNS = []

@pytest.mark.parametrize("number", range({tests}))
@pytest.mark.live
def test_the_machine_was_to_blame(number):
    RUNS.append(number)
    if RUNS.count(number) == 1:
        raise MachineStoodStillError("for 1.00 s")

@pytest.mark.{marker}
def test_what_fails_for_another_reason():
    RUNS.append("other")
    assert RUNS.count("other") == {fails}
"""


def suite(folder: Path, content: str = "", **values: object) -> subprocess.CompletedProcess[str]:
    """Run a small suite with this conftest and settings."""
    (folder / "test_small.py").write_text(content or SUITE.format(**values))
    (folder / "conftest.py").write_text((TESTS / "conftest.py").read_text())
    settings = (TESTS.parent / "pyproject.toml").read_text()
    own = settings.replace('pythonpath = ["test/support"', f'pythonpath = ["{HERE}"')
    (folder / "pyproject.toml").write_text(own)
    return python("-m", "pytest", "-p", "no:cacheprovider", "test_small.py", cwd=folder)


def test_what_the_machine_is_to_blame_for_is_run_again_and_listed(tmp_path: Path) -> None:
    done = suite(tmp_path, tests=3, marker="live", fails=1)
    assert done.returncode == 0, done.stdout
    assert "3 run again, 3 are allowed" in done.stdout
    listed = "test_the_machine_was_to_blame[0]: running.MachineStoodStillError: for 1.00 s"
    assert listed in done.stdout


STOPPED = """
import os
import signal
import subprocess
import pytest

RUNS = []

@pytest.mark.live
def test_that_is_stopped():
    RUNS.append(0)
    if len(RUNS) == 1:
        subprocess.Popen(["sh", "-c", f"sleep 1; kill -CONT {os.getpid()}"])
        os.kill(os.getpid(), signal.SIGSTOP)
        raise AssertionError("no sample came\\nin two lines")
"""


@pytest.mark.slow
def test_a_failure_beside_a_stall_is_run_again_and_listed_with_its_reason(tmp_path: Path) -> None:
    done = suite(tmp_path, content=STOPPED)
    assert done.returncode == 0, done.stdout
    line = (
        r"test_that_is_stopped: running.MachineStoodStillError: for \S+ s, beside: no sample came"
    )
    assert re.search(f"{line}$", done.stdout, re.MULTILINE), done.stdout


def test_no_other_failure_is_run_again(tmp_path: Path) -> None:
    done = suite(tmp_path, tests=0, marker="live", fails=2)
    assert done.returncode == 1, done.stdout
    assert "1 failed" in done.stdout
    assert "run again" not in done.stdout


@pytest.mark.slow
def test_more_than_three_reruns_fail_the_session(tmp_path: Path) -> None:
    done = suite(tmp_path, tests=4, marker="live", fails=1)
    assert "5 passed" in done.stdout
    assert done.returncode == 1, done.stdout

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import runs
from haptic_accel.cli import workers as module
from haptic_accel.cli.output import StoppedError
from haptic_accel.cli.workers import Workers
from haptic_accel.core.parameters import ParameterError
from running import PATIENCE

STUCK = f"""
import sys
sys.path[:0] = [{str(Path(runs.__file__).parent)!r}]
import runs
from haptic_accel.cli.workers import Workers
list(Workers(2).map(runs.endless, range(2), lambda: False))
"""
"""Verb whose runs never end; each prints its process."""


def never() -> bool:
    return False


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Start a cluster as a lab does, of processes of this machine; yield its address."""
    distributed = pytest.importorskip("distributed")
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": str(Path(runs.__file__).parent)}
    shared = ("--scheduler-file", str(file), "--no-dashboard")
    programs = (
        ("dask_scheduler", "--host", "127.0.0.1", "--port", "0", *shared),
        ("dask_worker", "--nworkers", "2", "--nthreads", "1", *shared),
    )
    with (folder / "log").open("w") as log:
        given: Any = {"env": environment, "cwd": folder, "stdout": log, "stderr": log}
        started = [
            subprocess.Popen([sys.executable, "-m", f"distributed.cli.{program}", *words], **given)
            for program, *words in programs
        ]
        while not (file.exists() and file.read_text().endswith("}")):
            assert started[0].poll() is None, (folder / "log").read_text()
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        # A worker that is killed while another starts takes that one with it.
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
        yield address
        for process in reversed(started):
            process.terminate()
            process.wait()


@pytest.fixture(params=["processes", "cluster"])
def workers(request: pytest.FixtureRequest) -> Workers:
    return Workers(2, request.getfixturevalue("scheduler") * (request.param == "cluster"))


def test_results_come_in_the_order_of_the_items(workers: Workers) -> None:
    items = [0.5, 0.0, 0.1, 0.0]
    assert [*workers.map(runs.rested, items, never)] == items


def test_a_lost_process_loses_nothing(workers: Workers, tmp_path: Path) -> None:
    items = [(number, tmp_path) for number in range(8)]
    assert [*workers.map(runs.killed_once, items, never)] == [-number for number in range(8)]
    assert (tmp_path / "was here").exists()


@pytest.mark.slow
def test_an_item_that_ends_every_process_is_given_up(workers: Workers) -> None:
    with pytest.raises(StoppedError, match="processes were lost 3 times without a result"):
        [*workers.map(runs.killed, [1], never)]


def test_an_error_of_a_run_is_that_of_the_verb(workers: Workers) -> None:
    with pytest.raises(ParameterError, match="number = 7: must be another"):
        [*workers.map(runs.refused, [7], never)]


def test_runs_end_once_they_have_to(workers: Workers) -> None:
    asked = []

    def soon() -> bool:
        asked.append(time.monotonic())
        return asked[-1] > asked[0] + 1.0

    assert [*workers.map(runs.rested, [0.0, 5.0, 5.0, 5.0], soon)] == [0.0]


def test_processes_end_with_a_killed_verb() -> None:
    verb = subprocess.Popen([sys.executable, "-c", STUCK], stdout=subprocess.PIPE, text=True)
    assert verb.stdout
    processes = {int(verb.stdout.readline()) for _ in range(2)}
    verb.kill()
    verb.wait()
    while any(map(_runs, processes)):
        time.sleep(0.05)


def _runs(process: int) -> bool:
    try:
        return b"\nState:\tZ" not in Path(f"/proc/{process}/status").read_bytes()
    except OSError:  # it was collected
        return False


def test_a_worker_with_other_software_is_refused(
    scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = module.software() | {"numpy": "0.1"}
    monkeypatch.setattr(module, "software", lambda: here)
    with pytest.raises(ParameterError, match=r"executor: numpy [\d.]+ on .*, must be 0.1 as here"):
        [*Workers(1, scheduler).map(runs.negative, [1.0], never)]


@pytest.mark.parametrize("address", ["nonsense", "http://127.0.0.1:80", "tcp://127.0.0.1"])
def test_an_address_of_no_scheduler_is_refused(address: str) -> None:
    with pytest.raises(ParameterError, match=f"^executor = '{address}': must be tcp://HOST:PORT"):
        Workers(1, address).map(runs.negative, [1.0], never)


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CONNECTING", 0.5)
    with pytest.raises(ParameterError, match="^executor = 'tcp://127.0.0.1:1': the scheduler"):
        Workers(1, "tcp://127.0.0.1:1").map(runs.negative, [1.0], never)


@pytest.mark.slow
def test_a_cluster_gives_the_same_to_the_last_digit(
    scheduler: str, ran: Callable[..., str], here: Path
) -> None:
    for name, engine in (("here", ["--jobs", "1"]), ("there", ["--executor", scheduler])):
        ran(
            *("experiment", "--lockstep", "surface:=text", "duration:=2", "--out", name),
            *("--controllers", "none,inverse", *engine, "--json", f"{name}.json"),
        )
    texts = [(here / f"{name}.json").read_text() for name in ("here", "there")]
    by_processes, by_cluster = (json.loads(text)["conditions"] for text in texts)
    assert len(by_processes) == 2
    assert by_cluster == by_processes

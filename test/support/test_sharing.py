# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of graphs that several tests look at."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from sharing import SharedGraph, own_domain

PROGRAM = """
import os, signal
try:
    while os.path.exists("stalled"):
        signal.pause()
    print("[coupler]: engaged", flush=True)
    signal.pause()
except KeyboardInterrupt:
    raise SystemExit({status})
"""


def graph_like(folder: Path, domain: int, status: int, stalled: int = -1) -> SharedGraph:
    """Return a shared program that passes for a graph.

    It has an exit status at Ctrl-C, and a start that never engages the arms.
    """
    numbers = iter(range(10))

    def new_folder() -> Path:
        number = next(numbers)
        made = folder / str(number)
        made.mkdir()
        if number == stalled:
            (made / "stalled").touch()
        return made

    return SharedGraph(domain, ["-c", PROGRAM.format(status=status)], new_folder)


def test_a_shared_graph_starts_once_and_anew_where_it_has_died(tmp_path: Path) -> None:
    with own_domain() as domain:
        graph = graph_like(tmp_path, domain, 0)
        graph.run()
        first = graph.command
        graph.run()
        assert graph.command is first
        os.kill(first.process.pid, signal.SIGKILL)
        first.end()
        graph.run()
        assert graph.folder == tmp_path / "1"
        assert graph.command.process.poll() is None
        graph.end()
        graph.close()
        assert graph.command.process.returncode == 0


def test_a_shared_graph_that_does_not_end_cleanly_fails_its_last_test(tmp_path: Path) -> None:
    with own_domain() as domain:
        graph = graph_like(tmp_path, domain, 1)
        graph.run()
        with pytest.raises(AssertionError, match="engaged"):
            graph.end()

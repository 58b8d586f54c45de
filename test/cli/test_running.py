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

"""A verb that runs a graph, behind a terminal or a pipe that fails it; a script is the graph."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from running import PATIENCE, wait_until

VERB = """
import sys
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.running import run_shown
from haptic_accel.graph import supervisor
from haptic_accel.graph.processes import Process
supervisor.command = lambda process, folder: [sys.executable, "-c", sys.argv[1]]
try:
    run_shown([Process("talking", {})], endless=True)
except StoppedError as end:
    print(end, file=sys.stderr)
    sys.exit(end.status)
"""

TALKING = """
import pathlib, signal, time
ended = []
signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
line = 0
while not ended:
    print(line, "x" * 1000)
    pathlib.Path("lines").write_text(str(line := line + 1))
    time.sleep(0.001)
pathlib.Path("ended in order").touch()
"""


class Verb:
    """A verb with a graph of one process, which talks without end.

    Parameters
    ----------
    folder : Path
        Where the graph notes how many lines it said, and that it ended in order.
    output : int
        Descriptor of its standard output.
    """

    def __init__(self, folder: Path, output: int) -> None:
        self._folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-c", VERB, TALKING],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    @property
    def lines(self) -> int:
        """Lines that its graph has said."""
        try:
            return int((self._folder / "lines").read_text() or 0)
        except FileNotFoundError:
            return 0

    def end(self) -> tuple[int, str, bool]:
        """Return exit status, what it said of it, and whether its graph ended in order."""
        assert self.process.stderr
        said = self.process.stderr.read()
        status = self.process.wait(PATIENCE)
        return status, said, (self._folder / "ended in order").exists()


@pytest.fixture
def verb(tmp_path: Path, domain: int) -> Iterator[Callable[[int], Verb]]:
    started: list[Verb] = []

    def start(output: int) -> Verb:
        started.append(Verb(tmp_path, output))
        return started[-1]

    yield start
    for each in started:
        each.process.kill()
        each.process.wait()


pytestmark = pytest.mark.quiet


def test_a_pipe_that_is_closed_ends_the_graph_in_order(verb: Callable[[int], Verb]) -> None:
    read, write = os.pipe()
    running = verb(write)
    os.close(write)
    wait_until(lambda: running.lines > 0, "its graph talks")
    os.close(read)
    assert running.end() == (0, "", True)


def test_a_terminal_that_is_closed_ends_the_graph_in_order(verb: Callable[[int], Verb]) -> None:
    here, there = pty.openpty()
    running = verb(there)
    os.close(there)
    wait_until(lambda: running.lines > 0, "its graph talks")
    os.close(here)
    assert running.end() == (0, "", True)


def test_a_full_disk_ends_the_graph_with_one_line(verb: Callable[[int], Verb]) -> None:
    with open("/dev/full", "w") as full:
        running = verb(full.fileno())
    assert running.end()[:2] == (1, "no output: No space left on device\n")


def test_a_graph_whose_log_nobody_reads_goes_on_and_ends_when_asked(
    verb: Callable[[int], Verb],
) -> None:
    read, write = os.pipe()
    running = verb(write)
    os.close(write)
    wait_until(lambda: running.lines > 500, "500 kB said, of which two pipes take 128 KiB")
    running.process.send_signal(signal.SIGINT)
    assert running.end() == (0, "", True)
    os.close(read)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A verb that runs a graph, behind a terminal or a pipe that fails it; a script is the graph."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.topics import COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED
from observing import Observer
from running import PATIENCE, nodes_of, wait_until

VERB = """
import sys
from haptic_accel.cli.output import StoppedError
from haptic_accel.cli.running import run_shown
from haptic_accel.graph import supervisor
from haptic_accel.setup.processes import Process
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
    graph : str
        Program of the process.
    """

    def __init__(self, folder: Path, output: int, graph: str = TALKING) -> None:
        self._folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-c", VERB, graph],
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


@pytest.mark.parametrize("opened", [os.pipe, pty.openpty], ids=["pipe", "terminal"])
def test_an_output_that_is_closed_ends_the_graph_in_order(
    verb: Callable[[int], Verb], opened: Callable[[], tuple[int, int]]
) -> None:
    here, there = opened()
    running = verb(there)
    os.close(there)
    wait_until(lambda: running.lines > 0, "its graph talks")
    os.close(here)
    assert running.end() == (0, "", True)


FAILING = """
from haptic_accel.core.process import notify_supervisor
{}
notify_supervisor("recorded", path="bag")
raise SystemExit(1)
"""


@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("", "nothing to analyse, as the graph failed before the arms were coupled: bag"),
        ("notify_supervisor('engaged')", "next: haptic-accel analyze bag"),
    ],
)
def test_the_bag_of_a_failed_start_is_not_to_be_analysed(
    tmp_path: Path, domain: int, before: str, said: str
) -> None:
    output = tmp_path / "output"
    with output.open("w") as written:
        assert Verb(tmp_path, written.fileno(), FAILING.format(before)).end()[0] == 1
    assert output.read_text().splitlines()[-1] == said


def test_a_full_disk_ends_the_graph_with_one_line(verb: Callable[[int], Verb]) -> None:
    with open("/dev/full", "w") as full:
        running = verb(full.fileno())
    assert running.end()[:2] == (1, "no output: No space left on device\n")


KEYS = """
import sys, time
from haptic_accel.cli.running import on_keys
from haptic_accel.cli.running import stop_on_signal
with stop_on_signal() as stop, on_keys({b" ": lambda: print("pressed", flush=True)}) as read:
    print("reading" if read else "not reading", flush=True)
    while not stop():
        time.sleep(0.02)  # pause() would miss a signal that comes before it
    if "fail" in sys.argv:
        raise RuntimeError("failed")
print("ended", flush=True)
"""


ENDS = b"\x03", b"\x1c", signal.SIGTERM, signal.SIGHUP


@pytest.mark.parametrize(("end", "fail"), [(ENDS[0], True), *((each, False) for each in ENDS)])
def test_a_key_acts_without_enter_and_the_terminal_is_restored(
    terminals: Any, end: bytes | signal.Signals, fail: bool
) -> None:
    terminal = terminals("-c", KEYS, *(["fail"] if fail else []))
    terminal.wait_for("reading")
    terminal.press(b"x \n ")
    terminal.wait_for("pressed")
    terminal.press(b" ")
    terminal.wait_for("pressed", 2)
    assert terminal.settings != terminal.before
    if isinstance(end, bytes):
        terminal.press(end)
    else:
        terminal.process.send_signal(end)
    terminal.wait_for("failed" if fail else "ended")
    terminal.process.wait(PATIENCE)
    assert terminal.settings == terminal.before


def test_what_is_no_terminal_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "input").write_text("  ")
    with (tmp_path / "input").open() as given:
        words = [sys.executable, "-c", KEYS]
        command = subprocess.Popen(words, stdin=given, stdout=subprocess.PIPE, text=True)
        assert command.stdout
        assert command.stdout.readline() == "not reading\n"
        command.send_signal(signal.SIGTERM)
        assert command.stdout.read() == "ended\n"
        command.wait(PATIENCE)
        command.stdout.close()
        assert given.read() == "  "


def test_the_space_key_stops_a_graph_and_does_not_release_it(
    terminals: Any, observer: Observer
) -> None:
    terminal = terminals("-m", "haptic_accel.cli.main", "teleop", "record:=false")
    terminal.wait_for("engaged")
    for times in (1, 2):
        terminal.press(b" ")
        terminal.wait_for("space: emergency stop", times)
        for topic in (COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED):
            observer.wait_for_state(topic, True)
    terminal.wait_for("emergency stop: no force until it is released", 2)
    assert "released" not in terminal.text.replace("until it is released", "")
    terminal.press(b"\x03")
    assert terminal.process.wait(PATIENCE) == 0
    assert terminal.settings == terminal.before


def test_the_space_key_counts_before_the_nodes_exist(terminals: Any, observer: Observer) -> None:
    terminal = terminals("-m", "haptic_accel.cli.main", "teleop", "record:=false", "rate:=200")
    terminal.press(b" ")  # while Python starts
    terminal.wait_for("space: emergency stop")
    terminal.wait_for("emergency stop: no force until it is released", 2)
    for topic in (COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED):
        observer.wait_for_state(topic, True)
    assert "engaged" not in terminal.text
    terminal.press(b"\x03")
    assert terminal.process.wait(PATIENCE) == 0
    assert terminal.settings == terminal.before


def test_a_terminal_that_hangs_up_ends_the_graph_in_order(
    terminals: Any, domain: int, tmp_path: Path
) -> None:
    terminal = terminals("-m", "haptic_accel.cli.main", "teleop", "rate:=200", "bag:=bag")
    terminal.wait_for("engaged")
    terminal.hang_up()
    assert terminal.process.wait(PATIENCE) == 0
    assert nodes_of(domain) == {}
    assert read_bag(tmp_path / "bag").problems == []


STAGES = """
import sys
from haptic_accel.cli.output import printable_output
from haptic_accel.cli.running import shown_stages

with printable_output(), shown_stages(["one", "two"]) as begin:
    begin("one")
    print("a name with \\x1b[2J in it", flush=True)
    begin("two")
"""


def test_stages_are_a_bar_in_a_terminal_and_a_line_each_elsewhere() -> None:
    in_terminal = "import pty, sys; sys.exit(pty.spawn([sys.executable, *sys.argv[1:]]) >> 8)"
    plain, drawn = (
        subprocess.check_output([sys.executable, *words], stdin=subprocess.DEVNULL, text=True)
        for words in (["-c", STAGES], ["-c", in_terminal, "-c", STAGES])
    )
    assert plain == "one\na name with \\x1b[2J in it\ntwo\n"
    assert "two" in drawn
    assert "100 %" in drawn
    assert "\x1b[2J" not in drawn
    assert drawn.count("\\x1b") <= 1  # that of the name: the bar itself is drawn

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Running graphs from a verb: signals, progress, and how a graph ended."""

from __future__ import annotations

import re
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.keyboard import on_key
from haptic_accel.core.process import FAILED, INTERRUPTED, WRONG_ARGUMENTS
from haptic_accel.graph.claims import sole_graph
from haptic_accel.graph.processes import LINK, RECORDER, SCOPE, Process
from haptic_accel.graph.supervisor import Outcome, Supervisor

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that end a verb, which leaves bag and terminal in order."""

STOP_KEY = b" "
"""Key that stops a graph at once."""

SUMMARY = re.compile(r"([^\[].*): \d+ messages, \d+ dropped")
"""The recorder's summary of a bag that is whole: `BagFiles.summary`."""

ENGAGED = "coupler]: engaged"
"""End of the line by which the coupler, in any namespace, tells that the arms are coupled."""

STOPPED_BY_KEY = (
    "space: emergency stop, no force until you type in another terminal:"
    " haptic-accel estop release:=true"
)


@contextmanager
def stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Take over the signals that end a verb; yield what returns true once one has come."""
    asked = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: asked.set())
        for number in ENDING
        # After nohup the end of the terminal is none.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield asked.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_to_end(supervisor: Supervisor, stop: Callable[[], bool], interrupted: str = "") -> None:
    """Run a graph that ends by itself.

    Parameters
    ----------
    supervisor : Supervisor
    stop : callable
        Returns true once the graph has to stop.
    interrupted : str
        Line for the user when it was stopped.

    Raises
    ------
    StoppedError
        It was interrupted, or failed, which has been shown.
    """
    outcome = supervisor.run(stop)
    if not outcome.first:
        raise StoppedError(interrupted, INTERRUPTED)
    _conclude(outcome)


def run_shown(
    processes: Sequence[Process], *, endless: bool = False, expected: float = 0.0
) -> None:
    """Run a graph until its end or a signal, and print its output.

    Parameters
    ----------
    processes : sequence of Process
    endless : bool
        True where the graph is not meant to end by itself.
    expected : float
        Time from engaging to the end, s, for a progress bar in a terminal; 0 for none.

    Raises
    ------
    ParameterError
        Another graph runs in the namespace and ROS domain.
    StoppedError
        It failed, which has been shown.
    """
    (namespace,) = {process.namespace for process in processes}
    progress = progress_bar(Console())
    progress.disable = not (expected and progress.console.is_terminal)
    bar = progress.add_task("waiting for the arms", total=expected)
    engaged: list[float] = []

    def show(name: str, line: str) -> None:
        print(f"[{name}] {line}\n", end="", flush=True)  # in one piece, from several threads
        if not engaged and line.endswith(ENGAGED):
            engaged.append(time.monotonic())
            progress.update(bar, description="replaying")

    supervisor = Supervisor(processes, on_line=show)

    def stop_forces() -> None:
        supervisor.stop_forces()
        print(STOPPED_BY_KEY + (f" namespace:={namespace}" if namespace else ""), flush=True)

    def stopped() -> bool:
        if engaged:
            progress.update(bar, completed=min(time.monotonic() - engaged[0], expected))
        return stop()

    with (
        sole_graph(namespace),
        stop_on_signal() as stop,
        on_key(STOP_KEY, stop_forces) as keys,
    ):
        _print_hints(processes, keys)
        with progress:
            outcome = supervisor.run(stopped)
    for line in outcome.last_lines.get(RECORDER, ()):
        if summary := SUMMARY.fullmatch(line):
            beside = " PEERS_BAG" if any(each.executable == LINK for each in processes) else ""
            print(f"next: haptic-accel analyze {shlex.quote(summary[1])}{beside}")
    _conclude(outcome)
    if endless and outcome.first:
        print(f"{outcome.first} ended", file=sys.stderr)


def _print_hints(processes: Sequence[Process], keys: bool) -> None:
    """Say how to look at a graph, stop it and end it."""
    stop = "space" if keys else "haptic-accel estop in another terminal"
    print(f"emergency stop: {stop}; end: Ctrl-C", flush=True)
    if any(process.executable == SCOPE for process in processes):
        print("page: open the address that [scope] prints below", flush=True)


def _conclude(outcome: Outcome) -> None:
    """Show the last lines of what failed in a graph, and end the verb with its exit status."""
    for name, status in outcome.failed.items():
        print(f"{name} ended with status {status}; its last lines:", file=sys.stderr)
        for line in outcome.last_lines[name] or ["(none)"]:
            print(f"  {line}", file=sys.stderr)
    if outcome.failed:
        wrong = outcome.status == WRONG_ARGUMENTS
        raise StoppedError(status=WRONG_ARGUMENTS if wrong else FAILED)


def progress_bar(console: Console | None = None) -> Progress:
    """Return a progress bar on stderr, or a console, with percentage and remaining time."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console or Console(stderr=True),
        refresh_per_second=2.0,  # drawing takes CPU from the graph that is waited for
    )

"""Running graphs from a verb: signals, progress, and how a graph ended."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from haptic_accel.cli.ending import StoppedError
from haptic_accel.core.process import DONE, FAILED, INTERRUPTED, WRONG_ARGUMENTS
from haptic_accel.graph.supervisor import Outcome, Supervisor


class StopOnSignal:
    """Notes SIGINT and SIGTERM while it is entered, and restores the handlers afterwards."""

    def __enter__(self) -> StopOnSignal:
        """Take the signals over."""
        self._asked = threading.Event()
        self._before = {
            number: signal.signal(number, lambda *_: self._asked.set())
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        """Give the signals back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Return true once a signal has come."""
        return self._asked.is_set()


def run_to_end(supervisor: Supervisor, stop: Callable[[], bool]) -> None:
    """Run a graph that ends by itself.

    Raises
    ------
    StoppedError
        It was interrupted, or failed, which has been shown.
    """
    outcome = supervisor.run(stop)
    if not outcome.first:
        raise StoppedError(INTERRUPTED)
    status = conclude(outcome)
    if status != DONE:
        raise StoppedError(status)


def conclude(outcome: Outcome, *, endless: bool = False) -> int:
    """Show the last lines of what failed in a graph; return the exit status.

    Parameters
    ----------
    outcome : Outcome
    endless : bool
        Whether the graph was not meant to end by itself.
    """
    if outcome.first and outcome.status == 0 and not outcome.failed:
        if endless:
            print(f"{outcome.first} ended", file=sys.stderr)
        return DONE
    for name, status in outcome.failed.items():
        print(f"{name} ended with status {status}; its last lines:", file=sys.stderr)
        for line in outcome.last_lines[name] or ["(none)"]:
            print(f"  {line}", file=sys.stderr)
    if outcome.status == WRONG_ARGUMENTS:
        return WRONG_ARGUMENTS
    return FAILED if outcome.failed else DONE


def show(executable: str, line: str) -> None:
    """Print a line of output of one of the graph's processes."""
    print(f"[{executable}] {line}", flush=True)


def progress_bar(console: Console | None = None, refresh: float = 2.0) -> Progress:
    """Return a progress bar with description, percentage and remaining time.

    Parameters
    ----------
    console : Console, optional
        stderr otherwise.
    refresh : float
        Redraws per second; drawing takes CPU from the graph that is waited for.
    """
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console or Console(stderr=True),
        refresh_per_second=refresh,
    )

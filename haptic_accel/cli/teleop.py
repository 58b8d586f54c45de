"""``haptic-accel teleop``: the graph as supervised processes, where there is no ros2 launch."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Sequence

import click

from haptic_accel.cli.options import Verb, words
from haptic_accel.core.process import DONE, FAILED, WRONG_ARGUMENTS
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Outcome, Supervisor


class StopOnSignal:
    """Notes SIGINT and SIGTERM while it is entered, and puts the handlers back after."""

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
        """Whether a signal came."""
        return self._asked.is_set()


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel teleop controller:=inverse surface:=vinyl duration:=10",
        "haptic-accel teleop master:=serial slave:=serial config:=mine.yaml",
        "haptic-accel teleop scope:=true",
    ],
)
@words(GraphArguments)
def teleop(words: Sequence[str]) -> int:
    """Run the five nodes of the teleoperation graph until Ctrl-C."""
    arguments = parse_arguments(words)
    processes = graph(arguments)
    with StopOnSignal() as stop:
        outcome = Supervisor(processes, on_line=show).run(stop)
    return conclude(outcome, endless=arguments.duration == 0)


def conclude(outcome: Outcome, *, endless: bool = False) -> int:
    """Say what went wrong in a graph, if anything; return the exit status.

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

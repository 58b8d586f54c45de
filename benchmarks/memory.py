# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Growth of memory and open files of the graph's processes: ``python benchmarks/memory.py``."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import click
import psutil
from rich.console import Console
from rich.table import Table

from haptic_accel import GraphArguments, ParameterError
from haptic_accel.cli.bench import MEBI
from haptic_accel.cli.running import run_to_end
from haptic_accel.commands import (
    DONE,
    FAILED,
    Verb,
    json_option,
    progress_bar,
    run,
    save,
    stop_on_signal,
    words,
)
from haptic_accel.core.process import ENGAGED
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup import graph
from haptic_accel.setup.arguments import parse_arguments

SAMPLE_PERIOD = 1.0
"""Interval between readings of the memory, s."""

SETTLED, START_UP = 0.1, 7.0
"""Fraction of the time, and time in s or half of a shorter run, after which the start-up is over
and growth is counted: the recorder's buffers have grown to their size by then."""

MOST_GROWTH = 5.0
"""Largest growth of a process that is accepted, MiB."""


@dataclass
class Memory:
    """Resident memory and open files of processes over time.

    Attributes
    ----------
    moments : list of float
        Times of the readings, s since the first.
    resident : dict
        Memory at these times by executable, MiB.
    descriptors : dict
        Numbers of open files, sockets included, at these times by executable.
    """

    supervisor: Supervisor
    moments: list[float] = field(default_factory=list)
    resident: dict[str, list[float]] = field(default_factory=dict)
    descriptors: dict[str, list[int]] = field(default_factory=dict)
    _origin: float | None = None

    def read(self) -> None:
        """Read the memory of every process, at most once in `SAMPLE_PERIOD`."""
        now = time.monotonic()
        self._origin = now if self._origin is None else self._origin
        if self.moments and now - self._origin < self.moments[-1] + SAMPLE_PERIOD:
            return
        try:
            found = {name: psutil.Process(pid) for name, pid in self.supervisor.pids.items()}
            sizes = {name: each.memory_info().rss / MEBI for name, each in found.items()}
            opened = {name: each.num_fds() for name, each in found.items()}
        except psutil.Error:
            return  # one of them is ending
        if not all(sizes.values()):
            return  # one has ended, and is still listed
        self.moments.append(now - self._origin)
        for name in found:
            self.resident.setdefault(name, []).append(sizes[name])
            self.descriptors.setdefault(name, []).append(opened[name])

    def growth(self) -> tuple[dict[str, float], dict[str, int]]:
        """Return the growth of each process after its start-up: memory in MiB, and open files.

        Raises
        ------
        ParameterError
            The run was too short for two readings after that.
        """
        last = self.moments[-1]
        begin = max(SETTLED * last, min(START_UP, last / 2))
        settled = [t for t in self.moments if t >= begin]
        if len(settled) < 2:
            raise ParameterError("seconds: too few to see memory grow")
        first = len(self.moments) - len(settled)
        return (
            {name: sizes[-1] - sizes[first] for name, sizes in self.resident.items()},
            {name: counts[-1] - counts[first] for name, counts in self.descriptors.items()},
        )


@click.command(
    cls=Verb,
    help="Run the graph with recording and watch memory and open files of its processes; exit"
    f" status 1 if one grows by more than {MOST_GROWTH:g} MiB, or has more files open.",
)
@words(GraphArguments)
@click.option("--seconds", type=float, default=600.0, help="Length of the run, s.")
@json_option
def memory(words: Sequence[str], *, seconds: float, json_file: Path | None) -> int:
    """Run the graph and watch its processes."""
    if not seconds >= 3 * SAMPLE_PERIOD:
        raise ParameterError(f"seconds = {seconds:g}: must be at least {3 * SAMPLE_PERIOD:g}")
    arguments = parse_arguments(words)
    with (
        tempfile.TemporaryDirectory() as folder,
        stop_on_signal() as stop,
        progress_bar() as bar,
    ):
        bag = arguments.bag or str(Path(folder) / "bag")
        arguments = replace(arguments, duration=seconds, bag=bag, record=True)
        supervisor = Supervisor(graph(arguments))
        memory_use = Memory(supervisor)
        engaged: list[str] = []
        supervisor.on_event = lambda _, event: engaged.extend(
            [event["event"]] if event["event"] == ENGAGED else []
        )
        task = bar.add_task("memory", total=seconds)

        def watch() -> bool:
            if engaged:
                memory_use.read()
                bar.update(task, completed=memory_use.moments[-1] if memory_use.moments else 0)
            return stop()

        run_to_end(supervisor, watch)
    growth, opened = memory_use.growth()
    Console().print(_table(memory_use, growth, opened))
    save(
        {
            "seconds": seconds,
            "rate_hz": arguments.rate,
            "growth_mb": growth,
            "moments_s": memory_use.moments,
            "resident_mb": memory_use.resident,
            "descriptors_growth": opened,
        },
        json_file,
    )
    return DONE if max(growth.values()) <= MOST_GROWTH and max(opened.values()) <= 0 else FAILED


def _table(used: Memory, growth: dict[str, float], opened: dict[str, int]) -> Table:
    table = Table(title=f"resident memory over {used.moments[-1]:.0f} s, MiB")
    for heading in ("", "at the end", "growth after start-up", "more open files"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, sizes in used.resident.items():
        table.add_row(name, f"{sizes[-1]:.1f}", f"{growth[name]:+.2f}", str(opened[name]))
    return table


if __name__ == "__main__":
    run(memory, "memory.py")

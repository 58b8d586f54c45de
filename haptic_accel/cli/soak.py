"""``haptic-accel bench soak``: whether the memory of the graph's processes stays flat."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import click
import psutil
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from haptic_accel.cli.bench import MEBI
from haptic_accel.cli.options import Verb, json_option, words
from haptic_accel.cli.output import save
from haptic_accel.cli.running import StopOnSignal, conclude
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, FAILED, INTERRUPTED
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Supervisor

SAMPLE_PERIOD = 1.0
"""Between two looks at the processes, s."""

SETTLED = 0.1
"""Share of the time after which the memory in use counts as the start."""

MOST_GROWTH = 5.0
"""What a process may grow by, MiB."""


@dataclass
class Memory:
    """Resident memory of processes over time, looked at when asked to.

    Attributes
    ----------
    moments : list of float
        s since the first look.
    resident : dict
        By executable: MiB at these moments.
    """

    supervisor: Supervisor
    moments: list[float] = field(default_factory=list)
    resident: dict[str, list[float]] = field(default_factory=dict)
    _origin: float | None = None

    def look(self) -> None:
        """Note what every process uses now, at most once in `SAMPLE_PERIOD`."""
        now = time.monotonic()
        self._origin = now if self._origin is None else self._origin
        if self.moments and now - self._origin < self.moments[-1] + SAMPLE_PERIOD:
            return
        try:
            found = {
                name: psutil.Process(pid).memory_info().rss / MEBI
                for name, pid in self.supervisor.pids.items()
            }
        except psutil.Error:
            return  # one of them is ending
        if not all(found.values()):
            return  # one has ended, and is still listed
        self.moments.append(now - self._origin)
        for name, size in found.items():
            self.resident.setdefault(name, []).append(size)

    def growth(self) -> dict[str, float]:
        """Return by how much each process grew after it had settled, MiB.

        Raises
        ------
        ParameterError
            The run was too short for two looks after that.
        """
        settled = [t for t in self.moments if t >= SETTLED * self.moments[-1]]
        if len(settled) < 2:
            raise ParameterError("seconds: too few to see memory grow")
        first = len(self.moments) - len(settled)
        return {name: sizes[-1] - sizes[first] for name, sizes in self.resident.items()}


@click.command(
    cls=Verb,
    help="Run the graph with recording and watch the memory of its processes; exit status 1 if"
    f" one grows by more than {MOST_GROWTH:g} MiB.",
)
@words(GraphArguments)
@click.option("--seconds", type=float, default=600.0, help="Length of each measurement, s.")
@json_option
def soak(words: Sequence[str], *, seconds: float, json_file: Path | None) -> int:
    """Run the graph and watch the memory of its processes."""
    if not seconds >= 3 * SAMPLE_PERIOD:
        raise ParameterError(f"seconds = {seconds:g}: must be at least {3 * SAMPLE_PERIOD:g}")
    arguments = parse_arguments(words)
    with tempfile.TemporaryDirectory() as folder, StopOnSignal() as stop, _progress() as progress:
        bag = arguments.bag or str(Path(folder) / "bag")
        arguments = replace(arguments, duration=seconds, bag=bag, record=True)
        supervisor = Supervisor(graph(arguments))
        memory = Memory(supervisor)
        engaged: list[str] = []
        supervisor.on_line = lambda _, line: engaged.append(line) if "engaged" in line else None
        task = progress.add_task("soak", total=seconds)

        def watch() -> bool:
            if engaged:
                memory.look()
                progress.update(task, completed=memory.moments[-1] if memory.moments else 0)
            return stop()

        outcome = supervisor.run(watch)
    if not outcome.first:
        return INTERRUPTED
    if conclude(outcome) != DONE:
        return FAILED
    growth = memory.growth()
    Console().print(_table(memory, growth))
    save(
        {
            "seconds": seconds,
            "rate_hz": arguments.rate,
            "growth_mb": growth,
            "moments_s": memory.moments,
            "resident_mb": memory.resident,
        },
        json_file,
    )
    return DONE if max(growth.values()) <= MOST_GROWTH else FAILED


def _progress() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True))


def _table(memory: Memory, growth: dict[str, float]) -> Table:
    table = Table(title=f"resident memory over {memory.moments[-1]:.0f} s, MiB")
    for heading in ("", "at the end", "growth since a tenth of the time"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, sizes in memory.resident.items():
        table.add_row(name, f"{sizes[-1]:.1f}", f"{growth[name]:+.2f}")
    return table

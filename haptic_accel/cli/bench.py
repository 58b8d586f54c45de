# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel bench latency``: missed deadlines, ages and cost; empty loop for comparison."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import psutil

from haptic_accel.analysis import latency as measured
from haptic_accel.bags.delivery import read_delivery
from haptic_accel.cli.options import FILE, json_option, listed_numbers, verb, words
from haptic_accel.cli.output import StoppedError, save
from haptic_accel.cli.running import run_to_end, stop_on_signal
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import ENGAGED, INTERRUPTED, OVER
from haptic_accel.core.tables import ResultTable, Row
from haptic_accel.core.tick import PLAIN, TICK
from haptic_accel.graph.domain import HIGHEST_FREE_DOMAIN, check_ros
from haptic_accel.graph.stop_signal import DOMAIN, own_domain
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup.arguments import GraphArguments, check_both_arms, parse_arguments
from haptic_accel.setup.processes import arrangement, graph
from haptic_accel.setup.words import assigned_keys

ROUNDS = 2
"""Number of rounds in which graph and empty loop alternate, so that both see the same load."""

MOST_PAIRS = 16
"""Maximum number of simultaneous graphs; more would start hundreds of processes."""

MEBI = 2**20


class Usage:
    """CPU and memory use of the processes of graphs while all graphs are engaged.

    Parameters
    ----------
    graphs : int
        Number of graphs that run at the same time.

    Attributes
    ----------
    cpu_cores, peak_mb : dict
        Cores used over all graphs, and resident memory of the largest process, MiB, by executable.
        Empty until all graphs were engaged at the same time and one of them has ended.
    """

    def __init__(self, graphs: int) -> None:
        self._graphs = graphs
        self._engaged: list[Supervisor] = []
        self._processes: list[tuple[str, psutil.Process]] = []
        self._lock = threading.Lock()
        self.cpu_cores: dict[str, float] = {}
        self.peak_mb: dict[str, float] = {}

    def watch(self, supervisor: Supervisor, event: Mapping[str, Any]) -> None:
        """Process an event of a graph: its arms engage, or its duration is over."""
        # A missing process means that its graph has failed, which is reported elsewhere.
        with self._lock, suppress(psutil.NoSuchProcess):
            if event["event"] == ENGAGED:
                self._engaged.append(supervisor)
                if len(self._engaged) == self._graphs:
                    started = [item for each in self._engaged for item in each.pids.items()]
                    processes = [(name, psutil.Process(pid)) for name, pid in started]
                    for _, process in processes:
                        process.cpu_percent()  # the next call measures from here
                    self._processes = processes
            elif event["event"] == OVER and self._processes and not self.cpu_cores:
                self._drain()

    def _drain(self) -> None:
        for name, process in self._processes:
            cores = process.cpu_percent() / 100
            self.cpu_cores[name] = self.cpu_cores.get(name, 0.0) + cores
            memory = process.memory_info().rss / MEBI
            self.peak_mb[name] = max(self.peak_mb.get(name, 0.0), memory)
        self.cpu_cores["total"] = sum(self.cpu_cores.values())


@verb(
    "haptic-accel bench latency rig:=ideal --rate 2000",
    "haptic-accel bench latency composed:=false --rates 500,1000,2000,4000 --seconds 5",
    "haptic-accel bench latency --seconds 60 --json latency.json",
)
@words(GraphArguments)
@click.option("--rate", default=1000.0, help="Sampling rate, Hz.")
@click.option(
    "--rates",
    type=listed_numbers,
    metavar="HZ,HZ,...",
    help="Sampling rates to compare, Hz: finds the highest that is held.",
)
@click.option(
    "--pairs", type=click.IntRange(1, MOST_PAIRS), default=1, help="Number of graphs at a time."
)
@click.option("--seconds", default=20.0, help="Length of each measurement, s.")
@click.option("--plot", type=FILE, metavar="FILE", help="Plot of age and CPU over --rates.")
@json_option
def latency(
    words: Sequence[str],
    *,
    rate: float,
    rates: Sequence[float] | None,
    pairs: int,
    seconds: float,
    plot: Path | None,
    json_file: Path | None,
) -> None:
    """Measure missed deadlines of the whole graph, and of an empty loop for comparison.

    Runs the graph as users do, compiled and in plain Python, and an empty loop on the same
    sampling grid, in turns. Prints missed deadlines, ages of forces, losses, CPU and memory.
    """
    span = seconds if rates else seconds / ROUNDS
    runs = [_arguments(words, each, span) for each in rates or [rate]]
    check_ros()
    click.echo(arrangement(graph(runs[0])), err=True)
    with stop_on_signal() as stop:
        if rates:
            metrics = _compared(runs, pairs, stop)
            if plot:
                measured.draw(metrics["rows"]).savefig(plot, dpi=120)
        else:
            metrics = _in_turns(runs[0], pairs, stop)
    save({"seconds": seconds, **metrics}, json_file)
    if rates and not metrics["rows"]:
        raise StoppedError


def _in_turns(arguments: GraphArguments, pairs: int, stop: Callable[[], bool]) -> Row:
    """Measure the graph compiled and in plain Python, and print the metrics."""
    ticks = list(dict.fromkeys((TICK, PLAIN)))
    rounds = [[_round(arguments, pairs, stop, tick) for tick in ticks] for _ in range(ROUNDS)]
    first, *others = (
        {"rate_hz": arguments.rate, "pairs": pairs, "tick": tick, **measured.merged(each, fmean)}
        for tick, each in zip(ticks, zip(*rounds, strict=True), strict=True)
    )
    print_table(measured.latency_table(first))
    print_table(ResultTable.of(measured.RATES, [first, *others], left=2))
    if not others:
        print("no compiled tick: see haptic-accel doctor")
    return {"composed": arguments.composed, **first, "plain": others[0] if others else None}


def _round(arguments: GraphArguments, pairs: int, stop: Callable[[], bool], tick: str) -> Row:
    """Measure the graph and then an empty loop."""
    # Imports ROS.
    from haptic_accel.nodes.timing import empty_loop

    rate, seconds = arguments.rate, arguments.duration
    click.echo(f"graph at {rate:g} Hz for {seconds:g} s, {tick}; then the empty loop", err=True)
    metrics = measure(arguments, pairs, stop, tick)
    try:
        return {**metrics, "empty_loop": empty_loop(rate, seconds)}
    except RuntimeError as error:
        raise StoppedError(str(error)) from None


def _compared(runs: Sequence[GraphArguments], pairs: int, stop: Callable[[], bool]) -> Row:
    """Measure the graph at several rates, and print the metrics."""
    rows: list[Row] = []
    not_run: list[float] = []
    for arguments in runs:
        try:
            metrics = _round(arguments, pairs, stop, TICK)
            rows.append({"rate_hz": arguments.rate, "pairs": pairs, "tick": TICK, **metrics})
        except StoppedError as end:
            if end.status == INTERRUPTED:
                raise
            # A rate beyond the machine's limits is a result, too; the next rate may be lower.
            not_run.append(arguments.rate)
    held = measured.rate_held(rows)
    title = f"highest rate held: {f'{held:g} Hz' if held else 'none'}"
    print_table(ResultTable.of(measured.RATES, rows, left=0, title=title))
    for rate in not_run:
        print(f"could not be run: {pairs} x {rate:g} Hz")
    return {"rate_held_hz": held, "rows": rows, "not_run": not_run}


def measure(arguments: GraphArguments, pairs: int, stop: Callable[[], bool], tick: str) -> Row:
    """Run graphs compiled, as users do, or in plain Python; return metrics over all pairs.

    Returns
    -------
    dict
        Metrics: deadlines, age_us, period_error_us, late, lost, missed, ticks, cpu_cores, peak_mb.

    Raises
    ------
    StoppedError
        The run was interrupted, or a graph failed.
    """
    usage = Usage(pairs)
    first = own_domain()

    def run_pair(pair: int) -> Row:
        bag = Path(folder) / f"pair_{pair}"
        domain = str((first + pair) % (HIGHEST_FREE_DOMAIN + 1))
        environment = {DOMAIN: domain, "HAPTIC_ACCEL_PLAIN": "1" if tick == PLAIN else ""}
        supervisor = Supervisor(graph(replace(arguments, bag=str(bag))), environment=environment)
        supervisor.on_event = lambda _, event: usage.watch(supervisor, event)
        run_to_end(supervisor, stop)
        return measured.pair_metrics(read_delivery(bag, arguments.rate))

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(pairs) as pool:
        metrics = measured.merged(list(pool.map(run_pair, range(pairs))), max)
    if not usage.cpu_cores:
        raise StoppedError("the graphs never ran at the same time: use more --seconds")
    return {**metrics, "cpu_cores": usage.cpu_cores, "peak_mb": usage.peak_mb}


def _arguments(assignments: Sequence[str], rate: float, seconds: float) -> GraphArguments:
    for key in assigned_keys(assignments):
        if key in ("rate", "duration", "bag", "record"):
            raise ParameterError(f"{key}: set by the benchmark")
    if not seconds >= 1:
        raise ParameterError(f"seconds = {seconds:g}: must leave at least 1 s for each run")
    arguments = parse_arguments([*assignments, f"rate:={rate}", f"duration:={seconds}"])
    check_both_arms(arguments)
    # Check all values before the first run.
    graph(arguments)
    return arguments

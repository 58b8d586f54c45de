"""``haptic-accel bench latency``: latency and cost of the graph, beside two references."""

from __future__ import annotations

import math
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import psutil
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from haptic_accel.bags.delivery import AGE_OF, LABELS, Delivery, durations, read_delivery
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import FILE, Verb, json_option, listed_numbers, words
from haptic_accel.cli.output import save
from haptic_accel.cli.running import StopOnSignal, run_to_end
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, EXECUTOR, FAILED, INTERRUPTED
from haptic_accel.core.topics import SIGNALS
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Supervisor

ROUNDS = 2
"""Number of rounds in which graph and references alternate, so that all meet the same machine."""

MOST_PAIRS = 16
"""Most graphs at a time; more would start hundreds of processes."""

LATE_SHARE = 0.001
"""Share of late or missed ticks up to which a rate counts as held."""

DOMAIN = "ROS_DOMAIN_ID"
DOMAINS = 102
"""Number of ROS domains whose ports Linux does not assign to other programs."""

MEBI = 2**20

Metrics = dict[str, Any]


class Usage:
    """CPU and memory that the processes of graphs use while all graphs are engaged.

    Parameters
    ----------
    graphs : int
        Number of graphs that run at the same time.

    Attributes
    ----------
    cpu_cores, peak_mb : dict
        By executable, over all graphs: cores used; resident memory of the largest process, MiB.
        Empty until all graphs were engaged at the same time and one of them has ended.
    """

    def __init__(self, graphs: int) -> None:
        self._graphs = graphs
        self._engaged: list[Supervisor] = []
        self._before: dict[int, tuple[float, float]] = {}
        self._lock = threading.Lock()
        self.cpu_cores: dict[str, float] = {}
        self.peak_mb: dict[str, float] = {}

    def watch(self, supervisor: Supervisor, line: str) -> None:
        """Take a line of output: couplers print when their arms engage and when a run is over."""
        # A missing process means that its graph failed, which is reported elsewhere.
        with self._lock, suppress(psutil.NoSuchProcess):
            if line.endswith("engaged"):
                self._engaged.append(supervisor)
                if len(self._engaged) == self._graphs:
                    self._before = {pid: _spent(pid) for _, pid in self._processes()}
            elif line.endswith("is over") and self._before and not self.cpu_cores:
                self._take()

    def _processes(self) -> list[tuple[str, int]]:
        return [item for supervisor in self._engaged for item in supervisor.pids.items()]

    def _take(self) -> None:
        for name, pid in self._processes():
            before, since = self._before[pid]
            spent, now = _spent(pid)
            self.cpu_cores[name] = self.cpu_cores.get(name, 0.0) + (spent - before) / (now - since)
            memory = psutil.Process(pid).memory_info().rss / MEBI
            self.peak_mb[name] = max(self.peak_mb.get(name, 0.0), memory)
        self.cpu_cores["total"] = sum(self.cpu_cores.values())


def _spent(pid: int) -> tuple[float, float]:
    """Return the CPU time of a process and the moment of reading it, s."""
    used = psutil.Process(pid).cpu_times()
    return used.user + used.system, time.monotonic()


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel bench latency rig:=ideal --rate 2000",
        "haptic-accel bench latency composed:=true --rates 500,1000,2000,4000 --seconds 5",
    ],
)
@words(GraphArguments)
@click.option("--rate", type=float, default=1000.0, help="Sampling rate, Hz.")
@click.option(
    "--rates",
    type=listed_numbers(float),
    metavar="HZ,HZ,...",
    help="Sampling rates to compare, Hz: finds the highest that is held, without references.",
)
@click.option("--pairs", type=int, default=1, help="Number of graphs that run at a time.")
@click.option("--seconds", type=float, default=20.0, help="Length of each measurement, s.")
@click.option("--plot", type=FILE, metavar="FILE", help="Image of age and CPU against --rates.")
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
) -> int:
    """Measure the latency of the whole graph, beside two references.

    Runs the graph as users do, the same on rclpy's default executor, and the same two hops as
    bare UDP, in turns. Prints ages, losses, CPU and memory.
    """
    if not 1 <= pairs <= MOST_PAIRS:
        raise ParameterError(f"pairs = {pairs}: must be from 1 to {MOST_PAIRS}")
    if rates:
        return _compare_rates(words, rates, pairs, seconds, plot, json_file)
    # Imports ROS, which the measuring of rates alone does without.
    from haptic_accel.cli.udp_floor import udp_floor

    arguments = _arguments(words, rate, seconds / ROUNDS)
    runs: dict[str, list[Metrics]] = {"graph": [], "default": [], "floor": []}
    with StopOnSignal() as stop:
        for index in range(ROUNDS):
            turn = f"round {index + 1} of {ROUNDS}"
            _say(f"{turn}: the graph, {pairs} x {rate:g} Hz, {seconds / ROUNDS:g} s")
            runs["graph"].append(measure(arguments, pairs, "events", stop))
            _say(f"{turn}: the same on rclpy's default executor")
            runs["default"].append(measure(arguments, pairs, "default", stop))
            _say(f"{turn}: the same two hops as bare UDP")
            runs["floor"].append(udp_floor(rate, seconds / ROUNDS))
    metrics = _latency_metrics(rate, seconds, pairs, runs)
    Console().print(_latency_table(metrics))
    save(metrics, json_file)
    return DONE


def _compare_rates(
    words: Sequence[str],
    rates: Sequence[float],
    pairs: int,
    seconds: float,
    plot: Path | None,
    json_file: Path | None,
) -> int:
    """Measure the graph at several rates; return the exit status."""
    rows: list[Metrics] = []
    not_run: list[float] = []
    status = FAILED
    with StopOnSignal() as stop:
        for rate in rates:
            _say(f"{pairs} x {rate:g} Hz, {seconds:g} s")
            try:
                metrics = measure(_arguments(words, rate, seconds), pairs, "events", stop)
            except StoppedError as end:
                if end.status == INTERRUPTED:
                    raise
                # A rate beyond the machine's limits is a result too; the next may be lower.
                not_run.append(rate)
                continue
            status = DONE
            late_share = _late_share(metrics)
            rows.append({"rate_hz": rate, "pairs": pairs, **metrics, "late_share": late_share})
    held = max((r["rate_hz"] for r in rows if r["late_share"] < LATE_SHARE), default=None)
    Console().print(_rates_table(rows, held))
    for rate in not_run:
        print(f"could not be run: {pairs} x {rate:g} Hz")
    if plot:
        _draw(rows).savefig(plot, dpi=120)
    save({"seconds": seconds, "rate_held_hz": held, "rows": rows, "not_run": not_run}, json_file)
    return status


def measure(
    arguments: GraphArguments, pairs: int, executor: str, stop: Callable[[], bool]
) -> Metrics:
    """Run graphs as users run them and return their metrics over all pairs.

    Returns
    -------
    dict
        age_us, period_error_us, late, lost, missed, ticks, cpu_cores, peak_mb.

    Raises
    ------
    StoppedError
        Interrupted, or a graph failed.
    """
    usage = Usage(pairs)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(pairs) as pool:
        first = int(os.environ.get(DOMAIN, 0))
        runs = [
            pool.submit(
                _run_pair,
                replace(arguments, bag=str(Path(folder) / f"pair_{pair}")),
                {EXECUTOR: executor, DOMAIN: str((first + pair) % DOMAINS)},
                usage,
                stop,
            )
            for pair in range(pairs)
        ]
        metrics = _joined([_pair_metrics(run.result()) for run in runs])
    if not usage.cpu_cores:
        raise StoppedError(FAILED, "the graphs never ran at the same time: use more --seconds")
    return {**metrics, "cpu_cores": usage.cpu_cores, "peak_mb": usage.peak_mb}


def _run_pair(
    arguments: GraphArguments,
    environment: dict[str, str],
    usage: Usage,
    stop: Callable[[], bool],
) -> Delivery:
    supervisor = Supervisor(graph(arguments), environment=environment)
    supervisor.on_line = lambda _, line: usage.watch(supervisor, line)
    run_to_end(supervisor, stop)
    return read_delivery(Path(arguments.bag), arguments.rate)


def _pair_metrics(delivery: Delivery) -> Metrics:
    """Return one graph's metrics; a message is late if used more than half a period late."""
    nodes = delivery.nodes
    late = {}
    for topic in SIGNALS:
        device, _, name = topic.name.partition("/")
        if name == "servo_cf":
            late[topic.name] = int(nodes[f"{device}_device"]["arm force late"])
        elif name == "handle/servo_cf" or device == "compensator":
            late[topic.name] = int(nodes["master_device"]["actuator force late"])
        else:
            late[topic.name] = int(nodes[f"{device}_device"]["late ticks"])
    devices = ("master_device", "slave_device")
    return {
        "age_us": durations(nodes["master_device"], f"{AGE_OF} age"),
        "period_error_us": {name: durations(nodes[name], "tick lateness") for name in devices},
        "late": late,
        "lost": delivery.lost,
        "missed": delivery.missed,
        "ticks": {name: int(nodes[name]["ticks"]) for name in devices},
        "dropped_by_recorder": int(nodes["recorder"]["dropped"]),
    }


COUNTS = {"late", "lost", "missed", "ticks", "dropped_by_recorder"}
"""Metrics that are added, not averaged."""


def _joined(pairs: Sequence[Metrics]) -> Metrics:
    """Join metrics of graphs that ran at the same time: the worst, or the sum of counts."""
    return _by_key(pairs, max)


def _mean(rounds: Sequence[Metrics]) -> Metrics:
    """Join metrics of rounds: the mean, the largest maximum, or the sum of counts."""
    return _by_key(rounds, fmean)


def _by_key(runs: Sequence[Metrics], join: Callable[[Iterable[Any]], Any]) -> Metrics:
    return {
        key: _merge([run[key] for run in runs], sum if key in COUNTS else join) for key in runs[0]
    }


def _merge(values: Sequence[Any], join: Callable[[Iterable[Any]], Any], label: str = "") -> Any:
    """Join numbers, or dictionaries of numbers key by key; a value named max stays the largest."""
    if not isinstance(values[0], Mapping):
        return max(values) if label == "max" else join(values)
    keys = {key: None for value in values for key in value}
    return {
        key: _merge([value[key] for value in values if key in value], join, key) for key in keys
    }


def _latency_metrics(
    rate: float, seconds: float, pairs: int, runs: Mapping[str, Sequence[Metrics]]
) -> Metrics:
    ours, default = _mean(runs["graph"]), _mean(runs["default"])
    floor = _merge([run["age_us"] for run in runs["floor"]], fmean)
    return {
        "rate_hz": rate,
        "seconds": seconds,
        "pairs": pairs,
        **ours,
        "default_executor": {"age_us": default["age_us"], "cpu_cores": default["cpu_cores"]},
        "udp_floor": {"age_us": floor},
        "ratio_to_default_p50": ours["age_us"]["p50"] / default["age_us"]["p50"],
        "ratio_to_floor_p50": ours["age_us"]["p50"] / floor["p50"],
    }


def _latency_table(metrics: Metrics) -> Table:
    table = Table(
        title=f"{metrics['pairs']} x {metrics['rate_hz']:g} Hz, {metrics['seconds']:g} s each"
    )
    for heading in ("", *LABELS):
        table.add_column(heading, justify="right" if heading else "left")
    rows = {
        "age of the force where it is applied, us": metrics["age_us"],
        "  on rclpy's default executor": metrics["default_executor"]["age_us"],
        "  as bare UDP, same two hops": metrics["udp_floor"]["age_us"],
        "master_device: lateness of its ticks, us": metrics["period_error_us"]["master_device"],
        "slave_device: lateness of its ticks, us": metrics["period_error_us"]["slave_device"],
    }
    for name, ages in rows.items():
        table.add_row(name, *(f"{ages[label]:.0f}" if label in ages else "-" for label in LABELS))
    cores = metrics["cpu_cores"]
    shares = ", ".join(f"{name} {share:.2f}" for name, share in cores.items())
    default = metrics["default_executor"]["cpu_cores"]["total"]
    memory = ", ".join(f"{name} {size:.0f}" for name, size in metrics["peak_mb"].items())
    taken, missed = sum(metrics["ticks"].values()), sum(metrics["missed"].values())
    table.caption = (
        f"ratio of p50 to the default executor's {metrics['ratio_to_default_p50']:.2f}, "
        f"to bare UDP's {metrics['ratio_to_floor_p50']:.1f}\n"
        f"cores: {shares} (default executor: total {default:.2f})\n"
        f"memory, MiB: {memory}\n"
        f"of {taken} ticks missed {missed}; late, worst topic: {max(metrics['late'].values())}; "
        f"messages lost: {sum(metrics['lost'].values())}, "
        f"dropped by the recorder: {metrics['dropped_by_recorder']}"
    )
    table.caption_justify = "left"
    return table


def _late_share(metrics: Metrics) -> float:
    """Share of the devices' ticks that were missed or later than half a period."""
    late = metrics["late"]
    bad = late["slave/tool/acceleration"] + late["master/handle/acceleration"]
    missed = sum(metrics["missed"].values())
    return float((bad + missed) / (sum(metrics["ticks"].values()) + missed))


def _rates_table(rows: Sequence[Metrics], held: float | None) -> Table:
    table = Table(title=f"highest rate held: {f'{held:g} Hz' if held else 'none'}")
    for heading in ("rate, Hz", "age p50, us", "p99, us", "cores", "late, %", "lost"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            f"{row['rate_hz']:g}",
            *(f"{row['age_us'][q]:.0f}" if row["age_us"] else "-" for q in ("p50", "p99")),
            f"{row['cpu_cores']['total']:.2f}",
            f"{100 * row['late_share']:.2f}",
            str(sum(row["lost"].values())),
        )
    return table


def _draw(rows: Sequence[Metrics]) -> Figure:
    """Draw age and CPU against rate."""
    figure = Figure(figsize=(6, 7), layout="constrained")
    ages, cores = figure.subplots(2, sharex=True)
    rates = [row["rate_hz"] for row in rows]
    for quantile in ("p50", "p99"):
        found = [row["age_us"].get(quantile, math.nan) for row in rows]
        ages.plot(rates, found, "o-", label=quantile)
    ages.set(ylabel="age of the force (us)", yscale="log")
    ages.legend()
    cores.plot(rates, [row["cpu_cores"]["total"] for row in rows], "o-")
    cores.set(xlabel="rate (Hz)", ylabel="CPU of all nodes (cores)")
    for panel in (ages, cores):
        panel.grid(alpha=0.3)
    return figure


def _arguments(words: Sequence[str], rate: float, seconds: float) -> GraphArguments:
    for key in ("rate", "duration", "bag", "record"):
        if any(word.startswith(f"{key}:=") for word in words):
            raise ParameterError(f"{key}: set by the benchmark")
    if not seconds >= 1:
        raise ParameterError(f"seconds = {seconds:g}: must leave at least 1 s for each run")
    return replace(parse_arguments(words), rate=rate, duration=seconds)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)

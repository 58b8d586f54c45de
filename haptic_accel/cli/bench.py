"""``haptic-accel bench latency``: latency and cost of the graph, beside two references."""

from __future__ import annotations

import math
import os
import tempfile
import threading
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

from haptic_accel.bags.delivery import AGE_OF, LABELS, Delivery, durations, read_delivery
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import FILE, json_option, listed_numbers, verb, words
from haptic_accel.cli.output import save
from haptic_accel.cli.running import run_to_end, stop_on_signal
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import EXECUTOR, INTERRUPTED
from haptic_accel.core.topics import SIGNALS
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.graph.words import given_keys

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
        self._processes: list[tuple[str, psutil.Process]] = []
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
                    started = [item for each in self._engaged for item in each.pids.items()]
                    processes = [(name, psutil.Process(pid)) for name, pid in started]
                    for _, process in processes:
                        process.cpu_percent()  # counts from here
                    self._processes = processes
            elif line.endswith("is over") and self._processes and not self.cpu_cores:
                self._take()

    def _take(self) -> None:
        for name, process in self._processes:
            cores = process.cpu_percent() / 100
            self.cpu_cores[name] = self.cpu_cores.get(name, 0.0) + cores
            memory = process.memory_info().rss / MEBI
            self.peak_mb[name] = max(self.peak_mb.get(name, 0.0), memory)
        self.cpu_cores["total"] = sum(self.cpu_cores.values())


@verb(
    "haptic-accel bench latency rig:=ideal --rate 2000",
    "haptic-accel bench latency composed:=true --rates 500,1000,2000,4000 --seconds 5",
)
@words(GraphArguments)
@click.option("--rate", default=1000.0, help="Sampling rate, Hz.")
@click.option(
    "--rates",
    type=listed_numbers,
    metavar="HZ,HZ,...",
    help="Sampling rates to compare, Hz: finds the highest that is held, without references.",
)
@click.option(
    "--pairs", type=click.IntRange(1, MOST_PAIRS), default=1, help="Number of graphs at a time."
)
@click.option("--seconds", default=20.0, help="Length of each measurement, s.")
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
) -> None:
    """Measure the latency of the whole graph, beside two references.

    Runs the graph as users do, the same on rclpy's default executor, and the same two hops as
    bare UDP, in turns. Prints ages, losses, CPU and memory.
    """
    if rates:
        metrics = _compared(words, rates, pairs, seconds)
        if plot:
            _draw(metrics["rows"]).savefig(plot, dpi=120)
        save(metrics, json_file)
        if not metrics["rows"]:
            raise StoppedError
        return
    # Imports ROS, which the measuring of rates alone does without.
    from haptic_accel.cli.udp_floor import udp_floor

    span = seconds / ROUNDS
    arguments = _arguments(words, rate, span)
    runs: dict[str, list[Metrics]] = {"graph": [], "default": [], "floor": []}
    with stop_on_signal() as stop:
        for index in range(ROUNDS):
            turn = f"round {index + 1} of {ROUNDS}"
            click.echo(f"{turn}: the graph, {pairs} x {rate:g} Hz, {span:g} s", err=True)
            runs["graph"].append(measure(arguments, pairs, "events", stop))
            click.echo(f"{turn}: the same on rclpy's default executor", err=True)
            runs["default"].append(measure(arguments, pairs, "default", stop))
            click.echo(f"{turn}: the same two hops as bare UDP", err=True)
            runs["floor"].append(udp_floor(rate, span))
    ours, default, floor = (merged(runs[name], fmean) for name in ("graph", "default", "floor"))
    metrics = {
        "rate_hz": rate,
        "seconds": seconds,
        "pairs": pairs,
        **ours,
        "default_executor": {name: default[name] for name in ("age_us", "cpu_cores")},
        "udp_floor": {"age_us": floor["age_us"]},
        "ratio_to_default_p50": ours["age_us"]["p50"] / default["age_us"]["p50"],
        "ratio_to_floor_p50": ours["age_us"]["p50"] / floor["age_us"]["p50"],
    }
    _print_latency(metrics)
    save(metrics, json_file)


def _compared(words: Sequence[str], rates: Sequence[float], pairs: int, seconds: float) -> Metrics:
    """Measure the graph at several rates, and print the metrics."""
    runs = {rate: _arguments(words, rate, seconds) for rate in rates}
    rows: list[Metrics] = []
    not_run: list[float] = []
    with stop_on_signal() as stop:
        for rate, arguments in runs.items():
            click.echo(f"{pairs} x {rate:g} Hz, {seconds:g} s", err=True)
            try:
                metrics = measure(arguments, pairs, "events", stop)
            except StoppedError as end:
                if end.status == INTERRUPTED:
                    raise
                # A rate beyond the machine's limits is a result too; the next may be lower.
                not_run.append(rate)
                continue
            late_share = _late_share(metrics)
            rows.append({"rate_hz": rate, "pairs": pairs, **metrics, "late_share": late_share})
    held = max((r["rate_hz"] for r in rows if r["late_share"] < LATE_SHARE), default=None)
    _print_rates(rows, held)
    for rate in not_run:
        print(f"could not be run: {pairs} x {rate:g} Hz")
    return {"seconds": seconds, "rate_held_hz": held, "rows": rows, "not_run": not_run}


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
    first = int(os.environ.get(DOMAIN, 0))

    def run_pair(pair: int) -> Metrics:
        bag = Path(folder) / f"pair_{pair}"
        environment = {EXECUTOR: executor, DOMAIN: str((first + pair) % DOMAINS)}
        supervisor = Supervisor(graph(replace(arguments, bag=str(bag))), environment=environment)
        supervisor.on_line = lambda _, line: usage.watch(supervisor, line)
        run_to_end(supervisor, stop)
        return _pair_metrics(read_delivery(bag, arguments.rate))

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(pairs) as pool:
        metrics = merged(list(pool.map(run_pair, range(pairs))), max)
    if not usage.cpu_cores:
        raise StoppedError("the graphs never ran at the same time: use more --seconds")
    return {**metrics, "cpu_cores": usage.cpu_cores, "peak_mb": usage.peak_mb}


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
"""Metrics that are added, whatever joins the others."""


def merged(values: Sequence[Any], join: Callable[[Iterable[Any]], Any], name: str = "") -> Any:
    """Join numbers, or dictionaries of numbers key by key.

    Parameters
    ----------
    values : sequence
    join : callable
        Joins numbers other than counts, which are added, and maxima, which stay the largest.
    name : str
        Key of the values.
    """
    if name in COUNTS:
        join = sum
    if not isinstance(values[0], Mapping):
        return max(values) if name == "max" else join(values)
    keys = dict.fromkeys(key for value in values for key in value)
    return {
        key: merged([value[key] for value in values if key in value], join, key) for key in keys
    }


def _print_latency(metrics: Metrics) -> None:
    rows = {
        "age of the force where it is applied, us": metrics["age_us"],
        "  on rclpy's default executor": metrics["default_executor"]["age_us"],
        "  as bare UDP, same two hops": metrics["udp_floor"]["age_us"],
        "master_device: lateness of its ticks, us": metrics["period_error_us"]["master_device"],
        "slave_device: lateness of its ticks, us": metrics["period_error_us"]["slave_device"],
    }
    shares = ", ".join(f"{name} {share:.2f}" for name, share in metrics["cpu_cores"].items())
    default = metrics["default_executor"]["cpu_cores"]["total"]
    memory = ", ".join(f"{name} {size:.0f}" for name, size in metrics["peak_mb"].items())
    taken, missed = sum(metrics["ticks"].values()), sum(metrics["missed"].values())
    cells = [
        (name, *(f"{ages[label]:.0f}" if label in ages else "-" for label in LABELS))
        for name, ages in rows.items()
    ]
    print_table(
        ("", *LABELS),
        cells,
        title=f"{metrics['pairs']} x {metrics['rate_hz']:g} Hz, {metrics['seconds']:g} s each",
        caption=f"ratio of p50 to the default executor's {metrics['ratio_to_default_p50']:.2f}, "
        f"to bare UDP's {metrics['ratio_to_floor_p50']:.1f}\n"
        f"cores: {shares} (default executor: total {default:.2f})\n"
        f"memory, MiB: {memory}\n"
        f"of {taken} ticks missed {missed}; late, worst topic: {max(metrics['late'].values())}; "
        f"messages lost: {sum(metrics['lost'].values())}, "
        f"dropped by the recorder: {metrics['dropped_by_recorder']}",
        caption_justify="left",
    )


def _late_share(metrics: Metrics) -> float:
    """Share of the devices' ticks that were missed or later than half a period."""
    late = metrics["late"]
    bad = late["slave/tool/acceleration"] + late["master/handle/acceleration"]
    missed = sum(metrics["missed"].values())
    return float((bad + missed) / (sum(metrics["ticks"].values()) + missed))


def _print_rates(rows: Sequence[Metrics], held: float | None) -> None:
    cells = [
        (
            f"{row['rate_hz']:g}",
            *(f"{row['age_us'][q]:.0f}" if row["age_us"] else "-" for q in ("p50", "p99")),
            f"{row['cpu_cores']['total']:.2f}",
            f"{100 * row['late_share']:.2f}",
            str(sum(row["lost"].values())),
        )
        for row in rows
    ]
    headings = ("rate, Hz", "age p50, us", "p99, us", "cores", "late, %", "lost")
    title = f"highest rate held: {f'{held:g} Hz' if held else 'none'}"
    print_table(headings, cells, left=0, title=title)


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
    ages.grid(alpha=0.3)
    cores.plot(rates, [row["cpu_cores"]["total"] for row in rows], "o-")
    cores.set(xlabel="rate (Hz)", ylabel="CPU of all nodes (cores)")
    cores.grid(alpha=0.3)
    return figure


def _arguments(words: Sequence[str], rate: float, seconds: float) -> GraphArguments:
    for key in given_keys(words):
        if key in ("rate", "duration", "bag", "record"):
            raise ParameterError(f"{key}: set by the benchmark")
    if not seconds >= 1:
        raise ParameterError(f"seconds = {seconds:g}: must leave at least 1 s for each run")
    arguments = replace(parse_arguments(words), rate=rate, duration=seconds)
    # Refuses what no node would accept before the first run.
    graph(arguments)
    return arguments

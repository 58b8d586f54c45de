"""``haptic-accel bench``: how fast the graph is and what it costs, beside two yardsticks."""

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
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from haptic_accel.bags.delivery import AGE_OF, LABELS, Delivery, durations, read_delivery
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import FILE, Verb, json_option, listed, listed_numbers, words
from haptic_accel.cli.output import save
from haptic_accel.cli.running import StopOnSignal, conclude
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, EXECUTOR, FAILED, INTERRUPTED
from haptic_accel.core.topics import SIGNALS
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Supervisor

ROUNDS = 2
"""How often graph and yardsticks take turns, so that all meet the same machine."""

SWEEP_RATES = (500.0, 1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0, 8000.0)
"""Hz."""

SWEEP_PAIRS = (1, 2, 4, 8)
KILOHERTZ = 1000.0
"""The paper's rate, Hz."""

MOST_PAIRS = 16
"""More would ask the machine for hundreds of processes."""

LATE_SHARE = 0.001
"""Share of late or missed ticks up to which a rate counts as held."""

MESSAGE = bytes(84)
"""As long as an AccelStamped of the graph."""

DOMAIN = "ROS_DOMAIN_ID"
DOMAINS = 102
"""Domains whose ports stay below those that Linux hands out."""

MEBI = 2**20

Figures = dict[str, Any]


class Usage:
    """What the processes of graphs use while all of them are engaged.

    Parameters
    ----------
    graphs : int
        How many run at the same time.

    Attributes
    ----------
    cpu_cores, peak_mb : dict
        By executable, over all graphs: cores used; resident memory of the largest, MiB. Empty
        while the graphs have not all been engaged at the same time and one of them ended.
    """

    def __init__(self, graphs: int) -> None:
        self._graphs = graphs
        self._engaged: list[Supervisor] = []
        self._before: dict[int, tuple[float, float]] = {}
        self._lock = threading.Lock()
        self.cpu_cores: dict[str, float] = {}
        self.peak_mb: dict[str, float] = {}

    def watch(self, supervisor: Supervisor, line: str) -> None:
        """Take a line of output: a coupler says when its arms engage and when it is over."""
        # A process that is gone is a pair that failed, which says so itself.
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
    """Return CPU time used by a process, and when, s."""
    used = psutil.Process(pid).cpu_times()
    return used.user + used.system, time.monotonic()


@click.command(cls=Verb)
@words(GraphArguments)
@click.option("--rate", type=float, default=1000.0, help="Sampling rate, Hz.")
@click.option("--pairs", type=int, default=1, help="Number of graphs that run at a time.")
@click.option("--seconds", type=float, default=20.0, help="Length of each measurement, s.")
@json_option
def latency(
    words: Sequence[str], *, rate: float, seconds: float, pairs: int, json_file: Path | None
) -> int:
    """Measure the latency of the whole graph, beside two references.

    Runs the graph as users do, the same on rclpy's default executor, and the same two hops as
    bare UDP, in turns. Prints ages, losses, CPU and memory.
    """
    # Needs rclpy, which other verbs do without.
    from haptic_accel.cli.udp_floor import udp_floor

    arguments = _arguments(words, rate, seconds / ROUNDS)
    _check_pairs(pairs)
    runs: dict[str, list[Figures]] = {"graph": [], "default": [], "floor": []}
    try:
        with StopOnSignal() as stop:
            for index in range(ROUNDS):
                turn = f"round {index + 1} of {ROUNDS}"
                _say(f"{turn}: the graph, {pairs} x {rate:g} Hz, {seconds / ROUNDS:g} s")
                runs["graph"].append(measure(arguments, pairs, "events", stop))
                _say(f"{turn}: the same on rclpy's default executor")
                runs["default"].append(measure(arguments, pairs, "default", stop))
                _say(f"{turn}: the same two hops as bare UDP")
                runs["floor"].append(udp_floor(rate, seconds / ROUNDS, MESSAGE))
    except StoppedError as reason:
        return reason.status
    figures = _latency_figures(rate, seconds, pairs, runs)
    Console().print(_latency_table(figures))
    save(figures, json_file)
    return DONE


def measure(
    arguments: GraphArguments, pairs: int, executor: str, stop: Callable[[], bool]
) -> Figures:
    """Run graphs as users run them and return what they report, over all pairs.

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
        figures = _joined([_pair_figures(run.result()) for run in runs])
    if not usage.cpu_cores:
        _say("the pairs never ran at the same time: take more seconds")
        raise StoppedError(FAILED)
    return {**figures, "cpu_cores": usage.cpu_cores, "peak_mb": usage.peak_mb}


def _run_pair(
    arguments: GraphArguments,
    environment: dict[str, str],
    usage: Usage,
    stop: Callable[[], bool],
) -> Delivery:
    supervisor = Supervisor(graph(arguments), environment=environment)
    supervisor.on_line = lambda _, line: usage.watch(supervisor, line)
    outcome = supervisor.run(stop)
    if not outcome.first:
        raise StoppedError(INTERRUPTED)
    if conclude(outcome) != DONE:
        raise StoppedError(FAILED)
    return read_delivery(Path(arguments.bag), arguments.rate)


def _pair_figures(delivery: Delivery) -> Figures:
    """Return one graph's figures; late means more than half a period where it is used."""
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
"""Figures that add up."""


def _joined(pairs: Sequence[Figures]) -> Figures:
    """Join the figures of pairs that ran at the same time: the worst, or the sum of counts."""
    return _by_key(pairs, max)


def _mean(rounds: Sequence[Figures]) -> Figures:
    """Join the figures of rounds: the mean, the worst of maxima, or the sum of counts."""
    return _by_key(rounds, fmean)


def _by_key(runs: Sequence[Figures], join: Callable[[Iterable[Any]], Any]) -> Figures:
    return {
        key: _merge([run[key] for run in runs], sum if key in COUNTS else join) for key in runs[0]
    }


def _merge(values: Sequence[Any], join: Callable[[Iterable[Any]], Any], label: str = "") -> Any:
    """Join numbers, or dictionaries of numbers key by key; what is called max stays the worst."""
    if not isinstance(values[0], Mapping):
        return max(values) if label == "max" else join(values)
    keys = {key: None for value in values for key in value}
    return {
        key: _merge([value[key] for value in values if key in value], join, key) for key in keys
    }


def _latency_figures(
    rate: float, seconds: float, pairs: int, runs: Mapping[str, Sequence[Figures]]
) -> Figures:
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


def _latency_table(figures: Figures) -> Table:
    table = Table(
        title=f"{figures['pairs']} x {figures['rate_hz']:g} Hz, {figures['seconds']:g} s each"
    )
    for heading in ("", *LABELS):
        table.add_column(heading, justify="right" if heading else "left")
    rows = {
        "age of the force where it is applied, us": figures["age_us"],
        "  on rclpy's default executor": figures["default_executor"]["age_us"],
        "  as bare UDP, same two hops": figures["udp_floor"]["age_us"],
        "master_device: lateness of its ticks, us": figures["period_error_us"]["master_device"],
        "slave_device: lateness of its ticks, us": figures["period_error_us"]["slave_device"],
    }
    for name, ages in rows.items():
        table.add_row(name, *(f"{ages[label]:.0f}" if label in ages else "-" for label in LABELS))
    cores = figures["cpu_cores"]
    shares = ", ".join(f"{name} {share:.2f}" for name, share in cores.items())
    default = figures["default_executor"]["cpu_cores"]["total"]
    memory = ", ".join(f"{name} {size:.0f}" for name, size in figures["peak_mb"].items())
    taken, missed = sum(figures["ticks"].values()), sum(figures["missed"].values())
    table.caption = (
        f"ratio of p50 to the default executor's {figures['ratio_to_default_p50']:.2f}, "
        f"to bare UDP's {figures['ratio_to_floor_p50']:.1f}\n"
        f"cores: {shares} (default executor: total {default:.2f})\n"
        f"memory, MiB: {memory}\n"
        f"of {taken} ticks missed {missed}; late, worst topic: {max(figures['late'].values())}; "
        f"messages lost: {sum(figures['lost'].values())}, "
        f"dropped by the recorder: {figures['dropped_by_recorder']}"
    )
    table.caption_justify = "left"
    return table


@click.command(cls=Verb)
@words(GraphArguments)
@click.option(
    "--rates",
    type=listed_numbers(float),
    default=listed(SWEEP_RATES),
    metavar="HZ,HZ,...",
    help="Sampling rates of one graph, Hz.",
)
@click.option(
    "--pairs",
    type=listed_numbers(int),
    default=listed(SWEEP_PAIRS),
    metavar="N,N,...",
    help="Numbers of graphs at 1 kHz.",
)
@click.option("--out", type=FILE, default="results", metavar="FOLDER", help="Folder for the plot.")
@click.option("--seconds", type=float, default=5.0, help="Length of each measurement, s.")
@json_option
def sweep(
    words: Sequence[str],
    *,
    rates: Sequence[float],
    pairs: Sequence[int],
    seconds: float,
    out: Path,
    json_file: Path | None,
) -> int:
    """Find the highest rate that is held with less than 0.1 % late.

    Draws ages and CPU against rate (500 Hz to 8 kHz) and against the number of pairs (1 to 8).
    """
    plan = list(dict.fromkeys([(rate, 1) for rate in rates] + [(KILOHERTZ, n) for n in pairs]))
    _check_pairs(max(pairs))
    rows: list[Figures] = []
    not_run: list[Figures] = []
    status = DONE
    with StopOnSignal() as stop:
        for index, (rate, count) in enumerate(plan):
            _say(f"{index + 1} of {len(plan)}: {count} x {rate:g} Hz, {seconds:g} s")
            try:
                figures = measure(_arguments(words, rate, seconds), count, "events", stop)
            except StoppedError as reason:
                status = reason.status
                if status == INTERRUPTED:
                    break
                # More than the machine can do is an outcome; what comes after may be less.
                not_run.append({"rate_hz": rate, "pairs": count})
                continue
            rows.append({"rate_hz": rate, "pairs": count, **figures})
            rows[-1]["late_share"] = _late_share(rows[-1])
    if rows:
        out.mkdir(parents=True, exist_ok=True)
        _draw(rows).savefig(out / "sweep.png", dpi=120)
        Console().print(_sweep_table(rows))
        print(f"figure: {out / 'sweep.png'}")
        for row in not_run:
            print(f"could not be run: {row['pairs']} x {row['rate_hz']:g} Hz")
        held = _rate_held(rows)
        save(
            {"seconds": seconds, "rate_held_hz": held, "rows": rows, "not_run": not_run},
            json_file,
        )
        status = INTERRUPTED if status == INTERRUPTED else DONE
    return status


def _late_share(figures: Figures) -> float:
    """Share of the devices' ticks that were missed or later than half a period."""
    late = figures["late"]
    bad = late["slave/tool/acceleration"] + late["master/handle/acceleration"]
    missed = sum(figures["missed"].values())
    return float((bad + missed) / (sum(figures["ticks"].values()) + missed))


def _rate_held(rows: Sequence[Figures]) -> float | None:
    held = [r["rate_hz"] for r in rows if r["pairs"] == 1 and r["late_share"] < LATE_SHARE]
    return max(held, default=None)


def _sweep_table(rows: Sequence[Figures]) -> Table:
    held = _rate_held(rows)
    table = Table(title=f"highest rate held: {f'{held:g} Hz' if held else 'none'}")
    for heading in ("pairs", "rate, Hz", "age p50, us", "p99, us", "cores", "late, %", "lost"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            str(row["pairs"]),
            f"{row['rate_hz']:g}",
            *(f"{row['age_us'][q]:.0f}" if row["age_us"] else "-" for q in ("p50", "p99")),
            f"{row['cpu_cores']['total']:.2f}",
            f"{100 * row['late_share']:.2f}",
            str(sum(row["lost"].values())),
        )
    return table


def _draw(rows: Sequence[Figures]) -> Figure:
    """Draw age and CPU against rate and against pairs."""
    figure = Figure(figsize=(10, 7), layout="constrained")
    panels = figure.subplots(2, 2, sharex="col")
    by_rate = [row for row in rows if row["pairs"] == 1]
    by_pairs = [row for row in rows if row["rate_hz"] == KILOHERTZ]
    for column, found, key, label in (
        (0, by_rate, "rate_hz", "rate (Hz)"),
        (1, by_pairs, "pairs", "pairs of arms at 1 kHz"),
    ):
        x = [row[key] for row in found]
        for quantile in ("p50", "p99"):
            ages = [row["age_us"].get(quantile, math.nan) for row in found]
            panels[0, column].plot(x, ages, "o-", label=quantile)
        panels[1, column].plot(x, [row["cpu_cores"]["total"] for row in found], "o-")
        panels[1, column].set_xlabel(label)
        _dress(panels[0, column], "age of the force (us)")
        _dress(panels[1, column], "CPU of all nodes (cores)")
        panels[0, column].set_yscale("log")
        panels[0, column].legend()
    return figure


def _dress(panel: Axes, label: str) -> None:
    panel.set_ylabel(label)
    panel.grid(alpha=0.3)


def _arguments(words: Sequence[str], rate: float, seconds: float) -> GraphArguments:
    for key in ("rate", "duration", "bag", "record"):
        if any(word.startswith(f"{key}:=") for word in words):
            raise ParameterError(f"{key}: set by the benchmark")
    if not seconds >= 1:
        raise ParameterError(f"seconds = {seconds:g}: must leave at least 1 s for each run")
    return replace(parse_arguments(words), rate=rate, duration=seconds)


def _check_pairs(pairs: int) -> None:
    if not 1 <= pairs <= MOST_PAIRS:
        raise ParameterError(f"pairs = {pairs}: must be from 1 to {MOST_PAIRS}")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)

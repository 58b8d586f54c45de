# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Missed deadlines, force ages and cost of graphs, compared with an empty loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_accel.bags.delivery import LABELS, Delivery, durations
from haptic_accel.core.tables import Column, ResultTable, Row, number
from haptic_accel.core.tick.device_side import IN_TIME, MISSED_SHARE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pair_metrics(delivery: Delivery) -> Row:
    """Return one graph's metrics."""
    nodes = delivery.nodes
    devices = ("master_device", "slave_device")
    return {
        "deadlines": delivery.deadlines,
        "age_us": delivery.age_us,
        "period_error_us": {name: durations(nodes[name], "tick lateness") for name in devices},
        "late": {name: int(nodes[name]["late ticks"]) for name in devices},
        "lost": delivery.lost,
        "missed": delivery.missed,
        "ticks": {name: int(nodes[name]["ticks"]) for name in devices},
        "dropped_by_recorder": int(nodes["recorder"]["dropped"]),
    }


COUNTS = {
    *("due", "missed", "past_tick", "late_s", "of", "late", "lost", "ticks"),
    "dropped_by_recorder",
}
"""Metrics that are always added."""

MAXIMA = {"max", "longest_us"}
"""Metrics whose maximum is kept."""


def merged(values: Sequence[Any], join: Callable[[Iterable[Any]], Any], name: str = "") -> Any:
    """Join numbers, or dictionaries of numbers key by key.

    Parameters
    ----------
    values : sequence
    join : callable
        Function for numbers that are neither counts (added) nor maxima (the largest is kept).
    name : str
        Key of the values.
    """
    if name in COUNTS:
        join = sum
    if not isinstance(values[0], Mapping):
        return float(np.max(values)) if name in MAXIMA else join(values)
    keys = dict.fromkeys(key for value in values for key in value)
    return {
        key: merged([value[key] for value in values if key in value], join, key) for key in keys
    }


def missed_share(metrics: Row) -> float:
    """Return the largest share of missed deadlines among the kinds of command."""
    return max(
        (counts["missed"] / counts["due"] for counts in metrics["deadlines"].values()),
        default=math.nan,
    )


def latency_table(metrics: Row) -> ResultTable:
    """Return the metrics of a graph and of an empty loop."""
    rows = {
        "age of the force where it is applied, us": metrics["age_us"],
        "master_device: lateness of its ticks, us": metrics["period_error_us"]["master_device"],
        "slave_device: lateness of its ticks, us": metrics["period_error_us"]["slave_device"],
        "empty loop: lateness of its ticks, us": metrics["empty_loop"]["lateness_us"],
    }
    deadlines = metrics["deadlines"] | _empty(metrics)["deadlines"]
    missed = "; ".join(_missed(name, counts) for name, counts in deadlines.items())
    shares = ", ".join(f"{name} {share:.2f}" for name, share in metrics["cpu_cores"].items())
    memory = ", ".join(f"{name} {size:.0f}" for name, size in metrics["peak_mb"].items())
    cells = [
        (name, *(number(ages.get(label), 0) for label in LABELS)) for name, ages in rows.items()
    ]
    return ResultTable(
        ("", *LABELS),
        cells,
        title=f"{metrics['pairs']} x {metrics['rate_hz']:g} Hz, {metrics['tick']}",
        note=f"forces in effect more than {IN_TIME:g} periods after their due time: {missed}\n"
        f"cores: {shares}\n"
        f"memory, MiB: {memory}\n"
        f"samples not taken: {sum(metrics['missed'].values())}; "
        f"messages lost: {sum(metrics['lost'].values())}, "
        f"dropped by the recorder: {metrics['dropped_by_recorder']}",
    )


def _empty(metrics: Row) -> Row:
    """Return the empty loop's ticks in the form of a graph's deadlines."""
    loop = metrics["empty_loop"]
    counts = {**loop, "due": loop["of"], "longest_us": loop["lateness_us"]["max"]}
    return {"deadlines": {"empty loop": counts}}


def _missed(name: str, counts: Mapping[str, float]) -> str:
    return f"{name} {counts['missed']} of {counts['due']}{latest_text(counts['longest_us'])}"


def latest_text(longest: float) -> str:
    """Return a text on the largest delay, us; empty if only an earlier maximum is known."""
    return f", the latest by {longest * 1e-3:.1f} ms" * math.isfinite(longest)


def _latest(deadlines: Mapping[str, Row]) -> float:
    """Return the largest delay of a force after its deadline, ms; NaN if one is not known."""
    longest = [counts["longest_us"] for counts in deadlines.values()]
    return 1e-3 * float(np.max(longest)) if longest else math.nan


RATES = (
    Column("rate_hz", "rate", "Hz"),
    Column("tick", "tick"),
    Column("age_p50_us", "age p50", "us", 0, lambda row: row["age_us"].get("p50")),
    Column("age_p99_us", "p99", "us", 0, lambda row: row["age_us"].get("p99")),
    Column("cpu_cores", "cores", "", 2, lambda row: row["cpu_cores"]["total"]),
    Column("", "deadlines missed", "%", 2, missed_share, 100.0),
    Column("", "latest", "ms", 1, lambda row: _latest(row["deadlines"])),
    Column("", "empty loop", "%", 2, lambda row: missed_share(_empty(row)), 100.0),
    Column(
        "", "samples lost", value=lambda row: sum((*row["lost"].values(), *row["missed"].values()))
    ),
)
"""Columns of the tables that compare rates, and compiled with plain Python."""


def rate_held(rows: Sequence[Row]) -> float | None:
    """Return the highest rate with almost no missed deadlines, Hz; None if there is none."""
    return max((r["rate_hz"] for r in rows if missed_share(r) < MISSED_SHARE), default=None)


def draw(rows: Sequence[Row]) -> Figure:
    """Draw age and CPU against rate."""
    from matplotlib.figure import Figure

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

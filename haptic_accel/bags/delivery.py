# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Delivery of samples through the graph: losses, missed deadlines, and the age of forces."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from haptic_accel.bags.reading import Bag, Diagnosis, read_bag
from haptic_accel.core import topics
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, read_decimal, read_whole
from haptic_accel.core.sampling import NANOSECONDS, RELEASED, SAME_RATE, grid_indices, on_grid
from haptic_accel.core.tick.device_side import LATE_TIME, LONGEST, PAST_TICK
from haptic_accel.core.tick.watching import QUANTILES

AGE_OF = "actuator force"
"""Command whose age is reported, as users perceive this force."""

COMMANDS = {
    AGE_OF: ("master_device", AGE_OF),
    "master arm force": ("master_device", "arm force"),
    "slave arm force": ("slave_device", "arm force"),
}
"""Node that applies each kind of command, and the command's name in diagnostics."""

DEVICES = tuple(dict.fromkeys(node for node, _ in COMMANDS.values()))
"""Nodes that apply forces."""

LABELS = (*QUANTILES, "max")
"""Labels of durations in diagnostics."""

_Spans: TypeAlias = Sequence[tuple[int, int]]  # starts and ends, ns

_NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")


@dataclass(frozen=True)
class Delivery:
    """Delivery of samples in one section of a bag.

    Attributes
    ----------
    lost : dict
        Numbers of messages lost after their sample was taken, by topic.
    missed : dict
        Numbers of grid points without a sample, by arm.
    age_us : dict
        Age of the actuator's forces when applied, us, from the device's last report: p50, p90,
        p99, p99_9, max.
    deadlines : dict
        Counts of forces with a due time (``due``) and of forces that acted later (``missed``), by
        kind of command, from the devices' reports for this section: ``{"actuator force": {"due":
        n, "missed": n, "past_tick": n, "longest_us": t, "late_s": t}, ...}``. ``longest_us`` is
        NaN if the maximum occurred before the section. Older bags lack the last three keys; their
        ``missed`` counts forces that arrived after their tick was executed.
    ticks_late_us : float
        Maximum delay of a device's tick since the device was opened, us; NaN if not reported.
    warnings : list of str
        Warnings in the nodes' diagnostics, each kind once with its largest number, without missed
        deadlines.
    nodes : dict
        Last diagnostics of each node.
    """

    lost: dict[str, int]
    missed: dict[str, int]
    age_us: dict[str, float]
    deadlines: dict[str, dict[str, float]]
    ticks_late_us: float
    warnings: list[str]
    nodes: dict[str, dict[str, str]]

    @property
    def by_clock(self) -> bool:
        """True if all missed deadlines were measured by the clock, or none occurred."""
        return all("longest_us" in counts for counts in self.deadlines.values())


def delivery(recorded: Bag, start: int, length: int, rate: float) -> Delivery:
    """Count losses and missed deadlines in a section of a bag, and find the ages of forces.

    Parameters
    ----------
    recorded : Bag
    start : int
        Start of the sampling grid, ns.
    length : int
        Length of the section, samples.
    rate : float
        Samples per second of the grid.
    """
    seen: dict[str, Any] = {}
    along = list(recorded.axes.indices)
    for topic in topics.SIGNALS:
        signal = recorded.signals.get(topic.name)
        if signal is None:
            continue
        where, values = grid_indices(signal.stamps, start, rate), signal.values[:, along]
        _, there = on_grid(where, values if len(values) else np.zeros(len(where)), length)
        if there.any():
            seen[topic.name] = there
    known = [topic for topic in topics.SIGNALS if topic.name in seen]
    # A sample exists if any of its messages exists.
    ticks = {
        arm: np.any([seen[topic.name] for topic in known if topic.source == arm], axis=0)
        for arm in topics.ARMS
        if any(topic.source == arm for topic in known)
    }
    end = start + round(length * (NANOSECONDS / rate))
    # Reports before and after a trial contain waits of nodes for each other.
    reports = [said for said in recorded.diagnostics if start <= said.received < end]
    coupled = recorded.coupled(topics.MASTER) or [(start, end)]
    return Delivery(
        lost={topic.name: int(np.sum(ticks[topic.source] & ~seen[topic.name])) for topic in known},
        missed={arm: length - int(np.sum(there)) for arm, there in ticks.items()},
        age_us=durations(_report(recorded, "master_device", end), f"{AGE_OF} age"),
        deadlines={
            name: counts
            for name, (node, command) in COMMANDS.items()
            if (counts := _deadlines(recorded, node, command, coupled, (start, end), rate))
        },
        ticks_late_us=max(
            (
                found["max"]
                for node in DEVICES
                if "max" in (found := durations(_counts(recorded, node, end), "tick lateness"))
            ),
            default=math.nan,
        ),
        warnings=_warnings(reports),
        nodes={said.node: said.values for said in recorded.diagnostics},
    )


def _warnings(reports: Sequence[Diagnosis]) -> list[str]:
    """Return each kind of warning once, with its largest number and its number of reports."""
    kinds: dict[tuple[str, str], list[str]] = {}
    for said in reports:
        for warning in said.message.split(", "):
            if warning not in ("OK", "") and not warning.endswith("deadlines missed"):
                kinds.setdefault((said.node, _NUMBER.sub("", warning)), []).append(warning)
    return [
        f"{node}: {max(found, key=_largest)}{f' ({len(found)} times)' if len(found) > 1 else ''}"
        for (node, _), found in kinds.items()
    ]


def _largest(warning: str) -> float:
    return max(map(float, _NUMBER.findall(warning)), default=0.0)


def read_delivery(bag: Path, rate: float) -> Delivery:
    """Return the delivery of all samples of a bag, from the first time with all signals.

    Raises
    ------
    ParameterError
        The path is no bag, or the bag lacks a signal.
    """
    recorded = read_bag(bag)
    needed = (*topics.ANALYSED, topics.MASTER_ARM_FORCE)
    for topic in needed:
        if topic.name not in recorded.signals:
            raise ParameterError(f"{bag}: has no message of {topic.name}")
    stamps = [recorded.signals[topic.name].stamps for topic in needed]
    start, end = int(max(s[0] for s in stamps)), int(min(s[-1] for s in stamps))
    length = round((end - start) * rate / NANOSECONDS) + 1
    if length < 2:
        raise ParameterError(f"{bag}: its signals do not overlap")
    return delivery(recorded, start, length, rate)


def durations(values: Mapping[str, str], name: str) -> dict[str, float]:
    """Return the valid quantiles in a node's report, us."""
    found = {}
    for label in LABELS:
        with suppress(ValueError):
            found[label] = read_decimal(values.get(f"{name} {label} (us)", ""))
    return found


def count(values: Mapping[str, str], name: str) -> int:
    """Return a count from a node's report; 0 if not a number."""
    try:
        return read_whole(values.get(name, ""))
    except ValueError:
        return 0


def _report(recorded: Bag, node: str, end: int) -> Mapping[str, str]:
    """Return a node's last report before the end of a section, or shortly after it."""
    reports = [d for d in recorded.diagnostics if d.node == node]
    within = [d for d in reports if d.received <= end] or reports[:1]
    return within[-1].values if within else {}


def _counts(recorded: Bag, node: str, end: int) -> Mapping[str, str]:
    """Return a node's first report after a section, or else the node's last report.

    Earlier reports do not include the pause that disengaged the arms.
    """
    reports = [d for d in recorded.diagnostics if d.node == node]
    after = [d for d in reports if d.received >= end] or reports[-1:]
    return after[0].values if after else {}


def _deadlines(
    recorded: Bag, node: str, command: str, coupled: _Spans, span: tuple[int, int], rate: float
) -> dict[str, float]:
    """Return a command's deadline statistics in a span of time, ns; empty if none was due.

    Devices report counts since they were opened, once per second. Counts are interpolated between
    reports, over the time in which the arms are coupled, as a force is due at every sample.
    """
    reports = [
        (said.received, counts)
        for said in recorded.diagnostics
        if said.node == node and (counts := _reported(said.values, command))
    ]
    if not reports:
        return {}
    times = [received for received, _ in reports]
    found: dict[str, float] = {}
    keys = [key for key in reports[-1][1] if key != "longest_us"]
    begins = _first_counts(reports[0], rate, min(coupled[0][0], span[0]))
    for key in keys:
        values = [counts.get(key, 0) for _, counts in reports]
        # A device that was opened again counts from zero.
        grown = np.diff(values, prepend=begins.get(key, 0.0))
        total = np.cumsum(np.where(grown < 0, values, grown))
        before, after = _at(span, times, total, coupled)
        found[key] = float(after - before) if key == "late_s" else round(after - before)
    if not found["due"]:
        return {}
    if "longest_us" in reports[-1][1]:
        earlier = [counts["longest_us"] for at, counts in reports if at <= span[0]]
        until = [counts["longest_us"] for at, counts in reports if at >= span[1]]
        longest = until[0] if until else reports[-1][1]["longest_us"]
        found["longest_us"] = math.nan if earlier and earlier[-1] >= longest else longest
    return found


def _first_counts(
    first: tuple[int, Mapping[str, float]], rate: float, begin: int
) -> dict[str, float]:
    """Return a device's counts at the start of a bag, which may start after the device.

    At most one force is due at each sample, so further forces were due before the bag.
    """
    received, counts = first
    here = max(0.0, (received - begin) * rate / NANOSECONDS)
    if counts["due"] <= here * (1 + SAME_RATE) + rate * RELEASED:
        return {}
    return {**counts, "due": counts["due"] - here}


def _at(
    span: tuple[int, int], times: Sequence[int], total: FloatArray, coupled: _Spans
) -> FloatArray:
    """Interpolate an increasing count at both ends of a span."""
    moments: list[int] = []
    values: list[float] = []
    value = 0.0
    for begin, end in coupled:
        within = [index for index, time in enumerate(times) if begin < time < end]
        after = next((index for index, time in enumerate(times) if time >= end), len(times) - 1)
        moments += [begin, *(times[index] for index in within), end]
        values += [value, *(float(total[index]) for index in within), float(total[after])]
        value = values[-1]
    origin = moments[0]
    ends = np.array(span) - origin
    return np.asarray(np.interp(ends, np.array(moments) - origin, values), dtype=float)


def _reported(values: Mapping[str, str], command: str) -> dict[str, float]:
    """Return a command's counts in one report; empty if none was due."""
    due, missed = count(values, f"{command} due"), count(values, f"{command} deadlines missed")
    if not due:
        return {}
    found: dict[str, float] = {"due": due, "missed": missed}
    with suppress(ValueError):  # older devices lack these counts
        found |= {
            "past_tick": count(values, f"{command} {PAST_TICK}"),
            "longest_us": read_decimal(values.get(f"{command} {LONGEST}", "")),
            "late_s": read_decimal(values.get(f"{command} {LATE_TIME}", "")),
        }
    return found

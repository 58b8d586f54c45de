"""Delivery of samples through the graph: losses, delays, and the age of forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.core import topics
from haptic_accel.core.evaluation.histogram import QUANTILES
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, half_period, places

AGE_OF = "actuator force"
"""Command whose age counts: the one whose force is felt."""

LABELS = (*QUANTILES, "max")
"""Labels of durations in diagnostics."""

_ARMS = ("master", "slave")


@dataclass(frozen=True)
class Delivery:
    """Delivery of the samples of one span of a bag.

    Attributes
    ----------
    lost : dict
        Messages that are missing although their sample was taken, by topic.
    late : dict
        Messages recorded more than half a period after their stamp, by topic.
    missed : dict
        Samples of the grid that were not taken, by arm.
    transit : ndarray, shape (n,)
        Time from stamp to recording of each actuator force, s.
    age_us : dict
        Age of the actuator's forces where they were applied, us, as the device reported last: p50,
        p90, p99, p99_9, max.
    warnings : list of str
        Warnings of nodes in their diagnostics.
    nodes : dict
        Last diagnostics of each node.
    """

    lost: dict[str, int]
    late: dict[str, int]
    missed: dict[str, int]
    transit: FloatArray
    age_us: dict[str, float]
    warnings: list[str]
    nodes: dict[str, dict[str, str]]


def delivery(recorded: Bag, start: int, length: int, rate: float) -> Delivery:
    """Count what is missing or late within a span of a bag, and find the ages of forces.

    Parameters
    ----------
    recorded : Bag
    start : int
        Start of the sampling grid, ns.
    length : int
        Length of the span, samples.
    rate : float
        Samples per second of the grid.
    """
    seen: dict[str, Any] = {}
    late: dict[str, int] = {}
    for topic in topics.SIGNALS:
        signal = recorded.signals.get(topic.name)
        if signal is None:
            continue
        where = places(signal.stamps, start, rate)
        within = (where >= 0) & (where < length)
        if within.any():
            seen[topic.name] = np.bincount(where[within], minlength=length) > 0
            waited = (signal.received - signal.stamps)[within]
            late[topic.name] = int(np.sum(waited > half_period(rate)))
    found = [topic for topic in topics.SIGNALS if topic.name in seen]
    # A sample was taken if any message that it caused is there.
    taken = {
        arm: np.any([seen[topic.name] for topic in found if topic.source == arm], axis=0)
        for arm in _ARMS
        if any(topic.source == arm for topic in found)
    }
    end = start + round(length * (NANOSECONDS / rate))
    transit = np.empty(0)
    if forces := recorded.signals.get(topics.ACTUATOR_FORCE.name):
        within = (forces.stamps >= start) & (forces.stamps < end)
        transit = (forces.received - forces.stamps)[within] / NANOSECONDS
    warnings = [
        f"{said.node}: {said.message}"
        for said in recorded.diagnostics
        # Before and after a trial, nodes wait for each other.
        if start <= said.received < end and said.message not in ("OK", "")
    ]
    return Delivery(
        lost={topic.name: int(np.sum(taken[topic.source] & ~seen[topic.name])) for topic in found},
        late=late,
        missed={arm: length - int(np.sum(there)) for arm, there in taken.items()},
        transit=transit,
        age_us=_ages(recorded, end),
        warnings=list(dict.fromkeys(warnings)),
        nodes={said.node: said.values for said in recorded.diagnostics},
    )


def read_delivery(bag: Path, rate: float) -> Delivery:
    """Return the delivery of all samples of a bag, from when all signals were there.

    Raises
    ------
    ParameterError
        It is not a bag, or lacks a signal.
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
    """Return quantiles, in us, that a node reported; those that it did not are left out."""
    found = {label: values.get(f"{name} {label} (us)") for label in LABELS}
    return {label: float(value) for label, value in found.items() if value is not None}


def _ages(recorded: Bag, end: int) -> dict[str, float]:
    """Return the ages that the master's device reported last in a span, or soon behind it."""
    reports = [d for d in recorded.diagnostics if d.node == "master_device"]
    within = [d for d in reports if d.received <= end] or reports[:1]
    return durations(within[-1].values, f"{AGE_OF} age") if within else {}

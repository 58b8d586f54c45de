# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals of a bag for other programs, with name, unit, axes, rate and meaning."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel import Bag, FloatArray, ParameterError, __version__
from haptic_accel.analysis import described, sections
from haptic_accel.bags import Signal
from haptic_accel.core import ALL_AXES, topics
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, missing_samples, sampling_rate
from haptic_accel.core.topics import DEVICES, Topic
from haptic_accel.setup import Parameters, known_arguments, node_schema
from haptic_accel.setup.arguments import POINTER, SIMULATED, VIRTUAL

SCHEMA = 1
"""Version of the names and the order of vibration in learning datasets."""

PUBLISHED = "published"
"""Key of a bag's metadata with licence and author of its exports."""

IN_SIMULATION = (SIMULATED, VIRTUAL, POINTER)
"""Devices of the virtual rig."""

CALIBRATED = ("serial.calibration.", "audio.")
"""Prefixes of parameters from a calibration of sensors."""

UNITS_OF_STATE = ("m", "m", "m", "m/s", "m/s", "m/s")
"""Units of position and velocity."""

PART = 250_000
"""Number of samples that are converted at a time: 8 MB."""

LARGEST = 1e30
"""Largest magnitude of a value in SI units that counts as measured. No sensor reaches it, and
differences, sums and filters of 32-bit numbers (3.4e38) stay finite."""

UNITS = {
    topics.MASTER_POSITION.type: "m",
    topics.MASTER_VELOCITY.type: "m/s",
    topics.MASTER_ARM_FORCE.type: "N",
    topics.HANDLE_ACCELERATION.type: "m/s^2",
}
"""Unit of each type of message."""


@dataclass(frozen=True)
class ExportedSignal:
    """Signal with its name for other programs.

    Attributes
    ----------
    name : str
    topic : Topic
    meaning : str
        Description, a noun phrase.
    """

    name: str
    topic: Topic
    meaning: str

    @property
    def unit(self) -> str:
        """SI unit of the components."""
        return UNITS[self.topic.type]


MASTER_POSITION, MASTER_VELOCITY, SLAVE_POSITION, SLAVE_VELOCITY, TOOL, HANDLE, *_ = SIGNALS = [
    ExportedSignal(name, getattr(topics, name.upper()), meaning)
    for name, meaning in {
        "master_position": "position of the master's handle",
        "master_velocity": "velocity of the master's handle",
        "slave_position": "position of the slave's tool",
        "slave_velocity": "velocity of the slave's tool",
        "tool_acceleration": "acceleration of the tool",
        "handle_acceleration": "acceleration of the handle",
        "desired_acceleration": "acceleration that the handle should have: that of the tool,"
        " high-passed",
        "actuator_force": "force of the voice coil on the handle",
        "master_arm_force": "force of the master's motors on the handle",
        "slave_arm_force": "force of the slave's motors on the tool",
        "contact_force": "force of the surface on the tool",
    }.items()
]
"""Exported signals; a bag has some of them."""


@dataclass(kw_only=True)
class Writer:
    """Interface of a writer of several bags to a folder.

    Attributes
    ----------
    notes : list of str
        Reports of data missing in the result, one line each.
    """

    notes: list[str] = field(default_factory=list)

    def add(self, name: str, bag: Bag) -> None:
        """Append a bag under a name."""

    def close(self) -> None:
        """Write the remaining data."""


def signals_of(bag: Bag) -> Iterator[tuple[ExportedSignal, Signal]]:
    """Yield the signals of a bag, in the order of `SIGNALS`."""
    for exported in SIGNALS:
        if exported.topic.name in bag.signals:
            yield exported, bag.signals[exported.topic.name]


def signal_of(bag: Bag, exported: ExportedSignal) -> Signal:
    """Return a required signal.

    Raises
    ------
    ParameterError
        The bag does not have the signal.
    """
    found = bag.signals.get(exported.topic.name)
    if found is None:
        raise ParameterError(f"{bag.path}: has no {exported.name}, which this format needs")
    return found


def rate_of(bag: Bag, exported: ExportedSignal) -> float:
    """Return the sampling rate of a signal, Hz.

    Raises
    ------
    ParameterError
        The bag does not have the signal, or its samples are not on a grid.
    """
    try:
        return sampling_rate(signal_of(bag, exported).stamps, bag.stated_rate)
    except ParameterError as error:
        raise ParameterError(f"{bag.path}: {exported.name}: {error}") from None


def on_grid(
    bag: Bag, exported: ExportedSignal, start: int, rate: float, length: int
) -> tuple[FloatArray, BoolArray]:
    """Return a signal on a grid, and a mask of samples; missing ones repeat the previous one.

    The signal has the bag's axes, shape (length, axes). A sample that `finite` leaves out counts
    as missing. Parameters as for `Signal.on_grid`.

    Raises
    ------
    ParameterError
        There is no sample on the grid.
    """
    signal = finite(signal_of(bag, exported))
    begin, end = np.searchsorted(signal.stamps, [start, start + int(length / rate * NANOSECONDS)])
    if begin == end:
        raise ParameterError(f"{bag.path}: {exported.name}: has no samples in the exported time")
    values, seen = signal.on_grid(start, rate, length, bag.axes)
    return values.reshape(length, -1), seen


def finite(signal: Signal) -> Signal:
    """Return the samples whose components are all finite, and at most `LARGEST`."""
    known = (np.abs(signal.values) <= LARGEST).all(axis=1)  # false for NaN
    if known.all():
        return signal
    return Signal(signal.stamps[known], signal.received, signal.values[known])


def description(bag: Bag, exported: ExportedSignal) -> dict[str, Any]:
    """Return the description of a signal for readers of an export, for JSON.

    The rate is null if the samples are not on a grid.
    """
    stamps = signal_of(bag, exported).stamps
    rate = None
    with suppress(ParameterError):
        rate = rate_of(bag, exported)
    return {
        "name": exported.name,
        "meaning": exported.meaning,
        "unit": exported.unit,
        "axes": list(ALL_AXES.names),
        "frame": exported.topic.frame,
        "topic": exported.topic.name,
        "rate_hz": rate,
        "samples": len(stamps),
        "missing_samples": missing_samples(stamps) if rate else None,
        "stamps": "ns since 1970-01-01, system time of the recording machine",
    }


def name_of(path: Path) -> str:
    """Return a bag's name as text that any file format can store."""
    whole = path.resolve()
    name = whole.name if whole.is_dir() else whole.stem
    return os.fsencode(name).decode(errors="replace")


def conditions(bag: Bag) -> list[dict[str, Any]]:
    """Return the conditions in each section of a bag, for JSON, with the section's start in ns.

    The first section starts before the bag. Arguments have their values during the recording.
    """
    start = described(bag, Parameters.from_metadata(bag.metadata), bag.stated_rate or 0.0)
    return [
        {"begin_ns": begin, **vars(s.condition), "arguments": {**s.arguments}, "changes": s.notes}
        for begin, s in sections(bag, start)
    ]


def _given(bag: Bag, node: str, begins: tuple[str, ...]) -> dict[str, Any]:
    """Return a node's parameters with the prefixes `begins` that differ from the default."""
    own, known = Parameters.from_metadata(bag.metadata).values.get(node, {}), node_schema(node)
    named = {n: value for n, value in own.items() if n in known and n.startswith(begins)}
    return {name: value for name, value in named.items() if value != known[name][0]}


def descriptions(bag: Bag) -> dict[str, Any]:
    """Return a bag's metadata, equal in all formats, and each signal's description by name.

    Calibration and identification contain the parameters that differ from the default.
    """
    arguments = known_arguments(bag.metadata)
    return {
        "bag": name_of(bag.path),
        "exported_with": {"haptic_accel": __version__, "vibration_schema": SCHEMA},
        "recorded_with": {
            name: bag.metadata.get(name) for name in ("version", "arguments", "host")
        },
        "published": bag.metadata.get(PUBLISHED, {}),
        "simulated": {arm: arguments.get(arm) in IN_SIMULATION for arm in ("master", "slave")},
        "conditions": conditions(bag),
        "calibration": {node: _given(bag, node, CALIBRATED) for node in DEVICES},
        "identification": _given(bag, "compensator", ("plant.",)),
        "units": {"state": UNITS_OF_STATE, "action": UNITS_OF_STATE, "vibration": "m/s^2"},
        "problems": bag.problems,
        "signals": {each.name: description(bag, each) for each, _ in signals_of(bag)},
    }


def write_json(file: Path, content: Any) -> None:
    """Write a description, with arrays as lists."""
    with file.open("w", encoding="utf-8") as opened:
        json.dump(content, opened, indent=2, default=np.ndarray.tolist)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals of a bag for other programs, and frames of a learning dataset.

Each frame has a window of the acceleration of tool and handle, so that no sample is lost although
datasets have 10 to 60 frames per second. Windows have no gap or overlap: joined together they are
the signal.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from haptic_accel import Axes, Bag, FloatArray, ParameterError, __version__
from haptic_accel.analysis import described, sections
from haptic_accel.bags import Signal
from haptic_accel.core import ALL_AXES, sampling, topics
from haptic_accel.core.sampling import NANOSECONDS
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
        return sampling.sampling_rate(signal_of(bag, exported).stamps, bag.stated_rate)
    except ParameterError as error:
        raise ParameterError(f"{bag.path}: {exported.name}: {error}") from None


def on_grid(
    bag: Bag, exported: ExportedSignal, start: int, rate: float, length: int
) -> tuple[FloatArray, sampling.BoolArray]:
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
        "missing_samples": sampling.missing_samples(stamps) if rate else None,
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


SingleArray: TypeAlias = npt.NDArray[np.float32]

STATE = (SLAVE_POSITION, SLAVE_VELOCITY)
ACTION = (MASTER_POSITION, MASTER_VELOCITY)
"""Signals of a frame's state (of the follower, the slave) and action (of the leader, the
master)."""

SETTLING = 1
"""Time before and after an engagement that the resampling's filter may use, s."""

CLOCKS = "do the clocks of both hosts agree, or was one set forward while recording?"
"""Question in the error for related samples that lie far apart in time."""

MOST_HELD = 0.5
"""Maximum share of missing samples or states; a larger share shows that the clocks of the arms
disagree."""


@dataclass(frozen=True)
class FrameRate:
    """Frame rate of a dataset, and its number of samples per frame.

    Attributes
    ----------
    fps : int
        Frames per second.
    rate : float
        Sampling rate of the vibration in the dataset, Hz.
    recorded : float
        Sampling rate of the recording, Hz.
    """

    fps: int
    rate: float
    recorded: float

    @classmethod
    def of(cls, fps: int, rate: float, recorded: float) -> FrameRate:
        """Return the rates of a dataset.

        Parameters
        ----------
        fps : int
            Frames per second.
        rate : float
            Samples per second; 0 for the recording's rate if that is a multiple of `fps`, or else
            for the highest lower rate that is `fps` times a power of two.
        recorded : float
            Samples per second of the recording.

        Raises
        ------
        ParameterError
            The number of samples in a frame is not whole.

        Examples
        --------
        >>> FrameRate.of(30, 0.0, 1000.0).rate, FrameRate.of(50, 0.0, 1000.0).rate
        (960.0, 1000.0)
        """
        if recorded < fps:
            raise ParameterError(f"fps = {fps}: must be at most the rate of {recorded:g} Hz")
        if not rate:
            power = 2 ** int(np.log2(recorded / fps))
            rate = recorded if recorded % fps == 0 else float(fps * power)
        if rate % fps or not fps <= rate <= recorded:
            highest = int(recorded // fps) * fps
            raise ParameterError(
                f"rate = {rate:g} Hz: must be a whole multiple of fps = {fps}, at most {highest}"
            )
        return cls(fps, rate, recorded)

    @property
    def samples(self) -> int:
        """Number of samples in a frame."""
        return round(self.rate / self.fps)

    @property
    def look_ahead(self) -> float:
        """Time by which the resampling's filter reaches beyond a sample, s."""
        return sampling.look_ahead(self.recorded, self.rate)

    def description(self, axes: Axes) -> dict[str, Any]:
        """Return a description of the windows for readers of the dataset, for JSON."""
        return {
            "vibration_schema": SCHEMA,
            "axes": list(axes.names),
            "rate_hz": self.rate,
            "recorded_rate_hz": self.recorded,
            "resampling_delay_s": 0.0,
            "resampling_look_ahead_s": self.look_ahead,
            "window": "from the frame before until this one",
        }


@dataclass(frozen=True)
class Frames:
    """Frames of a period.

    Attributes
    ----------
    times : ndarray of int64, shape (n,)
        Times of the frames, ns; each has the states at that time.
    state, action : ndarray of float32, shape (n, 6)
        Position, m, and velocity, m/s, of slave and master.
    tool, handle : ndarray of float32, shape (n, samples, axes)
        Acceleration from the previous frame to this one, m/s^2.
    valid : ndarray of bool, shape (n,)
        True if a sample of the tool was recorded in the window.
    notes : list of str
        Reports of missing samples, one line for each signal.
    """

    times: sampling.IntArray
    state: SingleArray
    action: SingleArray
    tool: SingleArray
    handle: SingleArray
    valid: sampling.BoolArray
    notes: list[str]


def engagements(bag: Bag) -> list[tuple[int, int]]:
    """Return start and end of each period in which the arms were coupled, ns.

    Raises
    ------
    ParameterError
        The arms were never coupled.
    """
    found = bag.coupled(topics.MASTER) or bag.coupled(topics.SLAVE)
    if not found:
        raise ParameterError(
            f"{bag.path}: the arms were never coupled: this format needs them; parquet, csv and"
            " wav do not"
        )
    return found


def episodes(bag: Bag, held: Sequence[Any]) -> Iterator[tuple[int, int, Any]]:
    """Yield start and end, ns, and condition of each part of an engagement with one condition.

    Parameters
    ----------
    bag : Bag
    held : sequence of dict
        Result of `conditions` for the bag.

    Raises
    ------
    ParameterError
        As for `engagements`.
    """
    begins = [each["begin_ns"] for each in held]
    for begin, end in engagements(bag):
        borders = [begin, *(each for each in begins if begin < each < end), end]
        for pair in itertools.pairwise(borders):
            yield *pair, held[int(np.searchsorted(begins, pair[0], side="right")) - 1]


def frames_of(bag: Bag, begin: int, end: int, rate: FrameRate) -> Frames:
    """Return the frames of a period; the first is one frame after its start.

    Parameters
    ----------
    bag : Bag
    begin, end : int
        Period, ns.
    rate : FrameRate

    Raises
    ------
    ParameterError
        A signal is missing, or has hardly any samples in the period.
    """
    count = int((end - begin) * rate.fps / NANOSECONDS)
    if count > sampling.SPARSE * (samples := len(signal_of(bag, TOOL).stamps)):
        raise ParameterError(f"{bag.path}: {samples} samples for {count} frames: {CLOCKS}")
    times = begin + np.round(np.arange(1, count + 1) * (NANOSECONDS / rate.fps)).astype(np.int64)
    notes: list[str] = []
    state, action = (
        np.hstack([_latest(bag, each, times, rate.fps, notes) for each in part])
        for part in (STATE, ACTION)
    )
    tool, handle = (_windows(bag, each, begin, count, rate, notes) for each in (TOOL, HANDLE))
    stamps = finite(signal_of(bag, TOOL)).stamps
    valid = np.diff(np.searchsorted(stamps, [begin, *times])) > 0
    return Frames(times, state, action, tool, handle, valid, notes)


def _latest(
    bag: Bag, exported: ExportedSignal, times: sampling.IntArray, fps: int, notes: list[str]
) -> SingleArray:
    """Return the last vector of a signal at or before some times, shape (n, 3)."""
    signal = finite(signal_of(bag, exported))
    if not len(signal.stamps):
        raise ParameterError(f"{bag.path}: {exported.name}: has no finite sample")
    found = np.searchsorted(signal.stamps, times, side="right") - 1
    age = times - signal.stamps[np.maximum(found, 0)]
    held = (found < 0) | (age * fps > NANOSECONDS)
    _note(bag, exported, int(held.sum()), len(times), "frames have an older state", notes)
    return signal.values[np.maximum(found, 0)].astype(np.float32)


def _windows(
    bag: Bag, exported: ExportedSignal, begin: int, count: int, rate: FrameRate, notes: list[str]
) -> SingleArray:
    """Return the windows of a signal, shape (n, samples, axes)."""
    start = begin - SETTLING * NANOSECONDS
    length = int((count / rate.fps + 2 * SETTLING) * rate.recorded) + 1
    inside = slice(round(SETTLING * rate.recorded), round((count / rate.fps + 1) * rate.recorded))
    first, size = round(SETTLING * rate.rate), count * rate.samples
    held, seen = on_grid(bag, exported, start, rate.recorded, length)
    lost = int((~seen[inside]).sum())
    _note(bag, exported, lost, len(seen[inside]), "samples repeat the one before", notes)
    whole = sampling.resampled(held, rate.recorded, rate.rate)[first : first + size]
    return whole.astype(np.float32).reshape(count, rate.samples, -1)


def _note(
    bag: Bag, exported: ExportedSignal, held: int, count: int, text: str, notes: list[str]
) -> None:
    if held > MOST_HELD * count:
        raise ParameterError(
            f"{bag.path}: {exported.name}: {held} of {count} {text} while the arms were coupled;"
            f" {CLOCKS}"
        )
    if held:
        notes.append(f"{exported.name}: {held} of {count} {text}")


def recorded_rate(bag: Bag) -> float:
    """Return the common sampling rate of tool and handle, Hz.

    Raises
    ------
    ParameterError
        Tool and handle have no common rate.
    """
    tool, handle = (rate_of(bag, each) for each in (TOOL, HANDLE))
    if tool != handle:
        raise ParameterError(
            f"{bag.path}: tool and handle have {tool:g} and {handle:g} Hz: must have one rate"
        )
    return tool

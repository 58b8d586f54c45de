# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of a learning dataset: states of both arms, and vibration since the last frame.

Each frame has a window of the acceleration of tool and handle, so that no sample is lost although
datasets have 10 to 60 frames per second. Windows have no gap or overlap: joined together they are
the signal.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from haptic_accel import Axes, Bag, ParameterError
from haptic_accel.core import sampling, topics
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, IntArray
from haptic_accel.kits.export import signals
from haptic_accel.kits.export.signals import HANDLE, TOOL, ExportedSignal, finite, signal_of

SingleArray: TypeAlias = npt.NDArray[np.float32]

STATE = (signals.SLAVE_POSITION, signals.SLAVE_VELOCITY)
ACTION = (signals.MASTER_POSITION, signals.MASTER_VELOCITY)
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
            "vibration_schema": signals.SCHEMA,
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

    times: IntArray
    state: SingleArray
    action: SingleArray
    tool: SingleArray
    handle: SingleArray
    valid: BoolArray
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
        Result of `signals.conditions` for the bag.

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
    bag: Bag, exported: ExportedSignal, times: IntArray, fps: int, notes: list[str]
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
    held, seen = signals.on_grid(bag, exported, start, rate.recorded, length)
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
    tool, handle = (signals.rate_of(bag, each) for each in (TOOL, HANDLE))
    if tool != handle:
        raise ParameterError(
            f"{bag.path}: tool and handle have {tool:g} and {handle:g} Hz: must have one rate"
        )
    return tool

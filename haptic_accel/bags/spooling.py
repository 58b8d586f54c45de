# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reader for bags of any length, whose signals are on disk instead of in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path

import numpy as np

from haptic_accel.bags.mcap import DAMAGE_ERRORS
from haptic_accel.bags.metadata import MetadataError, read_metadata
from haptic_accel.bags.reading import MOST_MESSAGES, Bag, Signal, news, read_bags, read_parts
from haptic_accel.bags.timeline import MOST_DRIFT, grid_steps
from haptic_accel.bags.trial_metadata import PARAMETERS
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, IntArray, sampling_rate


class _DisorderError(Exception):
    """Error: the order of samples can only be determined from the complete bag."""


class _Column:
    """Signal that grows on disk."""

    def __init__(self, folder: Path, name: str) -> None:
        base = folder / name.replace("/", "-")
        self._files = [base.with_suffix(end) for end in (".stamps", ".values")]
        self._open = [file.open("wb") for file in self._files]
        self._last: int | None = None

    def add(self, signal: Signal) -> None:
        """Append samples; refuse samples that are not later than the present ones."""
        if self._last is not None and signal.stamps[0] <= self._last:
            raise _DisorderError
        for file, array in zip(self._open, (signal.stamps, signal.values), strict=True):
            file.write(np.ascontiguousarray(array).data)
        self._last = int(signal.stamps[-1])

    def close(self) -> Signal:
        """Return the signal, mapped from the disk."""
        for file in self._open:
            file.close()
        stamps, values = self._files
        return Signal(
            np.memmap(stamps, np.int64, "r"),
            np.array([], np.int64),
            np.memmap(values, np.float64, "r").reshape(-1, 3),
        )


def spooled_bags(
    path: Path,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
    most: int = MOST_MESSAGES,
) -> list[Bag]:
    """Read the recordings of a bag, whose signals are mapped from files in a folder.

    The recordings are those of `read_bags`, without recording times and diagnostics. A bag in
    order of time is read in parts; any other bag needs as much memory as with `read_bags`.

    Parameters
    ----------
    path : Path
        Folder of a bag, or one of its files.
    folder : Path
        Empty folder for the signals' files, which must exist as long as the signals.
    progress : callable
        Callback with the share of the messages read so far, from 0 to 1.
    most : int
        Number of messages in memory at a time.

    Raises
    ------
    ParameterError
        The path is no bag, or the bag is unreadable.
    OSError
        The folder cannot be written.
    """
    parts = _in_order(read_parts(path, most))
    try:
        return [_spooled(Bag(path), _tracked(parts, _messages(path), progress), folder, "")]
    except (_DisorderError, *DAMAGE_ERRORS):  # read_bags corrects these if possible
        whole = enumerate(read_bags(path))
        return [_spooled(each, iter([each]), folder, f"{n}-") for n, each in whole]


def _messages(path: Path) -> int:
    """Return the number of messages that a bag states; 0 if it states none."""
    with suppress(MetadataError, OSError):
        return read_metadata(path).messages
    return 0


def _tracked(
    parts: Iterator[Bag], messages: int, progress: Callable[[float], None]
) -> Iterator[Bag]:
    done = 0
    for part in parts:
        yield part
        done += part.counts.total()
        progress(min(1.0, done / max(1, messages)))
    if messages and done != messages:  # reading the whole bag reports this
        raise _DisorderError


def _spooled(bag: Bag, parts: Iterator[Bag], folder: Path, prefix: str) -> Bag:
    """Return a bag with the signals of its parts, in files whose names have a prefix."""
    columns: dict[str, _Column] = {}
    for part in parts:
        for name, signal in part.signals.items():
            if name not in columns:
                columns[name] = _Column(folder, prefix + name)
            columns[name].add(signal)
        if part is not bag:
            bag.counts.update(part.counts)
            bag.metadata.update(part.metadata | bag.metadata)
            bag.changes[:] = news([*bag.changes, *part.changes])
    bag.signals.update({name: column.close() for name, column in columns.items()})
    return bag


def _in_order(parts: Iterator[Bag]) -> Iterator[Bag]:
    """Yield parts while they are undamaged, from one recording, and on one clock."""
    first = next(parts)
    stated = {name: first.metadata.get(name) for name in ("arguments", PARAMETERS)}
    name, period, drift, last = "", 0.0, 0.0, np.array([], np.int64)
    for part in chain([first], parts):
        if part.problems or any(part.metadata.get(n, v) != v for n, v in stated.items() if v):
            raise _DisorderError
        if not period:
            name, period = _grid(part)
        if name in part.signals:
            stamps: IntArray = np.append(last, part.signals[name].stamps)
            steps, whole = grid_steps(stamps, period)
            drifts = np.append(drift, drift + np.cumsum(steps - whole))
            if np.abs(drifts).max() > MOST_DRIFT:
                raise _DisorderError
            drift, last = float(drifts[-1]), stamps[-1:]
        yield part


def _grid(part: Bag) -> tuple[str, float]:
    """Return a part's longest signal and its sampling period, ns; 0 without a sampling grid."""
    name = max(part.signals, key=lambda each: len(part.signals[each].stamps), default="")
    with suppress(ParameterError, KeyError):
        return name, NANOSECONDS / sampling_rate(part.signals[name].stamps, part.stated_rate)
    return "", 0.0

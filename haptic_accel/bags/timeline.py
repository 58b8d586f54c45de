# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Order and times of a bag's samples, if messages are out of order or the clock was set.

Samples are ordered by stamp, independent of the messages' positions in a file. If different
samples have the same stamps, or stamps go back across a gap, the clock was set back; the order of
arrival then applies.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, RELEASED, BoolArray, IntArray, sampling_rate

FAR = 1.0
"""Distance of a stamp from all other stamps above which it may be a stray, s."""

STRAY_SHARE = 100
"""Minimum ratio of the number of messages to the number of strays in a group."""

MOST_STEPS = 20
"""Maximum number of clock steps that are corrected in one bag."""

SHUFFLED = 0.1
"""Share of messages with an earlier stamp than the previous message, above which only stamps
determine the order."""

CROWDED = 1.5
"""Span of three successive samples, in periods, below which stamps repeat earlier times; normally
2."""

CLEAN = 0.1
"""Maximum distance of a step between stamps from whole periods, in periods, on a clean grid."""

CLEAN_SHARE = 0.99
"""Minimum share of clean steps for which samples are counted instead of timed."""

MOST_DRIFT = 0.5
"""Maximum distance of a clock from the number of its samples, in periods."""

_RELEASED = round(RELEASED * NANOSECONDS)


@dataclass(frozen=True)
class Arrivals:
    """Messages of one topic.

    Attributes
    ----------
    stamps : ndarray of int64, shape (n,)
        Times of the samples, ns.
    offsets : ndarray of int64, shape (n,)
        Positions of the messages in the order of arrival; unique in the bag.
    marks : ndarray of int64, shape (n,)
        Hashes of the samples.
    """

    stamps: IntArray
    offsets: IntArray
    marks: IntArray

    def __getitem__(self, chosen: IntArray | BoolArray | slice) -> Arrivals:
        """Return some of the messages."""
        return Arrivals(self.stamps[chosen], self.offsets[chosen], self.marks[chosen])


@dataclass(frozen=True)
class _Step:
    """Step of the clock: offset of the first message after it, and size, ns."""

    offset: int
    by: int


@dataclass
class Timeline:
    """Times of a bag's messages on one monotonic clock.

    Attributes
    ----------
    chosen : dict of ndarray
        Indices of each topic's messages in order of time, without omitted messages.
    stamps : dict of ndarray
        Stamps of the chosen messages, ns.
    notes : list of str
        Contradictions in the bag, and their resolution, one line each.
    """

    chosen: dict[str, IntArray] = field(default_factory=dict)
    stamps: dict[str, IntArray] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    _offsets: list[int] = field(default_factory=list)
    _shifts: list[int] = field(default_factory=lambda: [0])
    _clocks: tuple[IntArray, IntArray] | None = None

    def moved(self, times: IntArray, offsets: IntArray) -> IntArray:
        """Convert times of the bag's clock, with offsets of arrival, to this timeline, ns."""
        parts = np.searchsorted(self._offsets, offsets, side="right")
        return self._steady(times + np.array(self._shifts, np.int64)[parts])

    def _steady(self, times: IntArray) -> IntArray:
        """Convert times to a clock with a constant rate."""
        if self._clocks is None:
            return times
        own, steady = self._clocks
        near = np.clip(np.searchsorted(own, times, side="right") - 1, 0, len(own) - 1)
        return steady[near] + times - own[near]


def timeline(topics: Mapping[str, Arrivals], rate: float | None = None) -> Timeline:
    """Find order and times of the samples in a bag.

    Parameters
    ----------
    topics : mapping of Arrivals
        Sampled topics by name.
    rate : float, optional
        Sampling rate stated in the bag, Hz.
    """
    found = Timeline()
    by_arrival = {name: np.argsort(topic.offsets, kind="stable") for name, topic in topics.items()}
    arrived = {name: topic[by_arrival[name]] for name, topic in topics.items()}
    longest = max(arrived.values(), key=lambda topic: len(topic.stamps), default=None)
    if longest is None:
        return found
    is_shuffled = np.sum(np.diff(longest.stamps) < 0) > SHUFFLED * (len(longest.stamps) - 1)
    period = _period(np.sort(longest.stamps) if is_shuffled else longest.stamps)
    near = 0.0 if is_shuffled else period
    kept = {name: ~strays for name, strays in _strays(arrived, near)}
    _note_strays(arrived, kept, found.notes)
    left = {name: topic[kept[name]] for name, topic in arrived.items()}
    cuts = {
        name: [] if is_shuffled else list(_steps(topic, period)) for name, topic in left.items()
    }
    parts = _parts(left, cuts, found)
    _join(left, parts, cuts, period, found)
    jumps = [np.diff(topic.stamps[parts[name] >= 0]) for name, topic in left.items()]
    if not found._offsets and any((each < -_RELEASED).any() for each in jumps):
        found.notes.append("its messages are not in order of time: their stamps give the order")
    doubled = 0
    for name, topic in left.items():
        stamps = topic.stamps + np.array(found._shifts, np.int64)[parts[name]]
        order = np.argsort(stamps, kind="stable")
        order = order[parts[name][order] >= 0]
        sure, twice, other = _once(topic[order], stamps[order])
        doubled += twice
        if other:
            found.notes.append(
                f"{name}: {other} messages have the stamp of another one with other values: only"
                " the last is used"
            )
        order = order[sure]
        found.stamps[name] = stamps[order]
        found.chosen[name] = by_arrival[name][np.flatnonzero(kept[name])[order]]
    if doubled:
        found.notes.append(f"{doubled} messages are there twice, and count once")
    _steadied(found, rate)
    return found


def _period(stamps: IntArray) -> float:
    """Return the typical distance between stamps in order of arrival, ns."""
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 1.0


def _strays(arrived: Mapping[str, Arrivals], period: float) -> Iterator[tuple[str, BoolArray]]:
    """Yield each topic with a mask of the messages whose stamps are far from all others.

    Strays are few and at times without samples of other topics, or single between neighbours. The
    period, in ns, is 0 if neighbours are not to be compared.
    """
    every = np.sort(np.concatenate([topic.stamps for topic in arrived.values()]), kind="stable")
    groups = np.flatnonzero(np.diff(every) > FAR * NANOSECONDS) + 1
    sizes = np.diff(np.concatenate([[0], groups, [len(every)]]))
    is_stray = sizes * STRAY_SHARE < len(every)
    for name, topic in arrived.items():
        group = np.searchsorted(every[groups], topic.stamps, side="right")
        strays = is_stray[group]
        if period and len(topic.stamps) > 2:
            before, at, after = topic.stamps[:-2], topic.stamps[1:-1], topic.stamps[2:]
            is_near = np.abs(after - before - 2 * period) <= period
            strays[1:-1] |= is_near & (np.abs(at - before) > _RELEASED)
            strays[0] |= before[0] - at[0] > _RELEASED
            strays[-1] |= at[-1] - after[-1] > _RELEASED
        yield name, strays


def _note_strays(
    arrived: Mapping[str, Arrivals], kept: Mapping[str, BoolArray], notes: list[str]
) -> None:
    for name, topic in arrived.items():
        if len(strays := topic.stamps[~kept[name]]):
            notes.append(
                f"{name}: {len(strays)} of {len(topic.stamps)} messages are left out: stamps far"
                f" from all others, such as {strays[0] / NANOSECONDS:.3f} s"
            )


def _steps(topic: Arrivals, period: float) -> Iterator[_Step]:
    """Yield the offsets from which a topic's stamps repeat earlier times."""
    begin = 0
    for _ in range(MOST_STEPS):
        rest = topic[slice(begin, None)]
        jumps = np.diff(rest.stamps)
        latest = _contradiction(rest, period)
        if latest is None:
            back = np.flatnonzero(jumps < -_RELEASED)
            if not len(back):
                return
            gaps = np.sum(np.diff(np.sort(rest.stamps)) > _RELEASED)
            # Reordered chunks leave no gap in order of time.
            if gaps > np.sum(jumps > _RELEASED):
                ends = back[:MOST_STEPS]
                for offset, by in zip(rest.offsets[ends + 1], jumps[ends], strict=True):
                    yield _Step(int(offset), round(by - period))
            return
        at = int(np.argmin(jumps[:latest]))
        yield _Step(int(rest.offsets[at + 1]), round(jumps[at] - period))
        begin += at + 1


def _contradiction(topic: Arrivals, period: float) -> int | None:
    """Return the index of the first message at a time that belongs to another sample."""
    if len(topic.stamps) < 3 or bool((np.diff(topic.stamps) > 0).all()):
        return None
    order = np.argsort(topic.stamps, kind="stable")
    stamps, marks = topic.stamps[order], topic.marks[order]
    is_same = stamps[1:] == stamps[:-1]
    differs = is_same & (marks[1:] != marks[:-1])
    found = [np.maximum(order[1:], order[:-1])[differs]]
    alone = np.concatenate([[True], ~is_same])
    stamps, order = stamps[alone], order[alone]
    crowded = stamps[2:] - stamps[:-2] < CROWDED * period
    mixed = (order[2:] < order[1:-1]) | (order[1:-1] < order[:-2])
    found.append(np.max([order[2:], order[1:-1], order[:-2]], axis=0)[crowded & mixed])
    latest = np.concatenate(found)
    return int(latest.min()) if len(latest) else None


def _parts(
    left: Mapping[str, Arrivals], cuts: dict[str, list[_Step]], found: Timeline
) -> dict[str, IntArray]:
    """Return the number of clock steps before each topic's messages; -1 for omitted messages.

    A step of the clock appears in all of its topics. Steps in a single topic are faults of that
    topic.
    """
    usual = Counter(len(steps) for steps in cuts.values() if steps).most_common(1)
    number = usual[0][0] if usual and usual[0][1] * 2 > len(cuts) else 0
    common = next((cuts[name] for name in cuts if number and len(cuts[name]) == number), [])
    found._offsets = [step.offset for step in common]
    parts = {}
    for name, topic in left.items():
        own = cuts[name]
        matched = [
            min(
                (step for step in own if abs(step.by - each.by) <= _RELEASED),
                key=lambda step, offset=each.offset: abs(step.offset - offset),  # type: ignore[misc]
                default=each,
            )
            for each in common
        ]
        borders = [step.offset for step in matched]
        parts[name] = np.searchsorted(borders, topic.offsets, side="right")
        # The receiving clock was set before the first message of any topic with the new time.
        found._offsets = [min(pair) for pair in zip(found._offsets, borders, strict=True)]
        cuts[name] = matched if all(step in own for step in matched) else []
        # A repeated or overtaken message is not a clock step.
        faults = [step for step in own if step not in matched and step.by < -_RELEASED]
        if faults:
            late = topic.offsets >= faults[0].offset
            parts[name][late] = -1
            cuts[name] = []
            found.notes.append(
                f"{name}: its stamps go back by {-faults[0].by / NANOSECONDS:.3g} s, unlike those"
                f" of other topics: {int(late.sum())} messages from there are left out"
            )
    return parts


def _join(
    left: Mapping[str, Arrivals],
    parts: Mapping[str, IntArray],
    cuts: Mapping[str, list[_Step]],
    period: float,
    found: Timeline,
) -> None:
    """Shift the samples after each step to one period after the samples before it."""
    names = [name for name, steps in cuts.items() if len(steps) == len(found._offsets)]
    for number in range(1, len(found._offsets) + 1):
        before = [left[name].stamps[parts[name] == number - 1] for name in names]
        after = [left[name].stamps[parts[name] == number] for name in names]
        end = max(int(stamps.max()) for stamps in before if len(stamps)) + found._shifts[-1]
        shift = round(end + period) - min(int(s.min()) for s in after if len(s))
        by = (shift - found._shifts[-1]) / NANOSECONDS
        begin = min(int(topic.stamps[0]) for topic in left.values() if len(topic.stamps))
        found._shifts.append(shift)
        found.notes.append(
            f"its clock was set back by {by:.4g} s at {(end - begin) / NANOSECONDS:.1f} s: samples"
            " are used in order of arrival, and follow each other there by one period"
        )


def _once(topic: Arrivals, stamps: IntArray) -> tuple[BoolArray, int, int]:
    """Return a mask of the last message per stamp, and numbers of copies and contradictions."""
    sure = np.concatenate([np.diff(stamps) > 0, [True]])[: len(stamps)]
    lasts = np.flatnonzero(sure)
    last = lasts[np.searchsorted(lasts, np.arange(len(stamps)))]
    is_copy = ~sure & (topic.marks == topic.marks[last])
    return sure, int(is_copy.sum()), int((~sure & ~is_copy).sum())


def grid_steps(stamps: IntArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Return the steps between stamps in periods: exact, and rounded to at least 1."""
    steps = np.diff(stamps) / period
    return steps, np.maximum(1.0, np.rint(steps))


def _steadied(found: Timeline, rate: float | None) -> None:
    """Count samples instead of timing them, if the clock was slewed."""
    stamps = max(found.stamps.values(), key=len)
    try:
        period = NANOSECONDS / sampling_rate(stamps, rate)
    except ParameterError:  # no sampling grid; the analysis reports this
        return
    steps, whole = grid_steps(stamps, period)
    is_clean = np.abs(steps - whole) <= CLEAN
    indices = np.concatenate([[0.0], np.cumsum(whole)])
    if np.mean(is_clean) < CLEAN_SHARE:
        return
    # A sender that ends sends zero at once, off the grid; this is not drift.
    end = np.flatnonzero(is_clean)[-1] + 2
    drift = ((stamps - stamps[0]) / period - indices)[:end]
    if np.abs(drift).max() <= MOST_DRIFT:
        return
    steady = stamps[0] + np.round(indices * period).astype(np.int64)
    found._clocks = stamps, steady
    found.stamps = {name: found._steady(own) for name, own in found.stamps.items()}
    found.notes.append(
        f"its clock ran at another rate than its samples, up to {np.abs(drift).max():.1f} samples"
        " apart: samples are counted by their order"
    )


def continuous(order: Iterable[tuple[int, int]]) -> int:
    """Return the number of files that do not start where the previous file ended.

    Parameters
    ----------
    order : iterable of tuple of int
        First and last stamp of each file in order of arrival, ns.
    """
    spans = list(order)
    return sum(abs(begin - end) > _RELEASED for (_, end), (begin, _) in itertools.pairwise(spans))

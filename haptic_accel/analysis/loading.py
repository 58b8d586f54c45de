# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Analysis of all trials in some bags, one bag after the other, and of the two bags of two hosts.

The handle of a bag is compared with the tool of a robot recorded by another host: the bags of both
hosts of a run use the operator's time axis. The operator's coupler measured the offset of the
robot's clock.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from haptic_accel.analysis.description import OPERATOR, ROBOT, surface_of
from haptic_accel.analysis.metrics import MILLI, PERCENT, AnalysedTrial, Shift, measure
from haptic_accel.analysis.segments import VECTORS, Segment, cut, read_segment
from haptic_accel.bags.folder import find_bags
from haptic_accel.bags.reading import Bag, Signal, read_bag, read_bags
from haptic_accel.core import topics
from haptic_accel.core.axes import Axes
from haptic_accel.core.control.filters import comparable, high_passed
from haptic_accel.core.evaluation.metrics import by_component, estimate_delay, shift_back
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import shortage
from haptic_accel.core.sampling import NANOSECONDS, grid_indices, sampling_rate
from haptic_accel.core.simulated_rig import RigParameters

OFFSET, BOUND = "clock offset (ms)", "clock offset bound (ms)"
"""Values reported by the coupler: the peer's clock minus the local one, and its maximum error."""

FEWEST_REPORTS = 10
"""Minimum number of reports for estimating the drift between the clocks; with fewer, errors of
reports would appear as drift."""

LONGEST_DELAY = 2.0
"""Maximum delay from the robot's tool to the handle in the search, s. A usable network has less
than 0.5 s; the clock error adds up to its bound."""

STRETCH = 2 * LONGEST_DELAY
"""Length of the sections of a trial that are searched for a delay, s."""

PIECE = 0.5
"""Length of the pieces of a trial, s, each compared at its own delay. Playout changes its delay by
1 ms/s, and 0.5 ms is a tenth of a period at 200 Hz, a frequency of textures."""


@dataclass(frozen=True)
class Clock:
    """Offset of the peer's clock from the local one.

    Attributes
    ----------
    origin : int
        Local time at which the peer's clock is ahead by `offset`, ns.
    offset, bound : float
        Offset and its maximum error, s.
    drift : float
        Change of the offset, s/s.
    """

    origin: int
    offset: float
    drift: float
    bound: float

    def peer(self, own: int) -> int:
        """Return the peer's time for a local time, ns."""
        ahead = self.offset + self.drift * (own - self.origin) / NANOSECONDS
        return own + round(ahead * NANOSECONDS)


@dataclass(frozen=True)
class Host:
    """Recording of a run by one of two hosts.

    Attributes
    ----------
    bag : Path
    side, namespace : str
        Arguments of the graph.
    surface : str
        Surface at the robot, from the bag.
    span : tuple of int
        First and last stamp of the tool's acceleration, local time, ns.
    clock : Clock or None
        Clock of the peer, if reported by the coupler.
    """

    bag: Path
    side: str
    namespace: str
    surface: str
    span: tuple[int, int]
    clock: Clock | None


@dataclass(frozen=True)
class Across:
    """Comparison of a handle with the robot's own tool.

    Attributes
    ----------
    trial : str
        Name of the operator's trial.
    robot : str
        Bag of the robot.
    nrmse_percent : float
        RMS of the difference, relative to the RMS of the desired acceleration from the robot's
        tool, with each piece of the trial at its own delay.
    played_percent : float
        NRMSE relative to the acceleration played out on the operator's host.
    delay_ms : float
        Median over the pieces of the delay from the tool's acceleration to the handle's.
    delay_low_ms, delay_high_ms : float
        Quantiles of 1 and 99 % of this delay.
    bound_ms : float
        Maximum error of these delays due to the clocks.
    """

    trial: str
    robot: str
    nrmse_percent: float
    played_percent: float
    delay_ms: float
    delay_low_ms: float
    delay_high_ms: float
    bound_ms: float

    @property
    def sentence(self) -> str:
        """Description of the comparison."""
        return (
            f"{self.trial}: the handle follows the robot's own tool after {self.delay_ms:.1f} ms"
            f" ({self.delay_low_ms:.1f} to {self.delay_high_ms:.1f} ms; the clocks are known to"
            f" {self.bound_ms:.2g} ms) with an error of {self.nrmse_percent:.1f} %; that against"
            f" what was played out is {self.played_percent:.1f} %."
        )


def host_of(recorded: Bag) -> Host | None:
    """Return a bag's metadata on two hosts; None for a graph on one host or without a tool."""
    arguments = recorded.metadata.get("arguments")
    tool = recorded.signals.get(topics.TOOL_ACCELERATION.name)
    if not isinstance(arguments, dict) or tool is None:
        return None
    side = arguments.get("side")
    if side not in (OPERATOR, ROBOT):
        return None
    span = int(tool.stamps.min()), int(tool.stamps.max())
    namespace = str(arguments.get("namespace", "")).strip("/")
    return Host(recorded.path, side, namespace, surface_of(recorded), span, _clock(recorded))


def _clock(recorded: Bag) -> Clock | None:
    """Return the peer's clock as a line through the coupler's reports."""
    reports = [
        (report.received, *found)
        for report in recorded.diagnostics
        if report.node == "coupler"
        and all(map(math.isfinite, found := [_number(report.values, n) for n in (OFFSET, BOUND)]))
    ]
    if not reports:
        return None
    times, offsets, bounds = map(np.array, zip(*reports, strict=True))
    origin = int(times[0])
    seconds = (times - origin) / NANOSECONDS
    drift, offset = 0.0, float(np.median(offsets))
    if len(reports) >= FEWEST_REPORTS:
        drift, offset = np.polyfit(seconds, offsets, 1, w=1 / np.maximum(bounds, 1e-6))
    return Clock(origin, offset / 1e3, drift / 1e3, float(np.median(bounds)) / 1e3)


def _number(values: dict[str, str], name: str) -> float:
    try:
        return float(values.get(name, "nan"))
    except ValueError:
        return math.nan


def pairs(hosts: Sequence[Host]) -> Iterator[tuple[Host, Host]]:
    """Yield each operator's bag with the robot's bag of the same run, if it exists.

    Two bags belong to one run if their graphs have the same namespace, and they overlap in time on
    the operator's clock. Among several robots, the longest overlap counts.
    """
    for operator in hosts:
        if operator.side != OPERATOR or operator.clock is None:
            continue
        robots = [
            (overlap, number)
            for number, robot in enumerate(hosts)
            if robot.side == ROBOT and robot.namespace == operator.namespace
            if (overlap := _overlap(operator, robot)) > 0
        ]
        if robots:
            yield operator, hosts[max(robots)[1]]


def _overlap(operator: Host, robot: Host) -> int:
    """Return the overlap of two bags, ns; not positive without one."""
    assert operator.clock
    begin, end = map(operator.clock.peer, operator.span)
    return min(end, robot.span[1]) - max(begin, robot.span[0])


def compare_across(task: tuple[AnalysedTrial, Host, Host]) -> Across | str:
    """Compare the handle of an operator's trial with the robot's tool.

    Parameters
    ----------
    task : tuple
        Trial, and the bags of operator and robot.

    Returns
    -------
    Across or str
        Comparison, or one line on why it is impossible.
    """
    trial, operator, robot = task
    assert operator.clock
    segment = read_segment(operator.bag, trial.segment.number)
    handle = segment.signals.get(topics.HANDLE_ACCELERATION.name)
    tool = read_bag(robot.bag, VECTORS).signals[topics.TOOL_ACCELERATION.name]
    try:
        if handle is None:
            raise ParameterError(f"has no {topics.HANDLE_ACCELERATION.name}")
        rate = sampling_rate(tool.stamps, segment.rate)
        if rate != segment.rate:
            raise ParameterError(f"{robot.bag} has {rate:.5g} samples per second")
        passed = partial(high_passed, corner=segment.high_pass_frequency, rate=rate)
        desired = by_component(passed, _tool(tool, rate, segment.axes))
        desired, handle = comparable(desired, handle, segment.high_pass_frequency, rate)
        # Position of the trial's first sample among the robot's, and the change per sample.
        position = (operator.clock.peer(segment.start) - robot.span[0]) * rate / NANOSECONDS
        begin = math.floor(position)
        own = slice(max(0, -begin), min(len(handle), len(desired) - begin))
        error, delays = _pieces(desired[own.start + begin : own.stop + begin], handle[own], rate)
        middles = own.start + (np.arange(len(delays)) + 0.5) * PIECE * rate
        delays += (position - begin + operator.clock.drift * middles) / rate
    except (ParameterError, ValueError) as reason:
        return f"cannot be compared with {robot.bag}: {reason}"
    low, middle, high = np.quantile(delays, (0.01, 0.5, 0.99)) * 1e3
    return Across(
        trial.name,
        str(robot.bag),
        PERCENT * error,
        trial.metrics["nrmse_percent"],
        middle,
        low,
        high,
        operator.clock.bound * 1e3,
    )


def _tool(tool: Signal, rate: float, axes: Axes) -> FloatArray:
    """Return the robot's samples along the handle's axes, from its first one on."""
    start = int(tool.stamps.min())
    length = int(grid_indices(tool.stamps.max(keepdims=True), start, rate)[0]) + 1
    return tool.on_grid(start, rate, length, axes)[0]


def _usual_delay(desired: FloatArray, actual: FloatArray, rate: float) -> float:
    """Return a delay near those of all pieces, s.

    If the delay changes too much within the trial, the section with the most distinct delay
    determines the result.

    Raises
    ------
    ValueError
        `actual` does not follow `desired`.
    """
    length = round(STRETCH * rate)
    stretches = [slice(begin, begin + length) for begin in range(0, len(desired), length)]
    found = estimate_delay(desired, actual, rate, LONGEST_DELAY)
    if math.isnan(found.seconds):
        tried = [
            estimate_delay(desired[each], actual[each], rate, LONGEST_DELAY) for each in stretches
        ]
        found = max(tried, key=lambda each: each.correlation, default=found)
    if math.isnan(found.seconds):
        raise ValueError("no delay was found")
    return found.seconds


def _pieces(desired: FloatArray, actual: FloatArray, rate: float) -> tuple[float, FloatArray]:
    """Return the relative RMS error over all pieces, each at its own delay, and the delays, s.

    Raises
    ------
    ValueError
        The signals are too short, or `actual` does not follow `desired`.
    """
    samples = round(PIECE * rate)
    base = round(_usual_delay(desired, actual, rate) * rate) / rate
    desired, actual = shift_back(desired, actual, rate, base)
    delays: list[float] = []
    errors, powers = 0.0, 0.0
    for begin in range(0, len(desired) - samples + 1, samples):
        piece = slice(begin, begin + samples)
        delay = estimate_delay(desired[piece], actual[piece], rate).seconds
        if math.isnan(delay):  # without contact
            delay = delays[-1] - base if delays else 0.0
        first, second = shift_back(desired[piece], actual[piece], rate, delay)
        errors += float(np.sum((first - second) ** 2))
        powers += float(np.sum(first**2))
        delays.append(base + delay)
    if not powers > 0.0:
        raise ValueError("they overlap for less than a second")
    return math.sqrt(errors / powers), np.array(delays)


@dataclass(frozen=True)
class Analysis:
    """Result of analysing bags.

    Attributes
    ----------
    trials : list of AnalysedTrial
    problems : dict
        Messages about quantities that could not be determined, by bag.
    shift : Shift
    bags : int
        Number of bags.
    across : list of Across
        Comparisons of handles with tools recorded by other hosts.
    failed : int
        Number of bags that could not be read or measured.
    """

    trials: list[AnalysedTrial]
    problems: dict[str, list[str]]
    shift: Shift
    bags: int
    across: list[Across] = field(default_factory=list)
    failed: int = 0

    @property
    def shifted_by(self) -> str:
        """Description of the time by which actual accelerations were shifted back."""
        return self.shift.text(trial.segment for trial in self.trials)


Spread = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Function that applies another function to each item, like `map`; may end early."""

Ended = Callable[[int, int, str, Sequence[AnalysedTrial]], None]
"""Callback with number and count of bags, and name and trials of the bag just analysed."""


def analyse(
    paths: Sequence[Path],
    shift: Shift | None = None,
    *,
    rig: RigParameters | None = None,
    rate: float | None = None,
    apart: bool = False,
    spread: Spread = map,
    ended: Ended | None = None,
) -> Analysis:
    """Read all bags at some paths and measure all their trials.

    An unreadable bag is reported as a problem, and does not affect the others. If trials of one
    condition have the same samples up to rounding (copies, or repeated lockstep runs, also on
    another processor), only the first counts.

    Parameters
    ----------
    paths : sequence of Path
        Bags, files of bags, or folders to search for bags.
    shift : Shift, optional
        Default: each trial's latency and granted delay.
    rig, rate
        Values for bags without metadata; see `cut`.
    apart : bool
        True if the paths are runs to be compared: the same trial counts once in each.
    spread : callable
        Function that applies the analysis to each bag: `map`, or one with several processes.
    ended : callable, optional
        Callback after each bag.

    Raises
    ------
    ParameterError
        A path does not exist or has no bag, or a bag already states the specified rig or rate.
    """
    shift = shift or Shift()
    found = {bag.resolve(): (bag, path) for path in paths for bag in find_bags(path)}
    names = _names([bag for bag, _ in found.values()])
    tasks = [
        _Task(bag, source, name, shift, rig, rate)
        for name, (bag, source) in zip(names, found.values(), strict=True)
    ]
    trials: list[AnalysedTrial] = []
    problems: dict[str, list[str]] = {}
    seen: dict[object, list[tuple[_Sketch, str]]] = {}
    hosts: dict[str, Host] = {}
    done = 0
    failed = 0
    for task, result in zip(tasks, spread(_measured, tasks), strict=False):
        measured, complaints, host, has_failed = result
        failed += has_failed
        kept = []
        hosts |= {task.name: host} if host else {}
        for trial, sketch in measured:
            alike = seen.setdefault((apart and task.source, trial.segment.condition), [])
            first = next((name for other, name in alike if _same(other, sketch)), "")
            if not first:
                alike.append((sketch, trial.name))
                kept.append(trial)
            else:
                # A duplicate counted as another trial would make every interval too short.
                complaints.append(f"counts once: it has the same samples as {first}")
        if complaints:
            problems[task.name] = complaints
        trials += kept
        done += 1
        if ended:
            ended(done, len(tasks), task.name, kept)
    partners = {operator.bag: (operator, robot) for operator, robot in pairs([*hosts.values()])}
    _name_alone(hosts, partners, problems)
    trials = [_touching(trial, partners) for trial in trials]
    across = _across(trials, partners, spread, problems)
    return Analysis(_showing_the_same(trials, spread), problems, shift, done, across, failed)


@dataclass(frozen=True)
class _Task:
    """Bag to be analysed; see `analyse`."""

    bag: Path
    source: Path
    name: str
    shift: Shift
    rig: RigParameters | None
    rate: float | None


class _Measured(NamedTuple):
    """A bag's trials with sketches of their samples, its problems, its host, and its failure."""

    trials: list[tuple[AnalysedTrial, _Sketch]]
    problems: list[str]
    host: Host | None = None
    has_failed: bool = False


def _measured(task: _Task) -> _Measured:
    """Measure a bag's trials.

    A robot's bag has no handle, and thus no trial.
    """
    try:
        recorded, *others = read_bags(task.bag, VECTORS)
    except ParameterError as error:
        return _Measured([], [str(error)], has_failed=True)
    host = host_of(recorded)
    if host and host.side == ROBOT:
        return _Measured([], list(recorded.problems), host)
    measured = []
    try:
        parts = cut(recorded, *others, rig=task.rig, requested=task.rate)
        for segment in parts.segments:
            name = task.name if segment.number == 1 else f"{task.name} #{segment.number}"
            trial = measure(segment, name, task.source, task.shift)
            measured.append((trial, _sketch(segment)))
    except ParameterError:
        raise  # an argument is wrong
    except Exception as error:
        if shortage(error):  # a problem of the machine, not of the bag
            raise
        # Errors in one bag must not prevent the report on the others.
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        lines = [*recorded.problems, f"cannot be analysed: {reason}"]
        return _Measured([], lines, host, has_failed=True)
    return _Measured(measured, list(parts.problems), host)


_Partners = Mapping[Path, tuple[Host, Host]]
"""Operator and robot of a run by the operator's bag."""


def _name_alone(
    hosts: Mapping[str, Host], partners: _Partners, problems: dict[str, list[str]]
) -> None:
    """Add the bags of robots without an operator to the problems."""
    used = {robot.bag for _, robot in partners.values()}
    for name, host in hosts.items():
        if host.side == ROBOT and host.bag not in used:
            problems.setdefault(name, []).append(
                "is of a robot alone: no operator's bag here is of the same run and states the"
                " offset of its clock"
            )


def _touching(trial: AnalysedTrial, partners: _Partners) -> AnalysedTrial:
    """Return a trial with the surface stated in the robot's bag."""
    segment = trial.segment
    if segment.bag not in partners:
        return trial
    surface = partners[segment.bag][1].surface
    condition = replace(segment.condition, surface=surface)
    return replace(trial, segment=replace(segment, condition=condition))


def _across(
    trials: Sequence[AnalysedTrial],
    partners: _Partners,
    spread: Spread,
    problems: dict[str, list[str]],
) -> list[Across]:
    """Compare handles with the tools of robots; add impossible comparisons to the problems."""
    tasks = [(t, *partners[t.segment.bag]) for t in trials if t.segment.bag in partners]
    found = []
    for task, result in zip(tasks, spread(compare_across, tasks), strict=False):
        if isinstance(result, Across):
            found.append(result)
        else:
            problems.setdefault(task[0].name, []).append(result)
    return found


def _showing_the_same(trials: Sequence[AnalysedTrial], spread: Spread) -> list[AnalysedTrial]:
    """Return trials whose excerpts start at the same time for each surface, grip and seed."""
    begins: dict[object, float] = {}
    others: dict[int, tuple[AnalysedTrial, float]] = {}
    for index, trial in enumerate(trials):
        condition = trial.segment.condition
        begin = trial.portrait.begin if trial.portrait else trial.traces.excerpt
        shown = begins.setdefault((condition.surface, condition.grip, trial.segment.pair), begin)
        if begin != shown:
            others[index] = trial, shown
    moved = dict(zip(others, spread(_moved, list(others.values())), strict=False))
    return [moved.get(index, trial) for index, trial in enumerate(trials)]


def _moved(task: tuple[AnalysedTrial, float]) -> AnalysedTrial:
    """Return a trial whose excerpt starts at a time in s."""
    trial, begin = task
    segment = read_segment(trial.segment.bag, trial.segment.number)
    shift = Shift("fixed", trial.metrics["shift_ms"] / MILLI)
    again = measure(segment, trial.name, trial.source, shift, begin=begin)
    return replace(trial, portrait=again.portrait, traces=again.traces)


_Sketch: TypeAlias = tuple[tuple[tuple[str, int], ...], FloatArray]
"""Names and lengths of signals, and a summary of their samples; see `_sketch`."""

PIECES = 32
"""Number of pieces of a signal that are compared with those of another trial."""

ROUNDING = 1e-6
"""Maximum relative difference due to rounding: processors differ in the last digits, and
adaptation accumulates the difference. Other noise or another texture changes every piece by some
percent."""


def _sketch(segment: Segment) -> _Sketch:
    """Return mean and root mean square of pieces of a segment's signals, a row for each signal."""
    signals = sorted(segment.signals.items())
    rows = []
    for _, values in signals:
        pieces = np.array_split(values, PIECES)
        strengths = [np.sqrt(np.mean(piece**2)) for piece in pieces]
        rows.append([*(np.mean(piece) for piece in pieces), *strengths])
    return tuple((name, len(values)) for name, values in signals), np.array(rows)


def _same(one: _Sketch, other: _Sketch) -> bool:
    """Return whether two sketches represent the same samples up to rounding."""
    if one[0] != other[0]:
        return False
    largest = np.max(np.abs(one[1]), axis=1, keepdims=True, initial=0.0)
    return bool(np.all(np.abs(one[1] - other[1]) <= ROUNDING * largest))


def _names(bags: Sequence[Path]) -> list[str]:
    """Return for each bag the shortest name that is unique among the bags."""
    counts = Counter(bag.name for bag in bags)
    common = os.path.commonpath([bag.resolve().parent for bag in bags] or [Path()])
    return [
        bag.name if counts[bag.name] == 1 else os.path.relpath(bag.resolve(), common)
        for bag in bags
    ]

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Analysis of all trials in some bags, one bag after the other."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from haptic_accel.analysis.description import ROBOT
from haptic_accel.analysis.metrics import MILLI, AnalysedTrial, Shift, measure
from haptic_accel.analysis.segments import VECTORS, Segment, cut, read_segment
from haptic_accel.analysis.two_hosts import Across, Host, compare_across, host_of, pairs
from haptic_accel.bags.folder import find_bags
from haptic_accel.bags.reading import read_bags
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import shortage
from haptic_accel.core.simulated_rig import RigParameters


@dataclass(frozen=True)
class Analysis:
    """Result of analysing bags.

    Attributes
    ----------
    trials : list of AnalysedTrial
    problems : dict
        Lines on quantities that could not be determined, by bag.
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
        return self.shift.words(trial.segment for trial in self.trials)


Spread = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Function that applies another one to each item, like `map`; may end early."""

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
        Values for bags without metadata, see `cut`.
    apart : bool
        True if the paths are runs to be compared: the same trial counts once in each.
    spread : callable
        Function that applies the analysis to each bag: `map`, or one with several processes.
    ended : callable, optional
        Called after each bag.

    Raises
    ------
    ParameterError
        A path does not exist or has no bag, or a bag already states the given rig or rate.
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
                # Counting it as another trial would make every interval too short.
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

    A robot's bag contains no handle, and thus no trial.
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
        parts = cut(recorded, *others, rig=task.rig, asked=task.rate)
        for segment in parts.segments:
            name = task.name if segment.number == 1 else f"{task.name} #{segment.number}"
            trial = measure(segment, name, task.source, task.shift)
            measured.append((trial, _sketch(segment)))
    except ParameterError:
        raise  # an argument is wrong
    except Exception as error:
        if shortage(error):  # that is of the machine, not of the bag
            raise
        # No content of one bag may cost the others their report.
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
    """Return a trial with an excerpt from a time in s on."""
    trial, begin = task
    segment = read_segment(trial.segment.bag, trial.segment.number)
    shift = Shift("fixed", trial.metrics["shift_ms"] / MILLI)
    again = measure(segment, trial.name, trial.source, shift, begin=begin)
    return replace(trial, portrait=again.portrait, traces=again.traces)


_Sketch: TypeAlias = tuple[tuple[tuple[str, int], ...], FloatArray]
"""Names and lengths of signals, and their samples in short; see `_sketch`."""

PIECES = 32
"""Number of pieces of a signal that are compared with those of another trial."""

ROUNDING = 1e-6
"""Largest relative difference that rounding makes: other processors change the last digits, and
adaptation adds up. Other noise or texture changes every piece by some percent."""


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
    """Return whether two sketches are of the same samples up to rounding."""
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

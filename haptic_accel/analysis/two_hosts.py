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

"""Comparison of a handle with the tool of a robot recorded by another host.

The bags of both hosts of a run use the operator's time axis. The operator's coupler measured the
offset of the robot's clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from haptic_accel.analysis.description import OPERATOR, ROBOT, surface_of
from haptic_accel.analysis.metrics import PERCENT, AnalysedTrial
from haptic_accel.analysis.segments import VECTORS, read_segment
from haptic_accel.bags.reading import Bag, Signal, read_bag
from haptic_accel.core import topics
from haptic_accel.core.axes import Axes
from haptic_accel.core.control.filters import comparable, high_passed
from haptic_accel.core.evaluation.metrics import by_component, estimate_delay, shift_back
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, grid_indices, sampling_rate

OFFSET, BOUND = "clock offset (ms)", "clock offset bound (ms)"
"""Values reported by the coupler: the peer's clock minus the local one, and its maximum error."""

FEWEST_REPORTS = 10
"""Minimum number of reports for estimating the drift between the clocks; with fewer, their errors
would appear as drift."""

LONGEST_DELAY = 2.0
"""Maximum delay from the robot's tool to the handle in the search, s. A usable network has less
than 0.5 s; the clock error adds up to its bound."""

STRETCH = 2 * LONGEST_DELAY
"""Length of the stretches of a trial that are searched for a delay, s."""

PIECE = 0.5
"""Length of the pieces of a trial, s, each compared at its own delay. Playout changes its delay by
1 ms/s, and 0.5 ms is a tenth of a period at 200 Hz, where textures are felt."""


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
    """Run as recorded by one of two hosts.

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
    arguments = recorded.facts.get("arguments")
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

    Where the delay changes too much for the whole trial, it is that of the stretch with the most
    distinct one.

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

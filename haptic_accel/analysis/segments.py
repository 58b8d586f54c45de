# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Division of a bag into segments of one condition, each on its sampling grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from haptic_accel.analysis.description import Condition, Description, described, run_of, sections
from haptic_accel.bags.delivery import Delivery, delivery
from haptic_accel.bags.reading import Bag, read_bags
from haptic_accel.core import sampling, topics
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.control.channel import FADING, LISTENING
from haptic_accel.core.control.controllers import granted_delay
from haptic_accel.core.control.filters import high_passed
from haptic_accel.core.evaluation.metrics import by_component
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import IMPLAUSIBLE, NANOSECONDS, RELEASED, grid_indices
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.setup.setup import Parameters, known_arguments

RINGING = 0.2
"""Decay time of handle and tool after a change, s: eight times Table I's 2 m_h / b_u."""

EXCLUDED_AFTER_CHANGE = LISTENING + FADING + RINGING
"""Time excluded after a change of controller, surface or grip, s."""

SHORTEST = 0.9
"""Minimum duration of an analysed segment, s: a trial of 1 s minus the start-up time of a live
graph."""

_NAMES = [topic.name for topic in topics.ANALYSED]

VECTORS = (*_NAMES, topics.MASTER_ARM_FORCE.name)
"""Names of the topics whose vectors are needed; other topics need only stamps."""

_NEEDED_FOR = {
    topics.DESIRED_ACCELERATION.name: ": no error, regression, spectra, delay",
    topics.HANDLE_ACCELERATION.name: ": no error, regression, spectra, delay, travel",
    topics.ACTUATOR_FORCE.name: ": no force, travel",
}


@dataclass(frozen=True)
class Segment:
    """Section of a bag under one condition: a trial. A bag may contain several segments.

    Attributes
    ----------
    bag : Path
    condition : Condition
    rate : float
        Samples per second.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    seconds : float
        Number of samples.
    begin : float
        Start relative to the bag's first message, s.
    signals : dict of ndarray, shape (n,) for one axis or (n, k) for several
        Samples along the axes, by topic, if present in the bag.
    delivery : Delivery
    number : int
        Number among the segments of its bag, from 1.
    actuator : ActuatorParameters
        Actuator of the handle, for its travel.
    pair : tuple of str
        Properties that both trials of a pair have: seed and recording, or the bag's name if these
        are unknown.
    notes : list of str
        Assumptions, and missing items.
    latency : int or None
        Delay from sample to force, in samples; None if the bag does not state it.
    granted_delay : int
        Delay granted to the controller in addition to the latency, in samples.
    plant : Plant, MatrixPlant for three axes, or None
        Handle with the complete path from command to sample, for the bounds of the error.
    noise : float
        Standard deviation of a sample of the handle's accelerometer, m/s^2, if known.
    plant_model : Plant or None
        Model of the handle used by the compensator.
    start : int
        Stamp of the first sample, ns.
    run : str
        Description of the run; empty if the bag does not state it.
    waits : bool
        True for a simulated handle whose simulation stops while its node's process is paused.
    axes : Axes
        Axes of the vibration.
    estimated : bool
        True if the latency was estimated from the signals.
    """

    bag: Path
    condition: Condition
    rate: float
    high_pass_frequency: float
    seconds: float
    begin: float
    signals: Mapping[str, FloatArray]
    delivery: Delivery
    number: int = 1
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    pair: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    latency: int | None = 0
    granted_delay: int = 1
    plant: Plant | MatrixPlant | None = None
    noise: float = 0.0
    plant_model: Plant | None = None
    start: int = 0
    run: str = ""
    waits: bool = False
    axes: Axes = ACTUATOR_AXES
    estimated: bool = False

    @property
    def after(self) -> int | None:
        """Delay between a desired acceleration and the compared response, in samples."""
        return None if self.latency is None else self.latency + self.granted_delay


def read_segment(path: Path, number: int = 1) -> Segment:
    """Return a bag's segment by its number, with its signals.

    Raises
    ------
    ParameterError
        The path is no bag, or the bag has no such segment.
    """
    segments = cut(*read_bags(path, VECTORS)).segments
    if not 1 <= number <= len(segments):
        raise ParameterError(f"number = {number}: must be from 1 to {len(segments)} in {path}")
    return segments[number - 1]


@dataclass(frozen=True)
class Division:
    """Result of dividing recordings.

    Attributes
    ----------
    segments : list of Segment
    problems : list of str
        Quantities that could not be determined, one line each.
    """

    segments: list[Segment]
    problems: list[str]


def cut(
    *recordings: Bag, rig: RigParameters | None = None, requested: float | None = None
) -> Division:
    """Divide the recordings in a bag's folder at changes of the condition and at disengagements.

    Parameters
    ----------
    recordings : Bag
    rig : RigParameters, optional
        Rig with the handle, for a bag without its own description.
    requested : float, optional
        Sampling rate, Hz, for a bag without a stated rate; used if the stamps agree.

    Returns
    -------
    Division
        Segments and problems; these include missing signals and too short segments.

    Raises
    ------
    ParameterError
        The bag already states the rig or rate.
    """
    dividers = [_Divider(recorded) for recorded in recordings]
    found = [segment for divider in dividers for segment in divider.segments(rig, requested)]
    segments = [replace(segment, number=number) for number, segment in enumerate(found, 1)]
    return Division(segments, list(dict.fromkeys(p for each in dividers for p in each.problems)))


Period = tuple[int, int]
"""Start and end of a period, ns."""


class _Divider:
    """Divider of a bag that collects problems.

    Attributes
    ----------
    problems : list of str
    """

    def __init__(self, recorded: Bag) -> None:
        self._bag = recorded
        self._signals = {
            name: recorded.signals[name] for name in _NAMES if name in recorded.signals
        }
        self.problems = list(recorded.problems)
        for name, signal in self._signals.items():
            along = np.abs(signal.values[:, recorded.axes.indices])
            if lost := len(along) - np.count_nonzero((along < IMPLAUSIBLE).all(axis=1)):
                reason = "samples count as missing: no numbers, or beyond"
                self.problems.append(f"{name}: {lost} of {len(along)} {reason} {IMPLAUSIBLE:g}")

    def segments(self, rig: RigParameters | None, requested: float | None) -> list[Segment]:
        """Return the segments; see `cut` for the parameters."""
        rate = self._rate(requested)
        if not self._signals:
            self.problems.append(
                "none of the signals of this graph is in it: it is of another rig"
            )
        if not self._signals or rate is None:
            return []
        missing = [name for name in _NAMES if name not in self._signals]
        self.problems += [f"has no {name}{_consequence(name, missing)}" for name in missing]
        start = described(self._bag, Parameters.from_metadata(self._bag.metadata), rate, rig)
        self.problems += start.problems
        begin = max(int(signal.stamps.min()) for signal in self._signals.values())
        end = min(int(signal.stamps.max()) for signal in self._signals.values())
        if end <= begin:
            self.problems.append("its signals do not overlap in time")
            return []
        segments: list[Segment] = []
        for known, period in self._parts(start, (begin, end)):
            if self._is_long(known, period, begin):
                segments.append(self._segment(known, period))
        if not segments:
            self.problems.append(
                f"has no trial: record at least {SHORTEST:g} s with the arms engaged, without a"
                " change of controller, surface or grip"
            )
        return segments

    def _rate(self, requested: float | None) -> float | None:
        """Return the sampling rate of the stamps; the stated one if it agrees."""
        order = (topic.name for topic in (*topics.ANALYSED, *topics.SIGNALS))
        signals = (self._bag.signals[name] for name in order if name in self._bag.signals)
        found = next((signal.stamps for signal in signals if len(signal.stamps) > 1), None)
        if found is None:
            return None
        value = known_arguments(self._bag.metadata).get("rate")
        stated = float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0
        if requested and stated and requested != stated:
            own = f"must be {stated:g} Hz, as {self._bag.path} states"
            raise ParameterError(f"rate = {requested:g}: {own}")
        stated = stated or requested or 0.0
        try:
            rate = sampling.sampling_rate(found, stated or None)
        except ParameterError as error:
            self.problems.append(str(error))
            return None
        if stated and rate != stated:
            self.problems.append(
                f"has {rate:.5g} samples per second in place of the {stated:g} asked for"
            )
        return rate

    def _is_long(self, known: Description, period: Period, begin: int) -> bool:
        """Return whether a period is long enough for a trial."""
        low, high = period
        seconds = (high - low) / NANOSECONDS + 1 / known.rate
        if seconds < SHORTEST:
            condition = known.condition
            self.problems.append(
                f"{condition.controller} on {condition.surface}, {seconds:.2f} s"
                f" at {(low - begin) / NANOSECONDS:.1f} s: left out, as a trial needs at least"
                f" {SHORTEST:g} s"
            )
        return seconds >= SHORTEST

    def _parts(self, start: Description, span: Period) -> Iterator[tuple[Description, Period]]:
        """Yield description and period of each section that can be analysed."""
        coupled = self._without_gaps(self._coupled(span))
        known = [*sections(self._bag, start), (span[1] + 1, start)]
        for (moment, section), (following, _) in itertools.pairwise(known):
            settled = span[0]
            if moment > settled:
                settled = moment + round(EXCLUDED_AFTER_CHANGE * NANOSECONDS)
            for first, last in coupled:
                low, high = max(first, settled), min(last, following)
                if low < high:
                    yield section, (low, high)

    def _coupled(self, span: Period) -> list[Period]:
        """Return each period with coupled arms."""
        if topics.MASTER_ARM_FORCE.name not in self._bag.signals:
            self.problems.append(
                f"has no {topics.MASTER_ARM_FORCE.name}: whether the arms were coupled is not"
                " known, and all of it is taken"
            )
            return [span]
        found = self._bag.coupled(topics.MASTER)
        if not found:
            # Without arms, the forces of the arms are sent nevertheless once engaged.
            sent = self._bag.signals[topics.MASTER_ARM_FORCE.name].stamps
            found = [(int(sent.min()), int(sent.max()))] if len(sent) else [span]
            self.problems.append(
                "the arms' forces are zero: all of the time in which they came is taken"
            )
        return [(max(first, span[0]), min(last, span[1])) for first, last in found]

    def _without_gaps(self, periods: Sequence[Period]) -> list[Period]:
        """Divide periods at gaps: times longer than `RELEASED` without any signal.

        A recorder's gap and a clock set forward both leave a gap between stamps without samples.
        """
        every = np.unique(np.concatenate([signal.stamps for signal in self._signals.values()]))
        found: list[Period] = []
        for first, last in periods:
            within = every[(every >= first) & (every <= last)]
            gaps = np.flatnonzero(np.diff(within) > RELEASED * NANOSECONDS)
            begins = [first, *within[gaps + 1].tolist()]
            ends = [*within[gaps].tolist(), last]
            found += zip(begins, ends, strict=True)
            for end, begin in zip(ends[:-1], begins[1:], strict=True):
                self.problems.append(
                    f"no signal for {(begin - end) / NANOSECONDS:.3f} s at"
                    f" {(end - int(every[0])) / NANOSECONDS:.1f} s: the recorder has a gap, or a"
                    " clock was set forward; the parts before and after are trials of their own"
                )
        return found

    def _segment(self, known: Description, period: Period) -> Segment:
        """Return one segment on its grid."""
        low, high = period
        rate, axes = known.rate, self._bag.axes
        anchor = next(iter(self._signals.values())).stamps
        # The grid passes through a stamp, although the segment may start between two.
        start = int(anchor[np.argmax(anchor >= low)])
        length = self._length(start, high, rate)
        signals: dict[str, FloatArray] = {}
        for name, signal in self._signals.items():
            values, seen = signal.on_grid(start, rate, length, axes)
            if seen.any():
                signals[name] = values
        _complete(signals, known)
        return Segment(
            bag=self._bag.path,
            condition=known.condition,
            rate=rate,
            high_pass_frequency=known.high_pass_frequency,
            seconds=length / rate,
            begin=(start - int(anchor[0])) / NANOSECONDS,
            signals=signals,
            delivery=delivery(self._bag, start, length, rate),
            actuator=known.actuator,
            pair=known.pair,
            notes=known.notes,
            latency=known.latency,
            granted_delay=granted_delay(known.condition.controller, known.controllers, rate),
            plant=self._matrix_plant(known) if axes == ALL_AXES else known.plant(),
            noise=known.rig.master.accelerometer.noise if known.rig else 0.0,
            plant_model=known.plant_model,
            start=start,
            run=run_of(self._bag),
            waits=known.waits,
            axes=axes,
        )

    def _length(self, start: int, high: int, rate: float) -> int:
        """Return the number of samples from a stamp to the last one before an end, ns."""
        present = [signal.stamps for signal in self._signals.values()]
        # A sample may be up to half a period from its grid point, but no later than the end.
        ends = [int(np.searchsorted(stamps, high, side="right")) for stamps in present]
        last = max(int(stamps[max(0, end - 1)]) for stamps, end in zip(present, ends, strict=True))
        return int(grid_indices(np.array([last]), start, rate)[0]) + 1

    def _matrix_plant(self, known: Description) -> MatrixPlant | None:
        """Return the compensator's model of three axes; if it cannot be read, add a problem."""
        try:
            return known.matrix_plant()
        except ParameterError as error:
            self.problems.append(f"no bound of the error: {error}")
            return None


def _consequence(name: str, missing: Sequence[str]) -> str:
    """Return a description of the metrics that need a signal."""
    if name == topics.DESIRED_ACCELERATION.name and topics.TOOL_ACCELERATION.name not in missing:
        return ": it is made from the tool's acceleration with the high-pass"
    return _NEEDED_FOR.get(name, "")


def _complete(signals: dict[str, FloatArray], known: Description) -> None:
    """Compute a missing desired acceleration from the tool's."""
    tool, desired = topics.TOOL_ACCELERATION.name, topics.DESIRED_ACCELERATION.name
    if tool in signals and desired not in signals and known.rate > 2 * known.high_pass_frequency:
        passed = partial(high_passed, corner=known.high_pass_frequency, rate=known.rate)
        signals[desired] = by_component(passed, signals[tool])

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

"""Division of a bag into segments of one condition, each on its sampling grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.bags.delivery import Delivery, delivery
from haptic_accel.bags.facts import LOCKSTEP, RUN
from haptic_accel.bags.reading import Bag, Change, read_bag
from haptic_accel.core import topics
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.control.channel import FADING, LISTENING
from haptic_accel.core.control.compensation import PLANT, matrix_plant
from haptic_accel.core.control.controllers import granted_delay
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_passed
from haptic_accel.core.evaluation.metrics import by_component
from haptic_accel.core.handle.matrix_plant import MatrixPlant
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ACTUATOR, POSTURES, FloatArray, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, RELEASED, grid_indices, sampling_rate
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.materials.folders import is_recording
from haptic_accel.setup.arguments import (
    PLAYED_TOPICS,
    POINTER,
    REPLAY,
    SCENE,
    SIMULATED,
    VIRTUAL,
)
from haptic_accel.setup.setup import Parameters, known_arguments

RINGING = 0.2
"""Decay time of handle and tool after a change, s: eight times Table I's 2 m_h / b_u."""

EXCLUDED_AFTER_CHANGE = LISTENING + FADING + RINGING
"""Time excluded after a change of controller, surface or grip, s."""

SHORTEST = 0.9
"""Minimum duration of an analysed segment, s: a trial of 1 s minus the duration of a live
start."""

OPERATOR, ROBOT = "master", "slave"
"""Values of the argument ``side`` for a bag of one of two hosts."""

IMPLAUSIBLE = 1e9
"""Magnitude above which a value cannot come from a sensor or motor, m/s^2 or N. It indicates
damage, and its square may overflow."""

UNKNOWN = "unknown"
"""Name of a controller, surface or grip that is missing in a bag."""

_NAMES = [topic.name for topic in topics.ANALYSED]

VECTORS = (*_NAMES, topics.MASTER_ARM_FORCE.name)
"""Names of the topics whose vectors are needed for segments; for others the stamps suffice."""

_NEEDED_FOR = {
    topics.DESIRED_ACCELERATION.name: ": no error, regression, spectra, delay",
    topics.HANDLE_ACCELERATION.name: ": no error, regression, spectra, delay, travel",
    topics.ACTUATOR_FORCE.name: ": no force, travel",
}
_SURFACE = "simulated.surface."
_CONDITIONS = {
    ("compensator", "controller"): "controller",
    ("master_device", "simulated.grip.posture"): "grip",
    ("slave_device", f"{_SURFACE}name"): "surface",
    ("slave_device", SCENE): "surface",
}
"""Fields of `Condition` by node and parameter."""


@dataclass(frozen=True)
class Condition:
    """Controller, surface and grip: constant within a segment."""

    controller: str = UNKNOWN
    surface: str = UNKNOWN
    grip: str = UNKNOWN


@dataclass(frozen=True)
class Segment:
    """Section of a bag under one condition: a trial. A bag may contain several.

    Attributes
    ----------
    bag : Path
    number : int
        Number among the segments of its bag, from 1.
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
    actuator : ActuatorParameters
        Actuator of the handle, for its travel.
    pair : tuple of str
        Common properties of the two trials of a pair: seed and recording, or the bag's name if
        these are unknown.
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
    told : Plant or None
        Model of the handle used by the compensator.
    start : int
        Stamp of the first sample, ns.
    run : str
        Description of the run; empty if the bag does not state it.
    simulated : bool
        True for a simulated handle, whose world stood still with its node's process.
    axes : Axes
        Axes of the vibration.
    estimated : bool
        True if the latency was estimated from the signals.
    """

    bag: Path
    number: int
    condition: Condition
    rate: float
    high_pass_frequency: float
    seconds: float
    begin: float
    signals: Mapping[str, FloatArray]
    delivery: Delivery
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    pair: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    latency: int | None = 0
    granted_delay: int = 1
    plant: Plant | MatrixPlant | None = None
    noise: float = 0.0
    told: Plant | None = None
    start: int = 0
    run: str = ""
    simulated: bool = False
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
    segments = cut(read_bag(path, VECTORS)).segments
    if not 1 <= number <= len(segments):
        raise ParameterError(f"number = {number}: must be from 1 to {len(segments)} in {path}")
    return segments[number - 1]


@dataclass(frozen=True)
class Division:
    """Result of dividing a bag.

    Attributes
    ----------
    segments : list of Segment
    problems : list of str
        Quantities that could not be determined, one line each.
    """

    segments: list[Segment]
    problems: list[str]


def cut(recorded: Bag, rig: RigParameters | None = None, asked: float | None = None) -> Division:
    """Divide a bag at changes of the condition and at disengagements.

    Parameters
    ----------
    recorded : Bag
    rig : RigParameters, optional
        Rig with the handle, for a bag without its own description.
    asked : float, optional
        Sampling rate, Hz, for a bag that does not state it; used if its stamps agree.

    Returns
    -------
    Cut
        Its problems include missing signals and segments that are too short.

    Raises
    ------
    ParameterError
        The bag already states the given rig or rate.
    """
    problems = list(recorded.problems)
    rate = _rate(recorded, asked, problems)
    present = [recorded.signals[name] for name in _NAMES if name in recorded.signals]
    if not present:
        problems.append("none of the signals of this graph is in it: it is of another rig")
    if not present or rate is None:
        return Division([], problems)
    missing = [name for name in _NAMES if name not in recorded.signals]
    problems += [f"has no {name}{_consequence(name, missing)}" for name in missing]
    described = _known(recorded, Parameters.from_metadata(recorded.facts), rate, rig, problems)
    begin = max(int(signal.stamps.min()) for signal in present)
    end = min(int(signal.stamps.max()) for signal in present)
    if end <= begin:
        return Division([], [*problems, "its signals do not overlap in time"])
    segments: list[Segment] = []
    for known, low, high in _parts(recorded, described, (begin, end), problems):
        condition = known.condition
        seconds = (high - low) / NANOSECONDS + 1 / rate
        if seconds < SHORTEST:
            problems.append(
                f"{condition.controller} on {condition.surface}, {seconds:.2f} s"
                f" at {(low - begin) / NANOSECONDS:.1f} s: left out, as a trial needs at least"
                f" {SHORTEST:g} s"
            )
            continue
        number = len(segments) + 1
        segments.append(_segment(recorded, known, number, low, high, problems))
    if not segments:
        problems.append(
            f"has no trial: record at least {SHORTEST:g} s with the arms engaged, without a change"
            " of controller, surface or grip"
        )
    return Division(segments, problems)


def _consequence(name: str, missing: Sequence[str]) -> str:
    """Return a description of the metrics that need a signal."""
    if name == topics.DESIRED_ACCELERATION.name and topics.TOOL_ACCELERATION.name not in missing:
        return ": it is made from the tool's acceleration with the high-pass"
    return _NEEDED_FOR.get(name, "")


def _rate(recorded: Bag, asked: float | None, problems: list[str]) -> float | None:
    """Return the sampling rate of the stamps; the stated one if it agrees."""
    signals = [recorded.signals.get(topic.name) for topic in (*topics.ANALYSED, *topics.SIGNALS)]
    found = next((signal.stamps for signal in signals if signal and len(signal.stamps) > 1), None)
    if found is None:
        return None
    try:
        stated = float(known_arguments(recorded.facts).get("rate") or 0.0)
    except (TypeError, ValueError):
        stated = 0.0
    stated = stated if math.isfinite(stated) else 0.0
    if asked and stated and asked != stated:
        raise ParameterError(f"rate = {asked:g}: must be {stated:g} Hz, as {recorded.path} states")
    stated = stated or asked or 0.0
    try:
        rate = sampling_rate(found, stated or None)
    except ParameterError as error:
        problems.append(str(error))
        return None
    if stated and rate != stated:
        problems.append(f"has {rate:.5g} samples per second in place of the {stated:g} asked for")
    return rate


@dataclass(frozen=True)
class _Description:
    """Description of the graph of a bag, with defaults for missing items.

    Attributes
    ----------
    condition : Condition
        Condition at the start.
    parameters : Parameters
        Parameters of the nodes that the bag states.
    controllers : dict
        Parameters of the controllers by name.
    rig : RigParameters or None
        Virtual rig of the run, or the rig given for the handle.
    seed : int
        Seed of the user's grip.
    rate, high_pass_frequency, actuator, pair, latency
        See `Segment`.
    notes : tuple of str
        Parameters that have changed since the start.
    """

    condition: Condition
    parameters: Parameters
    controllers: dict[str, Any]
    rig: RigParameters | None
    seed: int
    rate: float
    high_pass_frequency: float
    actuator: ActuatorParameters
    pair: tuple[str, ...]
    latency: int | None
    notes: tuple[str, ...] = ()

    @property
    def told(self) -> Plant | None:
        """Plant model of the compensator."""
        found = self.controllers.get(PLANT)
        return found.coupled() if found else None

    def plant(self, condition: Condition) -> Plant | None:
        """Return the plant of a condition: the simulated one, or the compensator's model."""
        if self.rig is None:
            return self.told
        grip = self.rig.master.grip
        if condition.grip in POSTURES:
            grip = replace(grip, posture=condition.grip)
        return self.rig.plant(held(self.rig.master.handle, grip, self.seed))

    def matrix_plant(self, problems: list[str]) -> MatrixPlant | None:
        """Return the compensator's model of three axes; if it cannot be read, add the reason."""
        if not self.told or not self.told.model:
            return None
        try:
            return matrix_plant(self.controllers, self.rate).coupled()
        except ParameterError as error:
            problems.append(f"no bound of the error: {error}")
            return None


def _known(
    recorded: Bag,
    parameters: Parameters,
    rate: float,
    rig: RigParameters | None,
    problems: list[str],
) -> _Description:
    """Return a graph's description from its bag's metadata, and the parameters of its nodes."""
    arguments, nodes = known_arguments(recorded.facts), parameters.values
    if not nodes.get("compensator"):
        problems.append(
            "does not state how it was made: the latency is estimated where the signals show it,"
            f" and defaults are used for the high-pass ({HIGH_PASS_FREQUENCY:g} Hz) and the"
            f" actuator; record {topics.DESCRIPTION.name}, or analyse the original bag"
        )
    corner, actuator = HIGH_PASS_FREQUENCY, ActuatorParameters()
    options: dict[str, Any] = {}
    if rig and nodes:
        raise ParameterError(f"rig: {recorded.path} describes its own handle")
    try:
        if nodes.get("compensator"):
            around, options = parameters.node("compensator")
            corner, actuator = around.high_pass_frequency, options[ACTUATOR]
        if arguments.get("master") in (SIMULATED, POINTER):
            rig = parameters.rig()
    except ParameterError as error:
        problems.append(f"its parameters are invalid ({error}): defaults are used")
    stated = {
        field: str(nodes.get(node, {}).get(name) or arguments.get(field, UNKNOWN))
        for (node, name), field in _CONDITIONS.items()
    }
    condition = Condition(**stated | {"surface": surface_of(recorded)})
    pair: tuple[str, ...] = (recorded.path.name,)
    if arguments:
        seed = arguments.get("seed", nodes.get("slave_device", {}).get("seed", ""))
        surface = str(arguments.get("surface", ""))
        source = str(arguments.get("replay") or (surface if is_recording(surface) else ""))
        pair = (f"seed {seed}", *([Path(source).name] if source else []))
    seed = arguments.get("seed")
    user = seed if isinstance(seed, int) and seed >= 0 else 0
    around_trial = rate, corner, actuator, pair, recorded.latency
    return _Description(condition, parameters, options, rig, user, *around_trial)


def surface_of(recorded: Bag) -> str:
    """Return the name of the surface, or of the played recording, from a bag.

    An operator's host does not know the surface at the robot.
    """
    arguments = known_arguments(recorded.facts)
    slave = Parameters.from_metadata(recorded.facts).values.get("slave_device", {})
    if arguments.get("side") == OPERATOR:
        return UNKNOWN
    asked = str(arguments.get("surface", ""))
    if arguments.get("slave") == REPLAY:
        return f"replay of {Path(str(arguments.get('replay', ''))).stem}"
    if arguments.get("slave") == PLAYED_TOPICS:
        return "played topics"
    if arguments.get("slave") == VIRTUAL:
        return Path(str(slave.get(SCENE, asked or UNKNOWN))).stem
    if is_recording(asked):
        return "recording"
    return str(slave.get(f"{_SURFACE}name") or Path(asked).stem or UNKNOWN)


def run_of(recorded: Bag) -> str:
    """Return a description of the run of a bag's trials; empty if the bag does not state it.

    Live nodes report diagnostics. A bag with arguments but without any report may be live or
    lockstep.
    """
    if recorded.facts.get(RUN) == LOCKSTEP:
        return "in lockstep, without ROS"
    arguments = known_arguments(recorded.facts)
    if not arguments or not recorded.diagnostics:
        return ""
    found = "live on ROS 2"
    if recorded.facts.get("arguments"):
        composed = "its nodes composed into one process"
        apart = "each node in a process of its own"
        found += f", {composed if arguments.get('composed') else apart}"
    if arguments.get("side") in (OPERATOR, ROBOT):
        found += ", the other arm on another host"
    return found


def _parts(
    recorded: Bag, known: _Description, span: tuple[int, int], problems: list[str]
) -> list[tuple[_Description, int, int]]:
    """Return description, start and end of each section that can be analysed, ns."""
    coupled = _recorded(recorded, _coupled(recorded, span, problems), problems)
    conditions = [*_conditions(recorded, known), (span[1] + 1, known)]
    parts = []
    for (moment, condition), (following, _) in itertools.pairwise(conditions):
        settled = (
            moment + round(EXCLUDED_AFTER_CHANGE * NANOSECONDS) if moment > span[0] else span[0]
        )
        for first, last in coupled:
            low, high = max(first, settled), min(last, following)
            if low < high:
                parts.append((condition, low, high))
    return parts


def _coupled(recorded: Bag, span: tuple[int, int], problems: list[str]) -> list[tuple[int, int]]:
    """Return start and end of each period with coupled arms, ns."""
    if topics.MASTER_ARM_FORCE.name not in recorded.signals:
        problems.append(
            f"has no {topics.MASTER_ARM_FORCE.name}: whether the arms were coupled is not known,"
            " and all of it is taken"
        )
        return [span]
    found = recorded.coupled(topics.MASTER)
    if not found:
        # Handle and tool without arms, whose forces are sent nevertheless once they engage.
        sent = recorded.signals[topics.MASTER_ARM_FORCE.name].stamps
        found = [(int(sent.min()), int(sent.max()))] if len(sent) else [span]
        problems.append("the arms' forces are zero: all of the time in which they came is taken")
    return [(max(first, span[0]), min(last, span[1])) for first, last in found]


def _recorded(
    recorded: Bag, coupled: Sequence[tuple[int, int]], problems: list[str]
) -> list[tuple[int, int]]:
    """Divide periods at gaps: times longer than `RELEASED` without any signal.

    A gap of the recorder and a clock set forward leave the same gap between stamps. In either
    case no sample is in it.
    """
    stamps = [recorded.signals[name].stamps for name in _NAMES if name in recorded.signals]
    every = np.unique(np.concatenate(stamps))
    found: list[tuple[int, int]] = []
    for first, last in coupled:
        within = every[(every >= first) & (every <= last)]
        gaps = np.flatnonzero(np.diff(within) > RELEASED * NANOSECONDS)
        begins = [first, *within[gaps + 1].tolist()]
        ends = [*within[gaps].tolist(), last]
        found += zip(begins, ends, strict=True)
        for end, begin in zip(ends[:-1], begins[1:], strict=True):
            problems.append(
                f"no signal for {(begin - end) / NANOSECONDS:.3f} s at"
                f" {(end - int(every[0])) / NANOSECONDS:.1f} s: the recorder has a gap, or a clock"
                " was set forward; the parts before and after are trials of their own"
            )
    return found


def _conditions(recorded: Bag, known: _Description) -> list[tuple[int, _Description]]:
    """Return the descriptions of a bag's sections and the start of each, ns; the first is 0."""
    conditions = [(0, known)]
    # A node declares the parameters of all its devices, and the recorder may receive these.
    unused = _SURFACE if known_arguments(recorded.facts).get("slave") == VIRTUAL else SCENE
    changes = (each for each in recorded.changes if not each.parameter.startswith(unused))
    parameters = known.parameters
    for change in sorted(changes, key=lambda change: change.received):
        before = conditions[-1][1]
        after = replace(before, condition=_changed(before.condition, change, known))
        own = parameters.values.get(change.node, {})
        is_other = own.get(change.parameter, change.value) != change.value
        parameters = parameters.changed({change.node: {change.parameter: change.value}})
        if is_other and after.condition == before.condition and change.node in _FIGURES:
            after = _set(recorded, parameters, after, change)
        if after != before:
            conditions.append((change.received, after))
    return conditions


_FIGURES = ("compensator", "coupler", "master_device", "slave_device")
"""Nodes with parameters that a metric or a bound depends on."""


def _set(
    recorded: Bag, parameters: Parameters, before: _Description, change: Change
) -> _Description:
    """Return the description after a change of a parameter that belongs to no condition."""
    after = _known(recorded, parameters, before.rate, None, [])
    name = f"{change.node}: {change.parameter}"
    others = (note for note in before.notes if not note.startswith(f"{name} = "))
    notes = (*others, f"{name} = {change.value} since a change during the recording")
    return replace(after, condition=before.condition, notes=notes)


def _changed(before: Condition, change: Change, known: _Description) -> Condition:
    """Return the condition after the change of a parameter."""
    if field := _CONDITIONS.get((change.node, change.parameter)):
        value = str(change.value)
        return replace(before, **{field: Path(value).stem if change.parameter == SCENE else value})
    slave = known.parameters.values.get("slave_device", {})
    value = slave.get(change.parameter, change.value)
    is_other = change.node == "slave_device" and change.parameter.startswith(_SURFACE)
    # If a surface is replaced completely, its name is known and other fields are redundant.
    if is_other and change.value != value and before.surface == known.condition.surface:
        return replace(before, surface=before.surface + ALTERED)
    return before


ALTERED = " (altered)"
"""Suffix of a surface with some parameters changed during contact."""


def _segment(
    recorded: Bag,
    known: _Description,
    number: int,
    low: int,
    high: int,
    problems: list[str],
) -> Segment:
    """Arrange one segment on its grid."""
    rate = known.rate
    anchor = next(recorded.signals[name] for name in _NAMES if name in recorded.signals)
    # The grid passes through a stamp, although the segment may start between two.
    start = int(anchor.stamps[np.argmax(anchor.stamps >= low)])
    present = [recorded.signals[name].stamps for name in _NAMES if name in recorded.signals]
    # A sample may be up to half a period from its grid point, but no later than the end.
    ends = [int(np.searchsorted(stamps, high, side="right")) for stamps in present]
    last = max(int(stamps[max(0, end - 1)]) for stamps, end in zip(present, ends, strict=True))
    length = int(grid_indices(np.array([last]), start, rate)[0]) + 1
    signals: dict[str, FloatArray] = {}
    axes = recorded.axes
    for name in _NAMES:
        if name in recorded.signals:
            values, seen = recorded.signals[name].on_grid(start, rate, length, axes)
            if seen.any():
                signals[name] = values
    notes = [*known.notes, *_complete(signals, known)]
    condition = known.condition
    return Segment(
        recorded.path,
        number,
        condition,
        rate,
        known.high_pass_frequency,
        length / rate,
        (start - int(anchor.stamps[0])) / NANOSECONDS,
        signals,
        delivery(recorded, start, length, rate),
        known.actuator,
        known.pair,
        tuple(notes),
        known.latency,
        granted_delay(condition.controller, known.controllers),
        known.matrix_plant(problems) if axes == ALL_AXES else known.plant(condition),
        known.rig.master.accelerometer.noise if known.rig else 0.0,
        known.told,
        start,
        run_of(recorded),
        known_arguments(recorded.facts).get("master") in (SIMULATED, POINTER),
        axes,
    )


def _complete(signals: dict[str, FloatArray], known: _Description) -> list[str]:
    """Compute a missing desired acceleration from the tool's; remove damaged signals."""
    notes = []
    for name, values in list(signals.items()):
        if not np.isfinite(values).all():
            notes.append(f"{name} is not used: it holds values that are no numbers")
        elif not (np.abs(values) < IMPLAUSIBLE).all():
            notes.append(f"{name} is not used: it holds values beyond {IMPLAUSIBLE:g}")
        else:
            continue
        del signals[name]
    tool, desired = topics.TOOL_ACCELERATION.name, topics.DESIRED_ACCELERATION.name
    if tool in signals and desired not in signals and known.rate > 2 * known.high_pass_frequency:
        passed = partial(high_passed, corner=known.high_pass_frequency, rate=known.rate)
        signals[desired] = by_component(passed, signals[tool])
    return notes

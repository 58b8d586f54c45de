"""Cuts a bag into segments of one condition, each on its sampling grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.bags.delivery import Delivery, delivery
from haptic_accel.bags.reading import Bag
from haptic_accel.core import topics
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.control.compensation import FADING, LISTENING
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass
from haptic_accel.core.model import ACTUATOR, FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import (
    NANOSECONDS,
    coupled_stretches,
    on_grid,
    places,
    sampling_rate,
)
from haptic_accel.core.topics import ACTUATOR_AXIS
from haptic_accel.graph.arguments import PLAYED_TOPICS, RECORDING, REPLAY
from haptic_accel.graph.node_parameters import node_parameters

RINGING = 0.2
"""Time that handle and tool ring after a change, s: eight times Table I's 2 m_h / b_u."""

SETTLING = LISTENING + FADING + RINGING
"""Time left out after a change of controller, surface or grip, s."""

SHORTEST = 0.9
"""Shortest segment that is analysed, s: a trial of 1 s less what a live start takes."""

_WHOLE = 1e-3
"""Part of a sample by which the last one may lie behind a segment's end: stamps are whole ns."""

UNKNOWN = "unknown"
"""Name of a controller, surface or grip that a bag does not state."""

CORE = (
    topics.TOOL_ACCELERATION,
    topics.DESIRED_ACCELERATION,
    topics.HANDLE_ACCELERATION,
    topics.ACTUATOR_FORCE,
)
"""Signals that are analysed, along the actuator's axis."""

_SURFACE = "simulated.surface."
_POSTURE = "simulated.grip.posture"


@dataclass(frozen=True)
class Condition:
    """Controller, surface and grip: constant within a segment."""

    controller: str = UNKNOWN
    surface: str = UNKNOWN
    grip: str = UNKNOWN


@dataclass(frozen=True)
class Segment:
    """A part of a bag under one condition: a trial, of which a bag may hold several.

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
        Length.
    begin : float
        Start since the bag's first message, s.
    signals : dict of ndarray, shape (n,)
        Samples along the actuator's axis, by topic; those of `CORE` that the bag has.
    delivery : Delivery
    actuator : ActuatorParameters
        Actuator of the handle, for its travel.
    pair : tuple of str
        Properties that two trials of a pair share: seed and recording; the bag's name if it does
        not state them.
    notes : list of str
        Assumptions, and what is missing.
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

    def without_signals(self) -> Segment:
        """Return the segment without its samples, which take the memory."""
        nothing = replace(self.delivery, transit=np.empty(0))
        return replace(self, signals={}, delivery=nothing)


@dataclass(frozen=True)
class Cut:
    """Result of cutting a bag.

    Attributes
    ----------
    segments : list of Segment
    problems : list of str
        What could not be determined, a line each.
    """

    segments: list[Segment]
    problems: list[str]


def cut(recorded: Bag) -> Cut:
    """Cut a bag where the condition changes and where the arms let go.

    Parameters
    ----------
    recorded : Bag

    Returns
    -------
    Cut
        Signals that are missing, and segments too short to be looked at, are in its problems.
    """
    problems = list(recorded.problems)
    rate = _rate(recorded, problems)
    present = [topic for topic in CORE if topic.name in recorded.signals]
    missing = [topic.name for topic in CORE if topic not in present]
    if not present or rate is None:
        if not present:
            problems.append("none of the signals of this graph is in it: it is of another rig")
        return Cut([], problems)
    problems += [f"has no {name}{_consequence(name, missing)}" for name in missing]
    known = _Known(recorded, rate, problems)
    span = (
        max(int(recorded.signals[topic.name].stamps.min()) for topic in present),
        min(int(recorded.signals[topic.name].stamps.max()) for topic in present),
    )
    if span[1] <= span[0]:
        return Cut([], [*problems, "its signals do not overlap in time"])
    segments: list[Segment] = []
    for condition, low, high in _parts(recorded, known, span, problems):
        seconds = (high - low) / NANOSECONDS + 1 / known.rate
        if seconds < SHORTEST:
            problems.append(
                f"{condition.controller} on {condition.surface}, {seconds:.2f} s"
                f" at {(low - span[0]) / NANOSECONDS:.1f} s: too short, is left out"
            )
            continue
        segments.append(_segment(recorded, known, condition, len(segments) + 1, low, high))
    if not segments:
        problems.append(f"has no segment of {SHORTEST:g} s under one condition")
    return Cut(segments, problems)


def _consequence(name: str, missing: Sequence[str]) -> str:
    """Name the metrics that need a signal."""
    tool, desired, handle, force = (topic.name for topic in CORE)
    if name == desired and tool not in missing:
        return ": it is made from the tool's acceleration with the high-pass"
    return {
        tool: "",
        desired: ": no error, regression, spectra, delay",
        handle: ": no error, regression, spectra, delay, travel",
        force: ": no force, travel, latency",
    }[name]


def _rate(recorded: Bag, problems: list[str]) -> float | None:
    """Return the samples per second that the stamps have, as stated where they agree with that."""
    found = next(
        (
            recorded.signals[topic.name].stamps
            for topic in (*CORE, *topics.SIGNALS)
            if topic.name in recorded.signals and len(recorded.signals[topic.name].stamps) > 1
        ),
        None,
    )
    if found is None:
        return None
    stated = _number(recorded.facts.get("arguments"), "rate") or None
    try:
        rate = sampling_rate(found, stated)
    except ParameterError as error:
        problems.append(str(error))
        return None
    if stated and rate != stated:
        problems.append(f"has {rate:.5g} samples per second in place of the {stated:g} asked for")
    return rate


def _number(values: Any, name: str) -> float | None:
    """Return a number of a mapping, None if it is missing or no number."""
    value = values.get(name) if isinstance(values, dict) else None
    try:
        return float(value) if value is not None and math.isfinite(float(value)) else None
    except (TypeError, ValueError):
        return None


class _Known:
    """Description of the graph that made a bag, with defaults for what it does not state.

    Attributes
    ----------
    condition : Condition
        Condition at the beginning.
    """

    def __init__(self, recorded: Bag, rate: float, problems: list[str]) -> None:
        self.rate = rate
        self._parameters = _mapping(recorded.facts.get("parameters"))
        arguments = _mapping(recorded.facts.get("arguments"))
        self.notes: list[str] = []
        if not recorded.facts:
            problems.append(
                "does not say how it was made: controller and surface are unknown, and defaults"
                f" stand for the high-pass ({HIGH_PASS_FREQUENCY:g} Hz) and the actuator"
            )
        self.condition = self._first(arguments)
        self.high_pass_frequency = HIGH_PASS_FREQUENCY
        self.actuator = ActuatorParameters()
        try:
            around, options = node_parameters("compensator", self.of_node("compensator"))
            self.high_pass_frequency = around.high_pass_frequency
            self.actuator = options[ACTUATOR]
        except ParameterError as error:
            problems.append(f"its parameters are not ours ({error}): defaults stand for them")
        self.pair = self._pair(recorded, arguments)

    def of_node(self, node: str) -> dict[str, Any]:
        """Return a node's parameters by dotted name."""
        return _mapping(self._parameters.get(node))

    def _first(self, arguments: Mapping[str, Any]) -> Condition:
        master = self.of_node("master_device")
        return Condition(
            str(
                self.of_node("compensator").get("controller")
                or arguments.get("controller", UNKNOWN)
            ),
            self._surface(arguments),
            str(master.get(_POSTURE) or arguments.get("grip", UNKNOWN)),
        )

    def _surface(self, arguments: Mapping[str, Any]) -> str:
        """Return the name of the surface, or of what was played in its place."""
        asked = str(arguments.get("surface", ""))
        slave = arguments.get("slave")
        if slave == REPLAY:
            return f"replay of {Path(str(arguments.get('replay', ''))).stem}"
        if slave == PLAYED_TOPICS:
            return "played topics"
        if asked == RECORDING:
            return RECORDING
        name = self.of_node("slave_device").get(f"{_SURFACE}name")
        return str(name or Path(asked).stem or UNKNOWN)

    def _pair(self, recorded: Bag, arguments: Mapping[str, Any]) -> tuple[str, ...]:
        if not arguments:
            return (recorded.path.name,)
        seed = arguments.get("seed", self.of_node("slave_device").get("seed", ""))
        source = next((str(arguments[key]) for key in _SOURCES if arguments.get(key)), "")
        return (f"seed {seed}", Path(source).name) if source else (f"seed {seed}",)


_SOURCES = ("replay", "recording")
"""Arguments that name the recording that a slave played."""


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _parts(
    recorded: Bag, known: _Known, span: tuple[int, int], problems: list[str]
) -> list[tuple[Condition, int, int]]:
    """Return condition, start and end of each part that can be analysed, ns."""
    coupled = _coupled(recorded, span, problems)
    conditions = _conditions(recorded, known)
    parts = []
    for (moment, condition), (following, _) in itertools.pairwise(
        [*conditions, (span[1] + 1, known.condition)]
    ):
        settled = moment + round(SETTLING * NANOSECONDS) if moment > span[0] else span[0]
        for first, last in coupled:
            low, high = max(first, settled), min(last, following)
            if low < high:
                parts.append((condition, low, high))
    return parts


def _coupled(recorded: Bag, span: tuple[int, int], problems: list[str]) -> list[tuple[int, int]]:
    """Return start and end of each time in which the arms were coupled, ns."""
    forces = recorded.signals.get(topics.MASTER_ARM_FORCE.name)
    if forces is None:
        problems.append(
            f"has no {topics.MASTER_ARM_FORCE.name}: whether the arms were coupled is not known,"
            " and all of it is taken"
        )
        return [span]
    found = coupled_stretches(forces.stamps, forces.values)
    if not found:
        problems.append("the arms were never coupled, as their forces are zero: all is taken")
        return [span]
    return [(max(first, span[0]), min(last, span[1])) for first, last in found]


def _conditions(recorded: Bag, known: _Known) -> list[tuple[int, Condition]]:
    """Return the conditions of a bag and the start of each, ns; the first starts at 0."""
    conditions = [(0, known.condition)]
    for change in sorted(recorded.changes, key=lambda change: change.received):
        before = conditions[-1][1]
        after = _changed(before, change.node, change.parameter, change.value, known)
        if after != before:
            conditions.append((change.received, after))
    return conditions


def _changed(before: Condition, node: str, parameter: str, value: Any, known: _Known) -> Condition:
    """Return the condition after a parameter got a value."""
    if node == "compensator" and parameter == "controller":
        return replace(before, controller=str(value))
    if node == "master_device" and parameter == _POSTURE:
        return replace(before, grip=str(value))
    if node == "slave_device" and parameter == f"{_SURFACE}name":
        return replace(before, surface=str(value))
    if node == "slave_device" and parameter.startswith(_SURFACE):
        first = known.of_node("slave_device").get(parameter, value)
        altered = before.surface.endswith(ALTERED)
        # Of a surface changed as a whole, all fields but the name say nothing more.
        if value != first and not altered and before.surface == known.condition.surface:
            return replace(before, surface=before.surface + ALTERED)
    return before


ALTERED = " (altered)"
"""Suffix of a surface whose parameters were changed in part while it was touched."""


def _segment(
    recorded: Bag, known: _Known, condition: Condition, number: int, low: int, high: int
) -> Segment:
    """Put one segment on its grid."""
    rate = known.rate
    anchor = next(recorded.signals[t.name] for t in CORE if t.name in recorded.signals)
    # The grid goes through a stamp: the segment begins where something else happened.
    start = int(anchor.stamps[np.argmax(anchor.stamps >= low)])
    length = math.floor((high - start) * rate / NANOSECONDS + _WHOLE) + 1
    signals: dict[str, FloatArray] = {}
    for topic in CORE:
        if topic.name in recorded.signals:
            signal = recorded.signals[topic.name]
            where = places(signal.stamps, start, rate)
            if ((where >= 0) & (where < length)).any():
                values = signal.values[:, ACTUATOR_AXIS]
                signals[topic.name], _ = on_grid(where, values, length)
    notes = _complete(signals, known)
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
    )


def _complete(signals: dict[str, FloatArray], known: _Known) -> list[str]:
    """Make the desired acceleration where only the tool's was recorded; leave out what is NaN."""
    notes = []
    for name in [name for name, values in signals.items() if not np.isfinite(values).all()]:
        notes.append(f"{name} holds values that are no numbers, and is not used")
        del signals[name]
    tool, desired = topics.TOOL_ACCELERATION.name, topics.DESIRED_ACCELERATION.name
    if tool in signals and desired not in signals and known.rate > 2 * known.high_pass_frequency:
        from scipy import signal

        sections = high_pass(known.high_pass_frequency, known.rate)
        first = signals[tool][0]
        signals[desired] = np.asarray(signal.sosfilt(sections, signals[tool] - first))
    return notes

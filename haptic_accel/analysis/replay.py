# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags played in lockstep through a controller, and the resulting errors.

A live graph's bag is also repeated unchanged in lockstep, to find the first difference and its
reason. With simulated devices, or a recorded slave, both trials are bit-identical from engagement
on, if every force arrives on time and no sample is skipped.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from haptic_accel.analysis.description import surface_of
from haptic_accel.bags.delivery import count
from haptic_accel.bags.reading import Bag, Diagnosis, read_bag
from haptic_accel.bags.writing import trial_vectors
from haptic_accel.core import topics
from haptic_accel.core.files import located
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, grid_indices, on_grid
from haptic_accel.core.tables import Column, Row
from haptic_accel.core.tick.device_side import PAST_TICK
from haptic_accel.core.track import Track
from haptic_accel.core.trial import Trial
from haptic_accel.setup import lockstep
from haptic_accel.setup.arguments import REPLAY, SIMULATED, VIRTUAL, GraphArguments, check_lockstep
from haptic_accel.setup.replay import Replay, ReplayArguments, replayed_track
from haptic_accel.setup.setup import Setup

COLUMNS = (
    Column("bag", "bag", value=lambda row: Path(row["bag"]).name),
    Column("surface", "surface"),
    Column("controller", "controller"),
    Column("after_samples", "after\nsamples"),
    Column("nrmse_percent", "NRMSE\n%", digits=2),
    Column("slope_actual_on_desired", "slope\na on d", digits=3),
    Column("slope_desired_on_actual", "slope\nd on a", digits=3),
    Column("r2", "R²", digits=3),
)
"""Columns of the table; the slopes are actual on desired, and desired on actual."""


@dataclass(frozen=True)
class PlayedCondition:
    """Bag, graph that plays it, and bag for the result."""

    own: ReplayArguments
    graph: GraphArguments
    touched: str
    out: Path | None


def play(condition: PlayedCondition) -> Row:
    """Play a bag through a controller; record the result if an output bag is specified."""
    start = time.time_ns()
    track = replayed_track(condition.own.bag, condition.graph, condition.own.duration)
    setup = Setup.of(condition.graph)
    trial = lockstep.lockstep_trial(setup, track=track)
    trial = replace(trial, surface=condition.touched)
    metrics = _metrics(condition.own.bag, trial, track)
    if condition.out:
        shutil.rmtree(condition.out, ignore_errors=True)  # left by a process that died
        lockstep.record_trial(condition.out, trial, setup, start)
    return metrics


def progress(row: Row) -> str:
    """Return a progress message with a condition's error."""
    return f"{Path(row['bag']).name} / {row['controller']}: {row['nrmse_percent']:.2f} %"


def touching(replay: Replay) -> Replay:
    """Return a replay with its bag's surface, without the bag itself."""
    touched = surface_of(replay.bag) if replay.bag else replay.graph.surface
    return replace(replay, bag=None, touched=touched)


def _metrics(bag: str, trial: Trial, track: Track) -> Row:
    """Return the metrics of a bag played through a controller."""
    try:
        evaluation = trial.evaluate()
    except ValueError as error:
        raise ParameterError(f"{bag}: {error}") from None
    return {
        "bag": bag,
        "surface": trial.surface,
        "controller": trial.controller,
        **asdict(evaluation),
        "seconds": trial.seconds,
        "rate_hz": trial.rate,
        "latency_samples": trial.latency,
        "after_samples": trial.after,
        "lost": int(track.lost.sum()),
    }


PAST_TICK_BEFORE = "deadlines missed"
"""Suffix of the older name of the counter `PAST_TICK`."""

CAUSES = {
    PAST_TICK: "a force came after its due time",
    PAST_TICK_BEFORE: "a force came after its due time",
    "missed ticks": "ticks were left out",
    "ticks without a sample": "a sample was not taken",
    "without the handle's sample": "the handle's sample came too late for the compensator",
    "withheld": "the compensator did not know yet that the device applies forces",
    "positions held": "an arm's position was missing",
    "lost": "samples were lost",
    "timeouts": "commands stopped",
    "rejected": "samples or forces were refused",
    "handle not trusted": "a sample of the handle was missing, saturated or no number",
    "force limited": "the safety layer reduced a force",
    "actuator force limited by heat": "the safety layer reduced a force",
    "actuator force limited by travel": "the safety layer reduced a force",
}
"""Reasons by the suffix of a counter in the nodes' reports."""

UNKNOWN = "no node reported a reason"


@dataclass(frozen=True)
class Divergence:
    """Comparison of a live trial with the same trial in lockstep.

    Attributes
    ----------
    bag : Path
    samples : int
        Number of samples compared, from engagement on.
    first : int or None
        First sample that differs, counted from engagement; None if all are equal.
    rate : float
        Samples per second.
    signals : tuple of str
        Topics that differ at that sample.
    reasons : tuple of str
        Counters of the nodes that increased at that time.
    """

    bag: Path
    samples: int
    first: int | None
    rate: float
    signals: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """Description of the comparison."""
        seconds = self.samples / self.rate
        if self.first is None:
            compared = f"all {self.samples} samples ({seconds:.3g} s)"
            return f"{self.bag}: {compared} equal those in lockstep."
        return (
            f"{self.bag}: differs from lockstep first at sample {self.first} of {self.samples}"
            f" ({self.first / self.rate:.3f} s) in {', '.join(self.signals)}:"
            f" {'; '.join(self.reasons)}."
        )


def find_divergence(path: Path) -> Divergence:
    """Repeat the trial of a bag in lockstep, and compare all signals bit by bit.

    Parameters
    ----------
    path : Path
        Bag with metadata, recorded with a simulated master and a simulated or recorded slave.

    Raises
    ------
    ParameterError
        The bag is of another kind, or its arms were never coupled.
    """
    bag = read_bag(path)
    setup = _setup(bag)
    arguments = setup.arguments
    start, length = _coupled(bag, arguments.rate)
    track = lockstep.replayed_track(arguments) if arguments.slave == REPLAY else None
    timed = replace(setup, arguments=replace(arguments, duration=length / arguments.rate))
    trial = lockstep.lockstep_trial(timed, track=track)
    length = min(length, len(trial.time))
    first, signals = length, []
    for topic, vectors in trial_vectors(trial).items():
        values = vectors[:length]
        index = _first_difference(bag, topic.name, start, arguments.rate, values)
        if index < first:
            first, signals = index, [topic.name]
        elif index == first < length:
            signals.append(topic.name)
    if first == length:
        return Divergence(path, length, None, arguments.rate)
    moment = start + round(first * NANOSECONDS / arguments.rate)
    reasons = _reasons(bag, start, moment)
    return Divergence(path, length, first, arguments.rate, tuple(signals), reasons)


def _setup(bag: Bag) -> Setup[GraphArguments]:
    """Return the setup of the recorded graph from its bag; its files may have changed since."""
    with located(bag.path):
        setup = Setup.from_metadata(bag.metadata)
        arguments = setup.arguments
        check_lockstep(arguments, "to be compared with lockstep", (SIMULATED, VIRTUAL, REPLAY))
        if arguments.latency == 0:
            raise ParameterError("latency = 0: forces have no due time")
    if arguments.slave != REPLAY:
        return setup
    # An absolute path is found from any working directory.
    played = setup.values["slave_device"][f"{REPLAY}.file"]
    return replace(setup, arguments=replace(arguments, replay=played))


def _coupled(bag: Bag, rate: float) -> tuple[int, int]:
    """Return the stamp of engagement, and the number of samples until disengagement."""
    found = bag.coupled(topics.MASTER)
    if not found:
        raise ParameterError(f"{bag.path}: its arms were never coupled")
    start, end = found[0]
    # The lockstep trial contains no switch of controller, surface or grip.
    # A declaration is no switch, and the recorder may receive it late.
    first: dict[tuple[str, str], str] = {}
    changed = [
        change.received
        for change in bag.changes
        if first.setdefault((change.node, change.parameter), repr(change.value))
        != repr(change.value)
        and change.received > start
    ]
    return start, round((min([end, *changed]) - start) * rate / NANOSECONDS) + 1


def _first_difference(bag: Bag, name: str, start: int, rate: float, expected: FloatArray) -> int:
    """Return the first index at which a recorded signal differs, or the length.

    A message that the recorder lost does not count as a difference.
    """
    signal = bag.signals.get(name)
    if signal is None:
        return len(expected)
    values, seen = on_grid(grid_indices(signal.stamps, start, rate), signal.values, len(expected))
    differs = np.any(values != expected, axis=1)
    found = np.flatnonzero(differs & seen)
    return int(found[0]) if len(found) else len(expected)


def _reasons(bag: Bag, start: int, moment: int) -> tuple[str, ...]:
    """Return the counters that increased in the nodes' reports near a time."""
    reasons = []
    for node in dict.fromkeys(report.node for report in bag.diagnostics):
        reports = [report for report in bag.diagnostics if report.node == node]
        before = [r for r in reports if start < r.received < moment]
        after = [r for r in reports if r.received >= moment]
        if after:
            reasons += _grown(before[-1].values if before else {}, after[0])
    return tuple(reasons) or (UNKNOWN,)


def _grown(before: Mapping[str, str], report: Diagnosis) -> list[str]:
    """Return as reasons the counters of a node that increased since an earlier report."""
    # By the clock, a force is also late if the simulation was paused with its process.
    by_clock = any(name.endswith(PAST_TICK) for name in report.values)
    return [
        f"{text} ({report.node}, {name})"
        for name in report.values
        for end, text in CAUSES.items()
        if (name == end or name.endswith(f" {end}"))
        and not (by_clock and end == PAST_TICK_BEFORE)
        and count(report.values, name) > count(before, name)
    ]

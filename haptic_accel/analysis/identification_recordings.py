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

"""Recordings of an identification: made in lockstep, or read from bags and CSV files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean

import numpy as np

from haptic_accel.analysis.identification_results import rig_as_held
from haptic_accel.bags.delivery import AGE_OF, durations
from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.core import topics
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.stops import LIMITED, STOPS_HIT
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, same_rate
from haptic_accel.core.trial import run_identification
from haptic_accel.graph.arguments import IdentifyArguments
from haptic_accel.materials.recordings import read_recording

MOST_MISSING = 0.01
"""Largest share of missing samples with which a trial is evaluated (assumed)."""

COLUMNS = ("actuator_force", "handle_acceleration")
"""Columns of a CSV file, N and m/s^2."""


@dataclass
class Recordings:
    """Trials of an identification.

    Attributes
    ----------
    trials : dict
        Trials by the name of the grip.
    age : float
        Mean age of forces without a due time, s.
    left_out : list of str
        Lines on trials that miss too many samples.
    """

    trials: dict[str, list[sweeps.IdentificationTrial]] = field(default_factory=dict)
    age: float = 0.0
    left_out: list[str] = field(default_factory=list)


def run_lockstep(arguments: IdentifyArguments) -> list[sweeps.IdentificationTrial]:
    """Run the trials of one grip in lockstep."""
    return run_identification(
        rig_as_held(arguments).master,
        arguments.sweep,
        arguments.rate,
        arguments.seed,
        arguments.trials,
        arguments.latency,
    )


def named(sources: Sequence[str], grip: str) -> Iterator[tuple[str, Path]]:
    """Yield grip and path of each source, ``GRIP=PATH``, or ``PATH`` with the grip given."""
    for source in sources:
        name, separator, path = source.partition("=")
        yield (name, Path(path)) if separator else (grip, Path(source))


def read_recordings(
    places: Iterable[tuple[str, Path]], arguments: IdentifyArguments, recording_rate: float
) -> Recordings:
    """Read trials from bags and CSV files.

    Parameters
    ----------
    places : iterable of tuple
        Grip and path of each.
    arguments : IdentifyArguments
    recording_rate : float
        Sampling rate of CSV files, Hz; 0 for the graph's.

    Raises
    ------
    ParameterError
        They differ in rate or latency.
    RecordingError
        A bag is of no identification, or has no trial that can be evaluated.
    """
    found = Recordings()
    ages = []
    for grip, path in places:
        if os.path.isdir(path):
            bag = read_bag(path)
            trials = _trials(bag, arguments, found.left_out)
            ages.append(_force_age(bag))
        else:
            rate = recording_rate or arguments.rate
            force, acceleration = (
                read_recording(str(path), rate, rate, column=column) for column in COLUMNS
            )
            trials = sweeps.find_trials(force, acceleration, arguments.sweep, rate)
        found.trials.setdefault(grip, []).extend(trials)
    every = [trial for trials in found.trials.values() for trial in trials]
    for name, count in (
        ("rates", len({trial.rate for trial in every})),
        ("latencies", len({trial.latency for trial in every})),
    ):
        if count > 1:
            raise ParameterError(f"from: recordings of {count} {name}, must be of one")
    found.age = fmean(ages) if ages else 0.0
    return found


def _trials(
    bag: Bag, arguments: IdentifyArguments, left_out: list[str]
) -> list[sweeps.IdentificationTrial]:
    """Return the trials of a bag, without those that miss too many samples.

    Raises
    ------
    RecordingError
        No trial is left.
    """
    force, acceleration, missing = _read_excited(bag, arguments.rate)
    found = sweeps.find_trials(
        force, acceleration, arguments.sweep, arguments.rate, missing, bag.latency
    )
    # The device knows; in which trial it was, nobody does.
    values = _last_values(bag, "master_device")
    for trial in found:
        trial.counters.update((key, int(values.get(key, 0))) for key in (STOPS_HIT, *LIMITED))
    most = MOST_MISSING * len(found[0].actuator_force)
    whole = [trial for trial in found if trial.counters[sweeps.SAMPLES_MISSING] <= most]
    if len(whole) < len(found):
        counts = ", ".join(str(trial.counters[sweeps.SAMPLES_MISSING]) for trial in found)
        reason = (
            f"{bag.path}: {len(found) - len(whole)} of {len(found)} trials left out, as each lacks"
            f" more than {100 * MOST_MISSING:g} % of its samples (missing by trial: {counts});"
            " record again with less load on the machine, which haptic-accel doctor checks, or at"
            " a lower rate:="
        )
        if not whole:
            raise RecordingError(reason)
        left_out.append(reason)
    return whole


def _read_excited(bag: Bag, rate: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return actuator force and handle acceleration of an identification's bag.

    Parameters
    ----------
    bag : Bag
        Bag written by the recorder.
    rate : float
        Samples per second of the graph.

    Returns
    -------
    actuator_force, handle_acceleration : ndarray, shape (n,)
        N and m/s^2; each force is at the sample that caused it.
    missing : ndarray of bool, shape (n,)
        True for samples missing in the bag, which repeat the previous value.

    Raises
    ------
    RecordingError
        The bag lacks a signal, or has another rate.
    """
    signals = bag.signals
    for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION):
        if topic.name not in signals or len(signals[topic.name].stamps) < 2:
            raise RecordingError(f"{bag.path}: has no {topic.name}")
    stamps = signals[topics.HANDLE_ACCELERATION.name].stamps
    found = NANOSECONDS / float(np.median(np.diff(stamps)))
    if not same_rate(found, rate):
        raise RecordingError(
            f"{bag.path}: {topics.HANDLE_ACCELERATION.name} has {found:.5g} samples per second,"
            f" must have rate = {rate:g} Hz"
        )
    start = int(stamps[0])
    length = round((int(stamps[-1]) - start) / (NANOSECONDS / rate)) + 1
    force, _ = signals[topics.ACTUATOR_FORCE.name].on_grid(start, rate, length)
    acceleration, seen = signals[topics.HANDLE_ACCELERATION.name].on_grid(start, rate, length)
    return force, acceleration, ~seen


def _force_age(bag: Bag) -> float:
    """Return the median age of the actuator's forces applied on arrival, s.

    0 for forces with a due time, and without diagnostics of them.
    """
    if bag.latency:
        return 0.0
    values = _last_values(bag, "master_device")
    return durations(values, f"{AGE_OF} age").get("p50", 0.0) * 1e-6


def _last_values(bag: Bag, node: str) -> dict[str, str]:
    """Return the last values in a node's diagnostics; empty without any."""
    return {said.node: said.values for said in bag.diagnostics}.get(node, {})

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Identification of a handle from its recordings, or from a run in lockstep."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from statistics import fmean

import numpy as np

from haptic_accel.analysis.identification_result import OneAxisResult, Result, ThreeAxisResult
from haptic_accel.bags.delivery import AGE_OF, count, durations
from haptic_accel.bags.reading import Bag, read_bag_with_warnings
from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXIS, ALL_AXES, Axes
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification import three_axes
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.evaluation import Tell, identify_handle, stages
from haptic_accel.core.identification.sweep import Recorded, check_stops, check_travel
from haptic_accel.core.identification.three_axes import ThreeAxisIdentification
from haptic_accel.core.model import ACTUATOR, FloatArray, HandleParameters, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, same_rate
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import run_identification
from haptic_accel.materials.columns import ACCELERATION, FORCE, ColumnChoice, Wording
from haptic_accel.materials.recordings import read_columns
from haptic_accel.setup.arguments import AVERAGE_GRIP, IdentifyArguments
from haptic_accel.setup.setup import Setup


def evaluate(
    recorded: Recorded,
    setup: Setup[IdentifyArguments],
    free: Sequence[str],
    tell: Tell = lambda _: None,
) -> Result:
    """Fit a model to recordings: a three-axis model if these have three axes.

    Parameters
    ----------
    recorded : mapping
        Trials by the name of the grip.
    setup : Setup
        Excitation, and the actuator and accelerometer of the identifier.
    free : sequence of str
        Parameters of the model to fit.
    tell : callable
        Callback with the name of each of `evaluation_stages` as it begins.

    Raises
    ------
    RecordingError
        The response cannot be determined.
    ParameterError
        A handle with three axes is held with several grips.
    """
    check_stops(recorded)
    _, known = setup.node("identifier")
    sweep = setup.arguments.sweep
    actuator, sensor = known[ACTUATOR], known["accelerometer"]
    sensed = sensor.range, sensor.bandwidth
    handle = HandleParameters(
        m_a=actuator.m_a, k_s=actuator.k_s, b_s=actuator.b_s or HandleParameters.b_s
    )
    latency = next(iter(recorded.values()))[0].latency
    if _has_three_axes(recorded):
        check_one_grip(recorded)
        (trials,) = recorded.values()
        axes = three_axes.identify_three_axes(
            trials, sweep, *sensed, known=handle, free=free, tell=tell
        )
        stretched = _coil_travel(axes, actuator.travel)
        return ThreeAxisResult(axes, actuator, latency, [*stretched, *axes.doubts])
    found = identify_handle(recorded, sweep, *sensed, known=handle, free=free, tell=tell)
    # Keep the warning of each grip with the largest travel.
    travel = [
        max(check_travel(name, each, grip.fit.handle, actuator.travel) for each in grip.trials)
        for name, grip in found.grips.items()
    ]
    doubts = [*filter(None, travel), *found.doubts]
    return OneAxisResult(found, actuator, latency, doubts)


def evaluation_stages(recorded: Recorded) -> list[str]:
    """Return the names of the stages of `evaluate`, in their order."""
    return three_axes.stages() if _has_three_axes(recorded) else stages(recorded)


def check_one_grip(grips: Collection[str]) -> None:
    """Reject several grips on a handle with three axes.

    Raises
    ------
    ParameterError
        The message contains the grips.
    """
    if len(grips) > 1:
        raise ParameterError(f"grips = {', '.join(grips)}: must be one for three axes")


def _has_three_axes(recorded: Recorded) -> bool:
    return any(trial.actuator_force.ndim == 2 for trials in recorded.values() for trial in trials)


def _coil_travel(found: ThreeAxisIdentification, most: float) -> list[str]:
    """Return a warning for each coil whose estimated travel, m, comes close to its stops."""
    doubts = []
    for coil, (name, fit) in enumerate(found.fits.items()):
        alone = [
            replace(
                trial,
                actuator_force=trial.actuator_force[:, coil],
                handle_acceleration=trial.handle_acceleration[:, coil],
            )
            for trial in found.trials
        ]
        doubts.append(max(check_travel(f"axis {name}", each, fit.handle, most) for each in alone))
    return [*filter(None, doubts)]


def identified_axes(setup: Setup[IdentifyArguments]) -> Axes:
    """Return the axes of the handle that is identified."""
    return Axes.parsed(setup.values["identifier"]["axes"])


def rig_as_held(setup: Setup[IdentifyArguments]) -> RigParameters:
    """Return the simulated rig with one user's grip, for any seed of the noise."""
    master = setup.rig().master
    handle = held(master.handle, master.grip, setup.arguments.seed)
    grip = replace(master.grip, variation=0.0, posture=AVERAGE_GRIP)
    return RigParameters(replace(master, handle=handle, grip=grip))


# Recordings

MOST_MISSING = 0.01
"""Maximum share of missing samples in an evaluated trial (assumed)."""

DISTURBANCES = "interruptions", f"{AGE_OF} deadlines missed"
"""Counters in the device's diagnostics whose increase invalidates samples."""

NOTICED = 64
"""Maximum number of samples between an interruption and the increase of its counter."""

COLUMNS = {"actuator_force": FORCE, "handle_acceleration": ACCELERATION}
"""Columns of a CSV file; the default units are N and m/s^2."""


@dataclass
class Recordings:
    """Trials of an identification.

    Attributes
    ----------
    trials : dict
        Trials by the name of the grip.
    age : float
        Mean age of forces without a due time, s.
    left_out : list of RecordingError
        Errors about bags with trials that lack too many samples.
    """

    trials: dict[str, list[sweeps.IdentificationTrial]] = field(default_factory=dict)
    age: float = 0.0
    left_out: list[RecordingError] = field(default_factory=list)


def run_lockstep(setup: Setup[IdentifyArguments]) -> list[sweeps.IdentificationTrial]:
    """Run the trials of one grip in lockstep."""
    arguments = setup.arguments
    return run_identification(
        rig_as_held(setup).master,
        arguments.sweep,
        arguments.rate,
        arguments.seed,
        arguments.trials,
        arguments.latency,
    )


def named(sources: Sequence[str], grip: str) -> Iterator[tuple[str, Path]]:
    """Yield grip and path of each source: ``GRIP=PATH``, or ``PATH`` with the default grip.

    A source is a path if its part before = contains a slash, or if a file has the whole name.

    Raises
    ------
    ParameterError
        Files with both names exist.
    """
    for source in sources:
        name, separator, path = source.partition("=")
        whole = os.path.lexists(source)
        if separator and whole and os.path.lexists(path):
            raise ParameterError(
                f"from = '{source}': must be './{source}' or '{name}=./{path}': both files exist"
            )
        is_path = not separator or whole or "/" in name
        yield (grip, Path(source)) if is_path else (name, Path(path))


def read_recordings(
    paths: Iterable[tuple[str, Path]], arguments: IdentifyArguments, recording_rate: float
) -> Recordings:
    """Read trials from bags and CSV files.

    Parameters
    ----------
    paths : iterable of tuple
        Grip and path of each recording.
    arguments : IdentifyArguments
    recording_rate : float
        Sampling rate of CSV files, Hz; 0 to use their time column, or else the graph's rate.

    Raises
    ------
    ParameterError
        The recordings differ in rate or latency.
    RecordingError
        A bag is not from an identification, or no trial can be evaluated.
    """
    found = Recordings()
    ages = []
    for grip, path in paths:
        if os.path.isdir(path):
            bag = read_bag_with_warnings(path)
            trials = _trials(bag, arguments, found.left_out)
            ages.append(_force_age(bag))
        else:
            samples, rate = read_columns(
                path,
                recording_rate,
                [ColumnChoice((name,), quantity) for name, quantity in COLUMNS.items()],
                Wording("recording_rate", ""),
                arguments.rate,
            )
            force, acceleration = samples.T
            trials = sweeps.find_trials(force, acceleration, arguments.sweep, rate)
        found.trials.setdefault(grip, []).extend(trials)
    every = [trial for trials in found.trials.values() for trial in trials]
    for name, number in (
        ("rates", len({trial.rate for trial in every})),
        ("latencies", len({trial.latency for trial in every})),
    ):
        if number > 1:
            raise ParameterError(f"from: {number} {name} in the recordings: must be equal")
    found.age = fmean(ages) if ages else 0.0
    return found


def _trials(
    bag: Bag, arguments: IdentifyArguments, left_out: list[RecordingError]
) -> list[sweeps.IdentificationTrial]:
    """Return the trials of a bag, without those that lack too many samples.

    Raises
    ------
    RecordingError
        No trial is left.
    """
    force, acceleration, missing = _read_excited(bag, arguments.rate)
    sweep, rate = arguments.sweep, arguments.rate
    wave = sweeps.excitation(sweep, rate)
    if force[:, [axis for axis in range(3) if axis != ACTUATOR_AXIS]].any():
        wave = sweeps.orthogonal_excitation(sweep, rate)
    else:
        force, acceleration = force[:, ACTUATOR_AXIS], acceleration[:, ACTUATOR_AXIS]
    found = sweeps.find_trials(force, acceleration, sweep, rate, missing, bag.latency or 0, wave)
    # The device's counters do not identify the trial.
    values = _last_values(bag)
    names = sweeps.STOPS_HIT, *sweeps.LIMITED
    for trial in found:
        trial.counters.update((name, int(values.get(name, 0))) for name in names)
    most = MOST_MISSING * len(found[0].actuator_force)
    whole = [trial for trial in found if trial.counters[sweeps.SAMPLES_MISSING] <= most]
    if len(whole) < len(found):
        counts = ", ".join(str(trial.counters[sweeps.SAMPLES_MISSING]) for trial in found)
        error = RecordingError(
            f"{bag.path}: {len(found) - len(whole)} of {len(found)} trials left out, as each lacks"
            f" more than {100 * MOST_MISSING:g} % of its samples, or had them late ({counts});"
            " record again with less load on the machine, which haptic-accel doctor checks, or at"
            " a lower rate",
            {"rate": 0.5},
        )
        if not whole:
            raise error
        left_out.append(error)
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
    actuator_force, handle_acceleration : ndarray, shape (n, 3)
        N and m/s^2; each force is at the sample that caused it.
    missing : ndarray of bool, shape (n,)
        True for samples missing in the bag, which repeat the previous value, and for samples at
        interruptions or late forces of the device.

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
    (force, _), (acceleration, seen) = (
        signals[topic.name].on_grid(start, rate, length, ALL_AXES)
        for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION)
    )
    return force, acceleration, ~seen | _disturbed(bag, start, rate, length)


def _disturbed(bag: Bag, start: int, rate: float, length: int) -> BoolArray:
    """Return a mask of samples near interruptions or late forces of the device.

    The device counts both. Their exact time between two of its reports is unknown.
    """
    found = np.zeros(length, dtype=bool)
    for before, after in pairwise(x for x in bag.diagnostics if x.node == "master_device"):
        lost, late = (count(after.values, n) - count(before.values, n) for n in DISTURBANCES)
        ends = np.array([before.received - start, after.received - start]) * (rate / NANOSECONDS)
        first, end = ends.clip(0).astype(int).tolist()
        found[max(0, first - NOTICED if lost > 0 else end - late) : end] = True
    return found


def _force_age(bag: Bag) -> float:
    """Return the median age of the actuator's forces applied on arrival, s.

    The age is 0 for forces with a due time, and without diagnostics of forces.
    """
    if bag.latency:
        return 0.0
    return durations(_last_values(bag), f"{AGE_OF} age").get("p50", 0.0) * 1e-6


def _last_values(bag: Bag) -> dict[str, str]:
    """Return the last values in the master device's diagnostics; empty without any."""
    return {said.node: said.values for said in bag.diagnostics}.get("master_device", {})

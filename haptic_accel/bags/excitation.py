"""Force and acceleration of an identification, read from its bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_accel.bags.delivery import AGE_OF, durations
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.model import FloatArray
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, on_grid, places, same_rate
from haptic_accel.core.topics import ACTUATOR_AXIS


def read_excited(bag: Path, rate: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return actuator force and handle acceleration of an identification's bag.

    Parameters
    ----------
    bag : Path
        Folder written by the recorder.
    rate : float
        Samples per second of the graph.

    Returns
    -------
    actuator_force, handle_acceleration : ndarray, shape (n,)
        N and m/s^2, each force at the sample that caused it.
    missing : ndarray of bool, shape (n,)
        True for samples that are not in the bag; they have the value of the one before.

    Raises
    ------
    ParameterError
        It is not a bag.
    RecordingError
        It lacks a signal, or has another rate.
    """
    signals = read_bag(bag).signals
    for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION):
        if topic.name not in signals or len(signals[topic.name].stamps) < 2:
            raise RecordingError(f"{bag}: has no {topic.name}")
    stamps = signals[topics.HANDLE_ACCELERATION.name].stamps
    period = NANOSECONDS / rate
    found = NANOSECONDS / float(np.median(np.diff(stamps)))
    if not same_rate(found, rate):
        raise RecordingError(
            f"{bag}: {topics.HANDLE_ACCELERATION.name} has {found:.5g} samples per second, must"
            f" have rate = {rate:g} Hz"
        )
    start = int(stamps[0])
    length = round((int(stamps[-1]) - start) / period) + 1
    (force, _), (acceleration, seen) = (
        on_grid(
            places(signals[topic.name].stamps, start, rate),
            signals[topic.name].values[:, ACTUATOR_AXIS],
            length,
        )
        for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION)
    )
    return force, acceleration, ~seen


def read_force_age(bag: Path) -> float:
    """Return the median age of the actuator's forces where they were applied, s.

    0 where the bag has no diagnostics of it.

    Raises
    ------
    ParameterError
        It is not a bag.
    """
    found = [said for said in read_bag(bag).diagnostics if said.node == "master_device"]
    if not found:
        return 0.0
    return durations(found[-1].values, f"{AGE_OF} age", ("p50",)).get("p50", 0.0) * 1e-6

"""Force and acceleration of an identification, read from its bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_accel.bags.delivery import AGE_OF, durations
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.model import FloatArray
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, same_rate


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
    found = NANOSECONDS / float(np.median(np.diff(stamps)))
    if not same_rate(found, rate):
        raise RecordingError(
            f"{bag}: {topics.HANDLE_ACCELERATION.name} has {found:.5g} samples per second, must"
            f" have rate = {rate:g} Hz"
        )
    start = int(stamps[0])
    length = round((int(stamps[-1]) - start) / (NANOSECONDS / rate)) + 1
    force, _ = signals[topics.ACTUATOR_FORCE.name].on_grid(start, rate, length)
    acceleration, seen = signals[topics.HANDLE_ACCELERATION.name].on_grid(start, rate, length)
    return force, acceleration, ~seen


def read_force_age(bag: Path) -> float:
    """Return the median age of the actuator's forces where they were applied, s.

    0 where the bag has no diagnostics of it.

    Raises
    ------
    ParameterError
        It is not a bag.
    """
    reports = {said.node: said.values for said in read_bag(bag).diagnostics}
    return durations(reports.get("master_device", {}), f"{AGE_OF} age").get("p50", 0.0) * 1e-6

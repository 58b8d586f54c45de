"""Writes a trial that ran in lockstep as a bag, so that it is read and analysed as a live one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from haptic_accel.bags.definitions import connection
from haptic_accel.bags.files import BagFiles
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.trials import SIGNALS
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import along_actuator
from haptic_accel.core.trial import Trial


def write_trial(path: Path, trial: Trial, facts: Mapping[str, str]) -> None:
    """Write a trial's signals.

    There is no clock in lockstep: stamps count from one period after the origin of system time.

    Parameters
    ----------
    path : Path
        Folder to make.
    trial : Trial
    facts : mapping
        What the bag is to say of itself, text by name.

    Raises
    ------
    ParameterError
        The folder exists already, or cannot be written.
    """
    files = BagFiles(path, RecordingOptions(), facts)
    added = []
    for number, (name, topic) in enumerate(SIGNALS.items(), start=1):
        found = connection(number, f"/{topic.name}", topic.type, [])
        files.add(found)
        added.append((StampedVector(topic), found, getattr(trial, name).tolist()))
    for index in range(len(trial.time)):
        stamp = round((index + 1) * NANOSECONDS / trial.rate)
        for message, found, values in added:
            files.write(found, stamp, message.pack(stamp, along_actuator(values[index])))
    files.close()
    if files.failure:
        raise ParameterError(f"{path}: cannot be written: {files.failure}")

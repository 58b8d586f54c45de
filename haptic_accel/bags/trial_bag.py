"""Writes a trial that ran in lockstep as a bag, so that it is read and analysed as a live one."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.definitions import connection
from haptic_accel.bags.files import BagFiles
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.trials import SIGNALS
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import VECTORS, Topic
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
        added.append((topic, found, getattr(trial, name).tolist()))
    for index in range(len(trial.time)):
        stamp = round((index + 1) * NANOSECONDS / trial.rate)
        for topic, found, values in added:
            files.write(found, stamp, stamped_message(topic, stamp, (0.0, 0.0, values[index])))
    files.close()
    if files.failure:
        raise ParameterError(f"{path}: cannot be written: {files.failure}")


def stamped_message(topic: Topic, stamp: int, vector: Vector) -> bytes:
    """Return a signal's message, serialised, with a stamp in ns."""
    inner, field = VECTORS[topic.type].split(".")
    if field == "position":
        upright = _made("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        parts = (_made("geometry_msgs/msg/Point", *vector), upright)
    else:
        none = _made("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        parts = (_made("geometry_msgs/msg/Vector3", *vector), none)
    body = _made(f"geometry_msgs/msg/{inner.capitalize()}", *parts)
    time = _made("builtin_interfaces/msg/Time", *divmod(stamp, NANOSECONDS))
    header = _made("std_msgs/msg/Header", time, topic.frame)
    message = _made(topic.type, header, body)
    return bytes(_types().serialize_cdr(message, topic.type))


def _made(kind: str, *fields: Any) -> Any:
    return _types().types[kind](*fields)


@cache
def _types() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writer of bags from lockstep trials, readable like live bags."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from haptic_accel.bags.metadata import connection
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.trial_metadata import PARAMETERS, description, read_custom_data
from haptic_accel.bags.writing import BagFiles
from haptic_accel.core import topics
from haptic_accel.core.cdr import StampedVector, pack_text
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import Topic
from haptic_accel.core.trial import Trial

_TOPICS = (*topics.SIGNALS, topics.CONTACT_FORCE)

_FIELDS = ("tool_acceleration", "desired_acceleration", "handle_acceleration", "actuator_force")
"""Fields of a trial for the topics `ANALYSED`, in the same order."""


def trial_vectors(trial: Trial) -> dict[Topic, FloatArray]:
    """Return a trial's signals by topic, shape (n, 3) each; `SIGNALS` come first."""
    found = dict(trial.arms)
    for topic, name in zip(topics.ANALYSED, _FIELDS, strict=True):
        found[topic.name] = np.zeros((len(trial.time), 3))
        found[topic.name][:, trial.axes.indices] = np.c_[getattr(trial, name)]
    return {topic: found[topic.name] for topic in _TOPICS if topic.name in found}


def write_trial(path: Path, trial: Trial, custom: Mapping[str, str], start: int) -> None:
    """Write a trial's signals.

    Parameters
    ----------
    path : Path
        Folder to create.
    trial : Trial
    custom : mapping
        Metadata, text by name.
    start : int
        Stamp of the first sample, system time in ns; samples are one period apart.

    Raises
    ------
    ParameterError
        The folder exists already, or cannot be written.
    """
    files = BagFiles(path, RecordingOptions(), custom)
    if stated := read_custom_data(custom):  # other programs copy messages, not metadata
        described = connection(1, f"/{topics.DESCRIPTION.name}", topics.DESCRIPTION.type, [])
        files.add(described)
        files.write(described, start, pack_text(json.dumps({PARAMETERS: {}} | stated)))
        if trial.failed is not None:
            changed = description("compensator", {"controller": "none"})
            files.write(described, start + round(trial.failed * NANOSECONDS), pack_text(changed))
    added = []
    for number, (topic, vectors) in enumerate(trial_vectors(trial).items(), start=2):
        found = connection(number, f"/{topic.name}", topic.type, [])
        files.add(found)
        added.append((found, StampedVector(topic), vectors.tolist()))
    for index in range(len(trial.time)):
        stamp = start + round(index * NANOSECONDS / trial.rate)
        for found, message, rows in added:
            files.write(found, stamp, message.pack(stamp, rows[index]))
    files.close()
    if files.failure:
        raise ParameterError(f"{path}: cannot be written: {files.failure}")

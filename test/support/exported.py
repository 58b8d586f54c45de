# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of lockstep trials for exports, and what other programs read of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_accel import run_trial
from haptic_accel.bags.trial_metadata import custom_data, json_text
from haptic_accel.bags.writing import trial_vectors, write_trial
from haptic_accel.core.model import FloatArray
from haptic_accel.core.trial import Trial

START = 1_700_000_000_000_000_000
"""Stamp of the first sample, ns."""

NAMES = {
    "master/measured_cp": "master_position",
    "master/measured_cv": "master_velocity",
    "slave/measured_cp": "slave_position",
    "slave/measured_cv": "slave_velocity",
    "slave/tool/acceleration": "tool_acceleration",
    "master/handle/acceleration": "handle_acceleration",
    "compensator/desired_acceleration": "desired_acceleration",
    "master/handle/servo_cf": "actuator_force",
    "master/servo_cf": "master_arm_force",
    "slave/servo_cf": "slave_arm_force",
}
"""Names of exported signals by topic."""


class Recorded(NamedTuple):
    """Bag, and the trial that it has."""

    path: Path
    trial: Trial


def write_bag(path: Path, rig: str = "paper", surface: str = "plywood", **more: Any) -> Trial:
    """Write a bag of a trial, three seconds long, and return the trial."""
    trial = run_trial("dynamic", rig=rig, surface=surface, **{"duration": 3.0} | more)
    arguments = {"surface": surface, "slave": "simulated", "rate": trial.rate, "rig": rig}
    arguments["controller"] = "dynamic"
    write_trial(path, trial, custom_data(json_text(arguments, {})), START)
    return trial


def vectors(trial: Trial) -> dict[str, FloatArray]:
    """Return the signals of a trial by their exported name, shape (n, 3)."""
    found = trial_vectors(trial).items()
    return {NAMES[topic.name]: values for topic, values in found if topic.name in NAMES}


def stamps(trial: Trial) -> FloatArray:
    """Return the stamps of a trial's samples, ns."""
    return START + np.round(np.arange(len(trial.time)) * 1e9 / trial.rate).astype(np.int64)

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded tool accelerations made by us: the simulated tool dragged over a surface."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from haptic_accel.core.trial import run_trial
from haptic_accel.graph.arguments import GraphArguments
from haptic_accel.graph.processes import graph_parameters, rig_parameters

RATE = 10_000
"""Sampling rate of the recordings, Hz."""

SECONDS = 1.9
SETTLED = 0.5
"""Time after which the tool drags over the surface, s."""


@cache
def dragged_over(surface: str) -> np.ndarray:
    """Return the acceleration of a tool on a surface, m/s^2."""
    rig = rig_parameters(graph_parameters(GraphArguments(surface=surface)))
    trial = run_trial("none", rig, duration=SETTLED + SECONDS, rate=RATE)
    return trial.tool_acceleration[round(SETTLED * RATE) :]


def write_recording(path: Path, surface: str) -> Path:
    """Write a CSV file with several columns, as laboratories have them; return its path."""
    acceleration = dragged_over(surface)
    columns = {
        "speed": np.full(len(acceleration), 192.6),
        "force": np.full(len(acceleration), 1.73),
        "accel": acceleration,
        "friction": np.full(len(acceleration), 0.32),
    }
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path

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
"""What a handle with three coils gains over one coil, in lockstep.

``python benchmarks/three_axes.py`` prints, for both rigs with three coils on the paper's surfaces,
the error of the vector, the median error of its direction, and the share that a hand could not
tell, beside the bound of any causal linear controller. With one coil, the same handle moves by the
coil along z only, whose signal is one of the live reductions of the tool's three axes.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_accel.core.control.building import matrix_plant
from haptic_accel.core.control.filters import comparable, high_passed
from haptic_accel.core.control.inversion.matrix_bound import matrix_bounds
from haptic_accel.core.evaluation.discrimination import indistinguishable
from haptic_accel.core.evaluation.metrics import align, direction_error, evaluate
from haptic_accel.core.model import FloatArray
from haptic_accel.core.trial import Trial
from haptic_accel.graph.arguments import SURFACES, GraphArguments
from haptic_accel.graph.files import read_parameter_file
from haptic_accel.graph.lockstep import lockstep_trial
from haptic_accel.graph.node_parameters import node_parameters
from haptic_accel.graph.processes import graph_parameters, rig_parameters
from haptic_accel.materials.folders import preset_file

SECONDS = 10.0
BEGIN = 2.0
"""Time without contact, and of first learning, that is left out, s."""

STATIC = {"decoupling": "static"}
ONE_COIL = {"axes": "z", "plant.model": ""}
"""A coil along z; its plant is that of the rig with one coil and the same imperfections."""

LIKE = {"three_axis_ideal": "ideal", "three_axis": "paper"}
"""Rigs with one coil and the same imperfections."""

CONDITIONS: dict[str, tuple[str, Mapping[str, Any]]] = {
    "none": ("none", {}),
    "one coil: axis": ("inverse", ONE_COIL),
    "one coil: sum": ("inverse", ONE_COIL | {"reduction": "sum"}),
    "one coil: principal": ("inverse", ONE_COIL | {"reduction": "principal"}),
    "three coils: constant": ("constant", {}),
    "three coils: inverse, static": ("inverse", STATIC),
    "three coils: inverse": ("inverse", {}),
    "three coils: feedback": ("feedback", {}),
    "three coils: adaptive": ("adaptive", {}),
}
"""Controller and parameters of the compensator, by condition."""


class Row(NamedTuple):
    """Result of a condition: error and bound, %, angle, degrees, indistinguishable share, %."""

    error: float
    bound: float
    angle: float
    share: float


def compared(trial: Trial) -> tuple[FloatArray, FloatArray]:
    """Return the tool's vibration in all axes and the handle's, aligned."""
    corner, rate = trial.high_pass_frequency, trial.rate
    desired = high_passed(trial.tool_acceleration, corner, rate)
    desired, actual = comparable(desired, trial.handle_acceleration, corner, rate)
    first = round(BEGIN * rate)
    return align(desired[first:], actual[first:], trial.after)


def run(rig: str, surface: str, condition: str) -> tuple[Trial, Row]:
    """Run one condition in lockstep."""
    controller, changes = CONDITIONS[condition]
    arguments = GraphArguments(
        rig=rig, surface=surface, controller=controller, duration=SECONDS, record=False
    )
    alike = read_parameter_file(preset_file("rig", LIKE[rig]))["compensator"]
    own = alike | dict(changes) if "axes" in changes else changes
    trial = lockstep_trial(arguments, changes={"compensator": own})
    desired, actual = compared(trial)
    row = Row(
        evaluate(desired, actual, trial.rate, 0.0).nrmse_percent,
        bound(arguments, trial),
        direction_error(desired, actual),
        100.0 * indistinguishable(desired, actual, trial.rate),
    )
    return trial, row


def bound(arguments: GraphArguments, trial: Trial) -> float:
    """Return the least error of any causal linear controller within the coils' limits, %."""
    values = graph_parameters(arguments)
    _, options = node_parameters("compensator", values["compensator"])
    master = rig_parameters(values).master
    return matrix_bounds(
        matrix_plant(options, trial.rate).coupled().delayed(trial.latency),
        trial.rate,
        trial.tool_acceleration[round(BEGIN * trial.rate) :],
        granted_delay=trial.after,
        noise=master.accelerometer.noise,
        actuator=master.actuator,
    ).limited


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--rigs", nargs="+", default=tuple(LIKE))
    parser.add_argument("--surfaces", nargs="+", default=SURFACES)
    given = parser.parse_args()
    print("mean over the surfaces: error %, its bound %, direction degrees, not told apart %")
    for rig in given.rigs:
        for condition in CONDITIONS:
            rows = [run(rig, surface, condition)[1] for surface in given.surfaces]
            values = " ".join(f"{value:7.2f}" for value in np.mean(rows, axis=0))
            print(f"{Path(rig).stem:18} {condition:30} {values}", flush=True)


if __name__ == "__main__":
    main()

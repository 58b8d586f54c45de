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

"""``haptic-accel bench network``: energy, stability and error of the coupling over networks."""

from __future__ import annotations

from pathlib import Path

from haptic_accel.analysis import network as study
from haptic_accel.cli.options import json_option, verb, workers_options
from haptic_accel.cli.output import save
from haptic_accel.cli.studies import beside, run_side_by_side
from haptic_accel.cli.tables import print_table
from haptic_accel.cli.workers import Workers
from haptic_accel.core.tables import ResultTable


@verb("haptic-accel bench network", "haptic-accel bench network --json network.json")
@workers_options
@json_option
def network(*, workers: Workers, json_file: Path | None) -> None:
    """Measure the coupling of two hosts over simulated networks, in lockstep.

    Two arms of 0.1 kg, a hand at the master, and at the slave a wall of 3 kN/m or nothing: net
    energy that the motors gave, speed at the end with the hand at rest, and error between the arms
    at 100 mm/s; error of the vibration at its own delay, and the share whose strength a hand could
    not tell. Then random networks, hands and walls: the most energy relative to what the coupling
    is granted.
    """
    items = [*study.CONDITIONS, *range(study.TRIALS)]
    found, end = run_side_by_side(
        workers, study.measure, items, "conditions", study.progress, beside(json_file)
    )
    worst = [result for result in found.values() if isinstance(result, float)]
    rows = [result for result in found.values() if not isinstance(result, float)]
    print_table(ResultTable.of(study.COLUMNS, rows, title="two arms on two hosts"))
    if worst:
        print(f"{len(worst)} random networks: at most {max(worst):.2f} of the energy granted")
    most = max(worst, default=None)
    save({"trials": len(worst), "worst_energy_over_bound": most, "rows": rows}, json_file)
    if end:
        raise end

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

"""Checks of the actuator's travel in a recording, as its stops change the dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from haptic_accel.core.identification.estimate import SMALLER, RecordingError
from haptic_accel.core.identification.sweep import IdentificationTrial
from haptic_accel.core.model import Suspension
from haptic_accel.core.tick import TravelEstimator

STOPS_HIT = "travel_stops_hit"
"""Status entry of a trial: number of contacts with a stop, if known."""

LIMITED = tuple(f"actuator force limited{by}" for by in ("", " by heat", " by travel"))
"""Entries in a trial's counters and a device's diagnostics: number of forces reduced by the safety
layer. The applied force then differs from the command."""

DOUBTFUL, REFUSED = 0.95, 1.1
"""Ratios of estimated to free travel above which a fit is doubtful, or rejected. The estimate
neglects dry friction and the sensor's offset (assumed: 10 %)."""

Recorded = Mapping[str, Sequence[IdentificationTrial]]
"""Trials by the name of the grip."""


def check_stops(recorded: Recorded) -> None:
    """Reject trials in which the actuator hit its stops or its force was limited.

    Raises
    ------
    RecordingError
        The message names the grip.
    """
    for name, trials in recorded.items():
        for key in (STOPS_HIT, *LIMITED):
            if count := max(trial.counters.get(key, 0) for trial in trials):
                raise RecordingError(
                    f"{key} = {count} ({name}): must be 0; use a smaller amplitude", SMALLER
                )


def check_travel(
    name: str, trial: IdentificationTrial, suspension: Suspension, most: float
) -> str:
    """Estimate the actuator's travel in a trial; return a reason for doubt, or an empty string.

    Parameters
    ----------
    name : str
        Name of the grip.
    trial : IdentificationTrial
        Trial without latency; the acceleration includes gravity.
    suspension : Suspension
        Actuator on its fitted suspension. Contacts with the stops make it look more mobile.
    most : float
        Free travel either way, m.

    Raises
    ------
    RecordingError
        The estimate exceeds the travel by more than its error.
    """
    estimator = TravelEstimator(suspension, trial.rate)
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    travel = max(abs(estimator.observe(*pair)) for pair in pairs)
    found = f"travel = {1e3 * travel:.2f} mm ({name}), as estimated"
    allowed = f"must be at most {1e3 * most:.2f} mm; use a smaller amplitude"
    if travel > REFUSED * most:
        raise RecordingError(f"{found}: {allowed}", SMALLER)
    return f"{found}: {allowed}" if travel > DOUBTFUL * most else ""

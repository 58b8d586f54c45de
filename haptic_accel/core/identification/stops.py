# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Travel of the actuator in a recording: at its stops the handle is another one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.sweep import IdentificationTrial
from haptic_accel.core.model import Suspension

STOPS_HIT = "travel_stops_hit"
"""Name in a trial's status of the number of times that a stop was hit, where that is known."""

LIMITED = tuple(f"actuator force limited{by}" for by in ("", " by heat", " by travel"))
"""Names, there and in a device's diagnostics, of the numbers of forces that its safety layer
reduced: what was applied is then not what was commanded."""

DOUBTFUL, REFUSED = 0.95, 1.1
"""Shares of the travel from which its estimate is a reason to doubt a fit, and to refuse it: it
knows neither dry friction nor the sensor's offset (assumed: 10 %)."""

Recorded = Mapping[str, Sequence[IdentificationTrial]]
"""Trials by the name of the grip."""


def check_stops(recorded: Recorded) -> None:
    """Refuse trials in which the actuator hit its stops or its force was limited, as is known.

    Raises
    ------
    RecordingError
        Naming the grip.
    """
    for name, trials in recorded.items():
        for key in (STOPS_HIT, *LIMITED):
            if count := max(trial.status.get(key, 0) for trial in trials):
                raise RecordingError(
                    f"{key} = {count} ({name}): must be 0; use a smaller amplitude"
                )


def check_travel(
    name: str, trial: IdentificationTrial, suspension: Suspension, most: float
) -> str:
    """Estimate the actuator's travel in a trial; return a reason to doubt a fit, or nothing.

    Parameters
    ----------
    name : str
        Name of the grip.
    trial : IdentificationTrial
        Trial without latency; the acceleration includes gravity.
    suspension : Suspension
        Actuator on its suspension as fitted: stops that were hit make it look the more mobile.
    most : float
        Free travel either way, m.

    Raises
    ------
    RecordingError
        The estimate is so far beyond the travel that it cannot be wrong alone.
    """
    estimator = TravelEstimator(suspension, trial.rate)
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    travel = max(abs(estimator.sample(*pair)) for pair in pairs)
    found = f"travel = {1e3 * travel:.2f} mm ({name}), as estimated"
    allowed = f"must be at most {1e3 * most:.2f} mm; use a smaller amplitude"
    if travel > REFUSED * most:
        raise RecordingError(f"{found}: {allowed}")
    return f"{found}: {allowed}" if travel > DOUBTFUL * most else ""

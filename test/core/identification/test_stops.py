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

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.stops import LIMITED, STOPS_HIT, check_stops, check_travel
from haptic_accel.core.identification.sweep import IdentificationTrial, SweepParameters
from haptic_accel.core.model import Suspension
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.simulated_identification import run_identification

RATE = 1000.0
RIG = MasterRigParameters()
TRAVEL = RIG.actuator.travel


def recorded(amplitude: float) -> IdentificationTrial:
    sweep = SweepParameters(duration=1.0, start_amplitude=amplitude)
    return run_identification(RIG, sweep, RATE, latency=0)[0]


def test_stops_that_were_hit_are_refused_and_estimated() -> None:
    gentle, hard = recorded(0.3), recorded(1.5)
    check_stops({"pinch": [gentle]})
    assert check_travel("pinch", gentle, RIG.handle, TRAVEL) == ""
    with pytest.raises(RecordingError, match=r"travel_stops_hit = \d+ \(hook\): must be 0"):
        check_stops({"pinch": [gentle], "hook": [gentle, hard]})
    # A real device does not count them.
    unknown = replace(hard, counters={})
    assert STOPS_HIT in hard.counters
    check_stops({"hook": [unknown]})
    with pytest.raises(RecordingError, match=r"travel = .* mm \(hook\), as estimated: must be"):
        check_travel("hook", unknown, RIG.handle, TRAVEL)


@pytest.mark.parametrize("count", LIMITED)
def test_forces_that_the_device_reduced_are_refused(count: str) -> None:
    trial = IdentificationTrial(RATE, np.zeros(10), np.zeros(10), {count: 3})
    with pytest.raises(RecordingError, match=rf"{count} = 3 \(hook\): must be 0"):
        check_stops({"hook": [trial]})


@given(st.floats(0.1, 2.0))
def test_a_constant_force_travels_by_what_the_spring_gives(share: float) -> None:
    suspension = Suspension()
    force = np.full(2000, share * TRAVEL * suspension.k_s)
    # From rest it swings beyond: damping ratio 0.46.
    ratio = suspension.b_s / (2 * np.sqrt(suspension.k_s * suspension.m_a))
    overshoot = 1 + np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))
    trial = IdentificationTrial(RATE, force, np.zeros(2000), {})
    reached = share * overshoot
    if reached > 1.11:
        with pytest.raises(RecordingError, match="smaller amplitude"):
            check_travel("average", trial, suspension, TRAVEL)
    elif not reached > 1.09 and not 0.945 < reached < 0.955:
        doubt = check_travel("average", trial, suspension, TRAVEL)
        assert bool(doubt) == (reached > 0.95)

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

import math

import numpy as np
import pytest

from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.identification.sweep import SweepParameters, excitation
from haptic_accel.core.model import AccelerometerParameters, GripParameters, Suspension
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.exploration import ExplorationParameters
from haptic_accel.core.rig.master_rig import MasterRig, MasterRigParameters


def test_a_constant_force_stretches_the_spring() -> None:
    estimator = TravelEstimator(Suspension(k_s=200.0), 1000.0)
    for _ in range(2000):
        travel = estimator.observe(0.3, 0.0)
    assert travel == pytest.approx(-0.3 / 200.0)
    estimator.reset()
    assert estimator.travel == 0.0


def test_gravity_that_the_accelerometer_feels_makes_it_sag() -> None:
    suspension = Suspension()
    estimator = TravelEstimator(suspension, 1000.0)
    for _ in range(2000):
        estimator.observe(0.0, 9.81)
    assert estimator.travel == pytest.approx(-suspension.m_a * 9.81 / suspension.k_s)


@pytest.mark.parametrize("rate", [500.0, 1000.0, 4000.0])
def test_a_free_mass_rings_at_its_frequency_and_fades_with_its_damping(rate: float) -> None:
    suspension = Suspension(b_s=0.2)
    m_a, k_s, b_s = suspension.m_a, suspension.k_s, suspension.b_s
    estimator = TravelEstimator(suspension, rate)
    # After a blow of one sample: d(t) = v / w * exp(-b t / 2 m) * sin(w t).
    estimator.observe(-1.0, 0.0)
    found = np.array([estimator.observe(0.0, 0.0) for _ in range(round(0.3 * rate))])
    damped = math.sqrt(k_s / m_a - (b_s / (2 * m_a)) ** 2)
    crossings = np.flatnonzero(np.diff(np.sign(found)))
    assert len(crossings) == pytest.approx(0.3 * damped / math.pi, abs=1)
    turn = round(2 * math.pi / damped * rate)
    at = int(np.argmax(np.abs(found)))
    assert found[at + turn] / found[at] == pytest.approx(
        math.exp(-b_s * turn / rate / (2 * m_a)), rel=0.05
    )


def test_it_follows_the_simulated_actuator_through_the_sweep() -> None:
    rig = MasterRigParameters(
        grip=GripParameters(gravity=6.9),
        accelerometer=AccelerometerParameters(bandwidth=100e3, noise_density=0.0, bits=32),
        exploration=ExplorationParameters(press_depth=0.0),
    )
    rate = 1000.0
    master = MasterRig(rig, rate)
    estimator = TravelEstimator(Suspension(), rate)
    true, found = [], []
    applied = 0.0
    for index, force in enumerate(excitation(SweepParameters(), rate).tolist()):
        master.advance(index / rate)
        found.append(estimator.observe(applied, master.measure().acceleration[ACTUATOR_AXIS]))
        true.append(master.travel)
        master.apply_actuator_force(along_actuator(force))
        applied = force
    settled = slice(round(0.3 * rate), None)  # the estimate starts in the middle
    error = np.array(found)[settled] - np.array(true)[settled]
    # A sample of acceleration stands for the period before it, half a period late.
    assert np.abs(error).max() < 0.05 * np.abs(true).max()


def test_a_rate_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match="rate = 0"):
        TravelEstimator(Suspension(), 0.0)

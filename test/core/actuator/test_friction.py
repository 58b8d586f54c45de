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
from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.actuator.friction import SLIP_VELOCITY, FrictionCompensation
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import HandleParameters
from haptic_accel.core.rig.master_rig import DriveParameters
from haptic_accel.core.trial import RigParameters, run_trial

RATE = 1000.0
HANDLE = HandleParameters()


def test_without_friction_it_gives_nothing() -> None:
    compensation = FrictionCompensation(HANDLE, 0.0, RATE)
    assert [compensation.force(f, 1.0) for f in (1.0, -3.0, 0.5)] == [0.0] * 3


def test_it_pushes_the_way_the_actuator_slips() -> None:
    friction, frequency, force = 0.05, 100.0, 0.5
    compensation = FrictionCompensation(HANDLE, friction, RATE)
    omega = 2 * math.pi * frequency
    given = []
    for index in range(2000):
        given.append(compensation.force(force * math.sin(omega * index / RATE), 0.0))
    late = np.array(given[1000:])
    # By eq. (1) with the handle at rest, its amplitude of slip is F w / |k_s - m_a w^2 + i b_s w|.
    slip = force * omega / abs(HANDLE.k_s - HANDLE.m_a * omega**2 + 1j * HANDLE.b_s * omega)
    assert slip > 10 * SLIP_VELOCITY
    assert np.abs(late).max() == pytest.approx(friction, rel=0.01)
    # Above its resonance a mass moves against its spring: f_a pulls it to the handle, so that its
    # speed lags the force by more than a quarter turn, and what helps it leads by less.
    spectrum = np.fft.rfft(late)[round(frequency * len(late) / RATE)]
    driven = np.fft.rfft([force * math.sin(omega * i / RATE) for i in range(1000, 2000)])
    phase = np.angle(spectrum / driven[round(frequency * len(late) / RATE)])
    mechanics = 1j * omega / (HANDLE.k_s - HANDLE.m_a * omega**2 + 1j * HANDLE.b_s * omega)
    # The middle of the sample that the force is held for.
    expected = np.angle(mechanics)
    assert math.remainder(float(phase - expected), 2 * math.pi) == pytest.approx(0.0, abs=0.2)


def test_a_handle_that_lags_slips_when_it_does_as_desired() -> None:
    desired = np.random.default_rng(0).normal(0.0, 5.0, 60)
    before = np.concatenate([np.zeros(3), desired])
    late = (before[:-3] + before[1:-2]) / 2  # two and a half samples
    told = FrictionCompensation(HANDLE, 0.05, RATE, lag=2.5)
    shown = FrictionCompensation(HANDLE, 0.05, RATE)
    for wanted, moved in zip(desired.tolist(), late.tolist(), strict=True):
        assert told.force(0.2, wanted) == pytest.approx(shown.force(0.2, moved))


def test_at_rest_it_gives_next_to_nothing() -> None:
    compensation = FrictionCompensation(HANDLE, 0.05, RATE)
    random = np.random.default_rng(0)
    # Noise of the tool's accelerometer, and the force that it makes.
    given = [compensation.force(0.01 * a, a) for a in random.normal(0, 0.07, 1000).tolist()]
    assert np.abs(given).max() < 0.05 / 3


@pytest.mark.parametrize("controller", ["inverse", "adaptive"])
@pytest.mark.slow
def test_on_a_rig_with_friction_it_takes_most_of_the_error_that_friction_makes(
    controller: str,
) -> None:
    rig = RigParameters()
    dry = replace(rig.master, drive=DriveParameters(coulomb_friction=0.05, bits=32))
    from scipy import signal

    white = np.random.default_rng(1).normal(0.0, 3.0, 4000)
    band = signal.butter(2, (60.0, 160.0), "bandpass", fs=RATE, output="sos")
    texture = np.asarray(signal.sosfilt(band, white))

    def error(master: object, friction: float) -> float:
        trial = run_trial(
            controller,
            replace(rig, master=master),  # type: ignore[arg-type]
            duration=4.0,
            recording=texture,
            controllers={"plant": Plant(friction=friction)},
        )
        return trial.evaluate(2000).nrmse_percent

    without, ignored, given = error(rig.master, 0.0), error(dry, 0.0), error(dry, 0.05)
    assert without < given < ignored
    assert given - without < 0.6 * (ignored - without)


def test_reset_forgets_the_slip() -> None:
    used, fresh = (FrictionCompensation(HANDLE, 0.05, RATE) for _ in range(2))
    used.force(3.0, 5.0)
    used.reset()
    assert used.force(0.1, 0.0) == fresh.force(0.1, 0.0)

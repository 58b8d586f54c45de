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

import pytest

from haptic_accel.core.arm_work import KEPT, ArmWork
from haptic_accel.core.model import ZERO, Vector

PERIOD = 1e-3


def along_x(value: float) -> Vector:
    return (value, 0.0, 0.0)


def test_the_work_on_a_body_is_its_kinetic_energy() -> None:
    mass, position, velocity = 0.1, 0.0, 0.0
    work = ArmWork()
    for tick in range(1000):
        done = work.until(tick * PERIOD, along_x(position))
        assert done == pytest.approx(along_x(mass * velocity**2 / 2), abs=1e-12)
        force = math.sin(0.1 * tick)
        work.apply(tick * PERIOD, along_x(force))
        position += velocity * PERIOD + force / mass * PERIOD**2 / 2
        velocity += force / mass * PERIOD


def test_a_late_force_counts_for_what_is_left_of_the_period() -> None:
    work = ArmWork()
    work.until(0.0, ZERO)
    work.apply(0.0, (1.0, 2.0, 0.0))
    work.apply(0.75 * PERIOD, (5.0, 0.0, 4.0))
    assert work.until(PERIOD, (8.0, 4.0, -1.0)) == pytest.approx((16.0, 6.0, -1.0))
    assert work.until(2 * PERIOD, (9.0, 4.0, -1.0)) == pytest.approx((21.0, 6.0, -1.0))


def test_a_sample_may_be_read_after_the_next_forces() -> None:
    work = ArmWork()
    work.until(0.0, ZERO)
    work.apply(0.0, along_x(1.0))
    work.apply(PERIOD, along_x(2.0))
    assert work.until(PERIOD, along_x(1.0)) == along_x(1.0)
    assert work.until(2 * PERIOD, along_x(2.0)) == along_x(3.0)


def test_a_lost_sample_divides_the_way_by_time() -> None:
    work = ArmWork()
    work.until(0.0, ZERO)
    for tick, force in enumerate((1.0, 2.0)):
        work.apply(tick * PERIOD, along_x(force))
    work.until(PERIOD, along_x(math.nan))
    assert work.until(2 * PERIOD, along_x(2.0)) == pytest.approx(along_x(3.0))


def test_forces_without_samples_take_no_memory_without_end() -> None:
    work = ArmWork()
    work.until(0.0, ZERO)
    for tick in range(3 * KEPT):
        work.apply(tick * PERIOD, along_x(1.0))
    kept_of_the_way = work.until(3 * KEPT * PERIOD, along_x(3.0))
    assert kept_of_the_way == pytest.approx(along_x(1.0))

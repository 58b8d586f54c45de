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
import random

import pytest

from haptic_accel.core.network.clock import ClockOffset

SECOND = 1_000_000_000


def run(
    clock: ClockOffset,
    seconds: int,
    offset: float = 0.0,
    drift: float = 0.0,
    away: float = 0.02,
    back: float = 0.02,
    jitter: float = 0.0,
    start: int = 0,
) -> int:
    """Exchange 50 packets a second between two clocks; return the own time at the end, ns."""
    chance = random.Random(2)
    now = start
    for step in range(50 * seconds):
        now = start + step * SECOND // 50
        there = round(now + SECOND * (away + jitter * chance.random()))
        peer = there + round(SECOND * offset + drift * there)
        arrived = round(there + SECOND * (1e-3 + back + jitter * chance.random()))
        clock.add(now, peer, peer + SECOND // 1000, arrived)
    return now


def test_nothing_is_known_before_an_exchange() -> None:
    clock = ClockOffset()
    assert (clock.offset(5), clock.bound) == (0.0, math.inf)


@pytest.mark.parametrize("offset", [-3.0, 0.0, 1234.5])
def test_equal_ways_give_the_offset_and_half_a_round_trip_is_its_bound(offset: float) -> None:
    clock = ClockOffset()
    now = run(clock, 5, offset)
    assert clock.offset(now) == pytest.approx(offset, abs=1e-8)
    assert clock.bound == pytest.approx(0.02, abs=1e-8)


def test_unequal_ways_err_by_half_their_difference_and_within_the_bound() -> None:
    clock = ClockOffset()
    now = run(clock, 30, away=0.03, back=0.01)
    assert clock.offset(now) == pytest.approx(0.01, abs=1e-6)
    assert abs(clock.offset(now)) <= clock.bound


@pytest.mark.parametrize("held_up", [0.03, 0.3])
def test_what_holds_up_one_way_for_seconds_stays_within_the_bound(held_up: float) -> None:
    clock = ClockOffset()
    now = 0
    for second in range(20):
        now = run(clock, 1, back=0.02 + held_up * (second > 14), start=second * SECOND)
    assert abs(clock.offset(now)) <= clock.bound
    assert clock.bound < 0.06


def test_jitter_is_left_out() -> None:
    clock = ClockOffset()
    now = run(clock, 60, offset=0.5, jitter=0.02)
    assert clock.offset(now) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_drift_is_followed(drift: float) -> None:
    clock = ClockOffset()
    now = run(clock, 100, drift=drift)
    assert clock.drift == pytest.approx(drift, rel=0.02)
    ahead = now + 10 * SECOND
    assert clock.offset(ahead) == pytest.approx(drift * ahead / SECOND, abs=1e-4)


def test_a_clock_that_is_set_is_measured_anew() -> None:
    clock = ClockOffset()
    now = run(clock, 60, offset=0.0)
    now = run(clock, 4, offset=1.0, start=now)
    assert clock.offset(now) == pytest.approx(1.0, abs=1e-6)


def test_an_exchange_during_which_a_clock_was_set_back_counts_for_nothing() -> None:
    clock = ClockOffset()
    clock.add(SECOND, SECOND, SECOND, SECOND // 2)
    clock.add(SECOND, SECOND, SECOND // 2, 2 * SECOND)
    assert clock.bound == math.inf

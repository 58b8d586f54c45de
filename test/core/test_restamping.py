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

"""Stamps of a playback, moved to now."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.restamping import LEAD, LISTENING, StampShift

PERIOD = 1_000_000
LIMIT = 100 * PERIOD
AHEAD = LEAD + 2 * PERIOD
THEN, NOW = 1_255_392_000_123_000_000, 1_795_000_000_000_000_000
FIRST = LISTENING // PERIOD
"""Samples that are only listened to, where none is held up."""


def shift() -> StampShift:
    return StampShift(lambda moment: -(-moment // PERIOD) * PERIOD, PERIOD, LIMIT)


@given(st.lists(st.integers(0, LIMIT - PERIOD), min_size=400, max_size=400))
def test_spacing_stays_exactly_what_it_was_however_messages_arrive(delays: list[int]) -> None:
    delays[7::50] = [0] * len(delays[7::50])  # some come through at once
    shifted = shift()
    differences = set()
    for place, delay in enumerate(delays):
        stamp = THEN + place * PERIOD + place % 7
        arrival = NOW + 250_000 + stamp - THEN + delay
        moved = shifted.moved(stamp, arrival)
        if moved is not None:
            differences.add(moved - stamp)
            assert -AHEAD <= arrival - moved <= LIMIT
    assert len(differences) <= 1
    assert shifted.anchored == len(differences)


def test_moved_stamps_lie_on_the_grid_and_leave_time_for_a_player_that_pauses() -> None:
    shifted = shift()
    for place in range(1000):
        arrival = NOW + place * PERIOD + 250_000
        moved = shifted.moved(THEN + place * PERIOD, arrival)
        assert (moved is None) == (place < FIRST)
        if moved is not None:
            assert moved % PERIOD == 0
            assert moved - arrival == LEAD + 750_000


@given(st.integers(0, PERIOD - 1), st.lists(st.integers(0, LEAD), min_size=400, max_size=400))
def test_samples_that_are_held_up_for_less_are_there_at_their_tick(
    phase: int, delays: list[int]
) -> None:
    delays[7] = 0  # one of the first comes through at once
    shifted = shift()
    for place, delay in enumerate(delays):
        arrival = NOW + place * PERIOD + phase + delay
        moved = shifted.moved(THEN + place * PERIOD, arrival)
        assert moved is None or moved >= arrival
    assert shifted.anchored <= 1


def test_what_was_held_up_all_the_time_that_it_listened_is_mended() -> None:
    shifted = shift()
    for place in range(1000):
        held_up = 30 * PERIOD if place < 2 * FIRST else 0
        arrival = NOW + place * PERIOD + held_up
        moved = shifted.moved(THEN + place * PERIOD, arrival)
    assert moved == arrival + LEAD
    assert shifted.anchored == 2


def test_a_player_that_stays_behind_is_followed_after_a_moment() -> None:
    shifted = shift()
    for place in range(1000):
        behind = 2 * LEAD if place >= 500 else 0
        arrival = NOW + place * PERIOD + behind
        moved = shifted.moved(THEN + place * PERIOD, arrival)
        if moved is not None and not 500 <= place <= 500 + FIRST:
            assert moved == arrival + LEAD
    assert shifted.anchored == 2


def test_a_loop_is_taken_for_fresh_samples_again() -> None:
    shifted = shift()
    last = 0
    for turn in range(2):
        for place in range(5000):
            arrival = NOW + (5000 * turn + place) * PERIOD
            moved = shifted.moved(THEN + place * PERIOD, arrival)
            if moved is not None:
                assert moved == arrival + LEAD > last
                last = moved
    assert shifted.anchored == 2


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_another_speed_is_followed_and_noticed(speed: float) -> None:
    shifted = shift()
    for place in range(2000):
        arrival = NOW + round(place * PERIOD / speed)
        moved = shifted.moved(THEN + place * PERIOD, arrival)
        if moved is not None:
            assert -AHEAD <= arrival - moved <= LIMIT
    assert shifted.anchored > 5

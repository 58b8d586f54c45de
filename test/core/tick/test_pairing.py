# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.tick import ArmSample, Pairing

PERIOD = 1_000_000


def put(pairing: Pairing, arm: int, tick: int, offset: int = 0) -> None:
    sample = ArmSample(tick * PERIOD + offset, (float(tick), 0.0, 0.0))
    sample.arm = arm
    pairing.put(sample)


def ticks(pairing: Pairing) -> list[tuple[float, float]]:
    found = []
    while pairing.advance():
        found.append((pairing.master.x, pairing.slave.x))
    return found


def test_samples_of_one_tick_belong_together_whoever_comes_first() -> None:
    pairing = Pairing(1000.0, 100)
    put(pairing, 0, 5)
    assert pairing.waiting
    assert ticks(pairing) == []
    put(pairing, 1, 5, offset=PERIOD // 2)
    assert ticks(pairing) == [(5.0, 5.0)]
    assert not pairing.waiting
    put(pairing, 1, 6)
    put(pairing, 0, 6, offset=PERIOD // 2)
    assert ticks(pairing) == [(6.0, 6.0)]
    assert pairing.held == 0


@pytest.mark.parametrize("arm", [0, 1])
def test_for_a_lost_sample_the_one_before_stands(arm: int) -> None:
    pairing = Pairing(1000.0, 100)
    for tick in (1, 2, 3, 4):
        put(pairing, 1 - arm, tick)
    for tick in (1, 4):
        put(pairing, arm, tick)
    found = [(pair[1 - arm], pair[arm]) for pair in ticks(pairing)]
    assert found == [(1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (4.0, 4.0)]
    assert pairing.held == 2


@pytest.mark.parametrize("arm", [0, 1])
def test_the_oldest_is_dropped_and_nothing_stands_for_a_first_sample(arm: int) -> None:
    pairing = Pairing(1000.0, longest=2)
    for tick in (1, 2, 3, 4):
        put(pairing, 1 - arm, tick)
    for tick in (1, 3):
        put(pairing, arm, tick)
    assert ticks(pairing) == [(3.0, 3.0)]
    assert pairing.held == 0


@given(st.lists(st.sampled_from([0, 1]), min_size=1, max_size=200))
def test_nothing_is_lost_in_any_order_of_arrival(arms: list[int]) -> None:
    pairing = Pairing(1000.0, 1000)
    sent = [0, 0]
    found = []
    for arm in arms:
        put(pairing, arm, sent[arm])
        sent[arm] += 1
        found += ticks(pairing)
    assert found == [(float(tick), float(tick)) for tick in range(min(sent))]


def test_what_waits_is_forgotten_where_a_clock_was_set_back() -> None:
    pairing = Pairing(1000.0, 100)
    for arm in (0, 1):
        put(pairing, arm, 5000)
    assert ticks(pairing) == [(5000.0, 5000.0)]
    put(pairing, 0, 5001)
    pairing.clear()
    assert not pairing.waiting
    put(pairing, 1, 2)
    put(pairing, 1, 3)
    put(pairing, 0, 3)
    assert ticks(pairing) == [(3.0, 3.0)]

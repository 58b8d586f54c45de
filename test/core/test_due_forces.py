# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.due_forces import DueForces


def force(sample: int) -> tuple[float, float, float]:
    return (0.0, 0.0, float(sample))


@pytest.mark.parametrize("latency", [1, 2, 20])
def test_a_force_in_time_is_applied_at_its_tick_and_neither_earlier_nor_later(
    latency: int,
) -> None:
    forces = DueForces(latency)
    applied = {}
    for tick in range(100):
        if found := forces.take(tick):
            applied[tick] = found
        forces.put(tick, tick * 1000, force(tick))
    assert applied == {
        tick: ((tick - latency) * 1000, force(tick - latency)) for tick in range(latency, 100)
    }
    assert (forces.due, forces.missed) == (100, 0)


def test_without_latency_a_force_is_applied_on_arrival_and_has_no_due_time() -> None:
    forces = DueForces(0)
    assert forces.take(5) is None
    forces.put(5, 5000, force(5))
    assert forces.take(5) == (5000, force(5))
    assert (forces.due, forces.missed) == (0, 0)


def test_a_late_force_counts_as_missed_and_is_there_at_once() -> None:
    forces = DueForces(1)
    forces.take(6)
    forces.put(5, 5000, force(5))
    assert forces.take(6) == (5000, force(5))
    assert (forces.due, forces.missed) == (1, 1)


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 6)), max_size=60), st.integers(1, 4))
def test_no_force_is_early_or_applied_after_a_newer_one(
    arrivals: list[tuple[int, int]], latency: int
) -> None:
    forces = DueForces(latency)
    applied: list[int] = []
    late = 0
    for tick in range(40):
        for sample, delay in arrivals:
            # On time for its tick, or so many ticks after.
            if sample + latency + delay - 3 == tick:
                late += sample + latency < tick
                forces.put(sample, sample, force(sample))
        if found := forces.take(tick):
            assert found[0] + latency <= tick
            applied.append(found[0])
    assert applied == sorted(set(applied))
    assert forces.missed == late


def test_a_force_that_is_out_of_date_is_passed_on_at_once_or_never() -> None:
    forces = DueForces(1)
    forces.take(6)
    forces.put(6, 6000, force(6))
    forces.pass_on(10**18, force(1000))
    assert forces.take(6) == (10**18, force(1000))
    forces.pass_on(10**18, force(1000))
    assert forces.take(7) == (6000, force(6))
    assert forces.take(10**9) is None
    assert (forces.newest, forces.due, forces.missed) == (6, 1, 0)


def test_a_force_overtaken_by_one_that_was_taken_ahead_of_its_tick_is_not_late() -> None:
    forces = DueForces(latency=2)
    forces.put(10, 10, force(10))
    assert forces.take(12, ahead=True)
    forces.put(9, 9, force(9))
    assert forces.take(11, ahead=True) is None
    assert (forces.due, forces.missed) == (2, 0)

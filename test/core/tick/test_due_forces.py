# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.model import Vector
from haptic_accel.core.tick import DueForces
from haptic_accel.core.tick.device_side import FLOWING, IN_TIME, STRAGGLING

PERIOD = 1e-3
"""Period of the grid, s."""


def force(number: float) -> Vector:
    return (-1.0 * number, 2.0 * number, 1.0 * number)


def put(forces: DueForces, sample: int) -> None:
    forces.put(sample, sample, *force(sample))


def pop(forces: DueForces, tick: int, *, ahead: bool = False) -> int | None:
    """Return the stamp of the force taken, which is the number of its sample."""
    if not (forces.pop(tick, True) if ahead else forces.pop(tick)):
        return None
    assert (forces.x, forces.y, forces.z) == force(forces.stamp)
    return forces.stamp


@pytest.mark.parametrize("latency", [1, 2, 20])
def test_a_force_in_time_is_applied_at_its_tick_and_neither_earlier_nor_later(
    latency: int,
) -> None:
    forces = DueForces(latency, PERIOD)
    applied = {}
    for tick in range(100):
        if (found := pop(forces, tick)) is not None:
            applied[tick] = found
        put(forces, tick)
    assert applied == {tick: tick - latency for tick in range(latency, 100)}
    assert (forces.due, forces.past_tick) == (100, 0)


def test_forces_that_come_in_any_order_are_each_applied_at_their_tick() -> None:
    for order in itertools.permutations(range(5)):
        forces = DueForces(5, PERIOD)
        for sample in order:
            put(forces, sample)
        assert [pop(forces, tick) for tick in range(5, 10)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("latency", "counts"), [(0, (0, 0, 0)), (1, (1, 1, 1))])
def test_a_force_that_comes_after_its_tick_is_there_at_once_and_counted_if_it_was_due(
    latency: int, counts: tuple[int, int, int]
) -> None:
    forces = DueForces(latency, PERIOD)
    assert pop(forces, 5 + latency) is None
    put(forces, 5)
    assert pop(forces, 5 + latency) == 5
    forces.took_effect(1.0)
    assert (forces.due, forces.past_tick, forces.missed) == counts


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 6)), max_size=60), st.integers(1, 4))
def test_no_force_is_early_or_applied_after_a_newer_one(
    arrivals: list[tuple[int, int]], latency: int
) -> None:
    forces = DueForces(latency, PERIOD)
    applied: list[int] = []
    late = 0
    for tick in range(40):
        for sample, delay in arrivals:
            # On time for its tick, or so many ticks after.
            if sample + latency + delay - 3 == tick:
                late += sample + latency < tick
                put(forces, sample)
        if (found := pop(forces, tick)) is not None:
            assert found + latency <= tick
            applied.append(found)
    assert applied == sorted(set(applied))
    assert forces.past_tick == late


def test_a_force_that_is_out_of_date_is_passed_on_at_once_or_never() -> None:
    forces = DueForces(1, PERIOD)
    pop(forces, 6)
    put(forces, 6)
    forces.pass_on(1000, *force(1000))
    assert pop(forces, 6) == 1000
    forces.pass_on(1000, *force(1000))
    assert pop(forces, 7) == 6
    assert pop(forces, 10**9) is None
    assert (forces.newest, forces.due, forces.past_tick) == (6, 1, 0)
    put(forces, 10**9)
    forces.pass_on(1000, *force(1000))
    forces.clear()
    assert pop(forces, 10**9 + 1) is None


def test_a_force_overtaken_by_one_that_was_taken_ahead_of_its_tick_is_not_late() -> None:
    forces = DueForces(2, PERIOD)
    put(forces, 10)
    assert pop(forces, 12, ahead=True) == 10
    put(forces, 9)
    assert pop(forces, 11, ahead=True) is None
    assert (forces.due, forces.past_tick) == (2, 0)


def loop(forces: DueForces, moments: dict[int, float], ticks: int) -> None:
    """Serve ticks at their times, or at those given, s; each sample's force comes at once."""
    for tick in range(ticks):
        pop(forces, tick)
        forces.took_effect(moments.get(tick, tick * PERIOD))
        put(forces, tick)


def test_a_device_that_stands_still_for_5_ms_misses_what_is_due_in_that_time() -> None:
    forces = DueForces(1, PERIOD)
    # Tick 20 is served in time; then nothing until 25.1 ms, when all that waits is made up for.
    loop(forces, dict.fromkeys(range(21, 26), 25.1e-3), 40)
    assert forces.past_tick == 0, "each came before its tick, which waited"
    assert (forces.due, forces.missed) == (40, 4), "21 to 24; 25 is 0.1 ms late, which is in time"
    assert forces.longest == pytest.approx(25.1e-3 - 21e-3)
    assert forces.late_time == pytest.approx(25.1e-3 - 21e-3), "waiting together, not one by one"


def test_pauses_add_up_and_the_longest_is_known() -> None:
    forces = DueForces(1, PERIOD)
    loop(forces, {10: 12e-3, 11: 12e-3, 30: 30.5e-3}, 40)
    assert forces.missed == 3
    assert forces.longest == pytest.approx(2e-3)
    assert forces.late_time == pytest.approx(2e-3 + 0.5e-3)
    assert forces.age.count == 0, "none was written"
    forces.reset_counts()
    assert (forces.due, forces.missed, forces.longest, forces.late_time) == (0, 0, 0.0, 0.0)
    assert forces.late_before == 0


@pytest.mark.parametrize(("share", "missed"), [(0.9, 0), (1.1, 1)])
def test_a_force_may_take_effect_a_quarter_of_a_period_late(share: float, missed: int) -> None:
    assert IN_TIME == 0.25
    forces = DueForces(1, PERIOD)
    loop(forces, {10: (10 + 0.25 * share) * PERIOD}, 20)
    assert forces.missed == missed
    assert forces.longest == pytest.approx(0.25 * share * PERIOD)


def test_of_forces_that_come_together_all_that_were_due_are_missed() -> None:
    forces = DueForces(1, PERIOD)
    pop(forces, 9)
    for sample in range(4, 9):
        put(forces, sample)
    assert pop(forces, 9) == 8
    forces.took_effect(9.1e-3)
    assert (forces.due, forces.missed, forces.past_tick) == (5, 4, 5)
    assert forces.longest == pytest.approx(4.1e-3)


def test_a_straggler_that_never_takes_effect_is_missed() -> None:
    forces = DueForces(1, PERIOD)
    put(forces, 8)
    assert pop(forces, 9) == 8
    forces.took_effect(9e-3)
    put(forces, 7)
    assert pop(forces, 9) is None
    forces.took_effect(9.1e-3)
    assert (forces.due, forces.missed) == (2, 1)


def test_time_in_which_forces_were_late_together_begins_with_the_first() -> None:
    forces = DueForces(1, PERIOD)
    put(forces, 8)
    assert pop(forces, 9) == 8
    put(forces, 7)
    forces.took_effect(12e-3)
    assert forces.late_time == pytest.approx(12e-3 - 8e-3)


@pytest.mark.parametrize(("overtaken", "taken"), [(STRAGGLING, None), (STRAGGLING + 1, 10)])
def test_only_a_force_that_was_overtaken_by_far_is_left_to_the_safety_layer(
    overtaken: int, taken: int | None
) -> None:
    forces = DueForces(1, PERIOD)
    put(forces, 10 + overtaken)
    pop(forces, 11 + overtaken)
    put(forces, 10)
    assert pop(forces, 11 + overtaken) == taken


@pytest.mark.parametrize(("now", "missed"), [(10.5e-3, 0), (12.2e-3, 0), (12.4e-3, 1)])
def test_a_force_taken_ahead_is_missed_only_if_given_to_the_device_late(
    now: float, missed: int
) -> None:
    forces = DueForces(2, PERIOD)
    put(forces, 10)
    assert pop(forces, 12, ahead=True) == 10
    forces.took_effect(now)
    assert forces.missed == missed


@pytest.mark.parametrize("latency", [0, 1, 3])
@pytest.mark.parametrize("ahead", [False, True])
def test_a_command_is_missing_while_others_came_a_short_time_ago(
    latency: int, ahead: bool
) -> None:
    forces = DueForces(latency, PERIOD, True) if ahead else DueForces(latency, PERIOD)
    assert forces.ahead == (ahead and latency > 0)
    assert not forces.is_missing(10), "none ever came"
    put(forces, 10)
    # The command for tick t is that of the sample so many ticks before; none is ahead of its tick.
    needed = 10 + (0 if ahead else latency)
    missing = [tick for tick in range(needed - 5, needed + 20) if forces.is_missing(tick)]
    assert missing == [needed + since for since in range(1, FLOWING + 1)]

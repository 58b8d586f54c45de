# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ticks and arrivals by clocks that a test sets."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import DueForces
from haptic_accel.nodes import timing
from haptic_accel.nodes.timing import BEHIND, CATCH_UP, ArrivalKeeper, RateKeeper, system_time

PERIOD = NANOSECONDS // 1000


class FakeClock:
    """Steady time that a test sets, ns or s."""

    def __init__(self, now: Any = 17 * PERIOD) -> None:
        self.now = now

    def __call__(self) -> Any:
        return self.now


def due(keeper: RateKeeper) -> list[int]:
    """Return all grid points that are due."""
    return list(iter(keeper.due, None))


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def keeper(clock: FakeClock) -> RateKeeper:
    return RateKeeper(1000, clock)


def test_forces_of_a_process_that_stood_still_are_late_though_none_comes_after_its_tick(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    forces = DueForces(1, keeper.period)
    for moment in [*range(100), *range(200, 300)]:  # in periods: it stands still for 0.1 s
        clock.now = 18 * PERIOD + moment * PERIOD
        for tick in due(keeper):
            forces.pop(tick)
            forces.took_effect(clock.now / NANOSECONDS)
            forces.put(tick, tick, 0.0, 0.0, 0.0)
    # Of tick 100 to 200, the last is served in time, and has the 100 before it made up for it.
    assert (forces.due, forces.missed, forces.past_tick) == (300 - keeper.missed, 99, 0)
    assert keeper.missed == 1
    assert forces.longest == pytest.approx(0.1)
    assert forces.late_time == pytest.approx(0.1)


Served = dict[float, list[int]]

SERVED = round(CATCH_UP * 1000)
"""Most grid points of a stall that are served."""


@pytest.mark.parametrize(
    ("lead", "frame", "moments", "late", "missed"),
    [
        (0.0, 1, {index + 0.08: [index] for index in range(18, 30)}, 0, 0),
        (0.0, 1, {17.999: [], 18.0: [18], 18.001: []}, 0, 0),  # once, and not before its time
        (50e-6, 1, {17.96: [18]}, 0, 0),  # early by the time to wake
        (0.0, 1, {18.6: [18], 19.05: [19]}, 1, 0),  # a late one shifts no other
        (0.0, 1, {217.0: [*range(218 - SERVED, 218)]}, SERVED - 1, 200 - SERVED),
        (0.0, 4, {17.0: [], 20.001: [20], 26.001: [24], 36.0: [28, 32, 36]}, 12, 0),
        (0.0, 4, {240.0: [*range(244 - SERVED, 241, 4)]}, SERVED - 4, 224 - SERVED),
    ],
)
def test_grid_points_are_due_once_in_their_order(
    clock: FakeClock, lead: float, frame: int, moments: Served, late: int, missed: int
) -> None:
    keeper = RateKeeper(1000, clock, lead=lead, frame=frame)
    for moment, served in moments.items():
        clock.now = round(moment * PERIOD)
        assert due(keeper) == served
        if served:
            assert keeper.time(served[-1]) == served[-1] * PERIOD
            assert keeper.next == pytest.approx((served[-1] + frame) * 1e-3 - lead)
    ticks = frame * sum(map(len, moments.values()))
    assert (keeper.ticks, keeper.late, keeper.missed) == (ticks, late, missed)


def test_grid_points_of_a_stall_are_served_afterwards_each_in_its_turn(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    readers = "master", "slave"
    assert [keeper.pop_longest_gap(each) for each in readers] == [0.0, 0.0]
    clock.now = 70 * PERIOD
    assert due(keeper) == list(range(18, 71))
    assert keeper.missed == 0
    for each in readers:
        assert keeper.pop_longest_gap(each) == pytest.approx(0.052)
        assert keeper.pop_longest_gap(each) == 0.0


def test_a_process_that_stays_behind_leaves_out_what_waits(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    # Each tick takes a tenth longer than its period.
    served = []
    for index in range(1000):
        clock.now = 18 * PERIOD + round(index * 1.1 * PERIOD)
        served.append(keeper.due())
    lateness = 1.1 * np.arange(1000) + 18 - np.array(served)
    assert lateness.max() < 1e3 * BEHIND * 0.1 + 1
    assert keeper.missed == served[-1] - served[0] - len(served) + 1
    assert keeper.missed == pytest.approx(100, abs=30)


@given(rate=st.floats(50, 20e3), delays=st.lists(st.floats(0, 3), min_size=2, max_size=200))
def test_no_drift_and_no_loss_at_any_rate(rate: float, delays: list[float]) -> None:
    clock = FakeClock()
    keeper = RateKeeper(rate, clock)
    period = NANOSECONDS / rate
    first = 1 + int(clock.now / period)
    served: list[int] = []
    for index, delay in enumerate(delays):
        clock.now = max(clock.now, round((first + index + delay) * period) + 1)
        served += due(keeper)
    assert served == list(range(first, served[-1] + 1))
    assert keeper.ticks == len(served)
    assert keeper.missed == 0


def test_the_highest_documented_rate_that_is_held_is_named() -> None:
    held = timing.rate_that_holds
    # A tick takes 0.52 of 250 us, which is held, or 0.64, which is not, but 0.32 of 500 us is.
    assert held(130e-6, 8000, 1, framed=True) == "rate:=4000 frame:=4 latency:=1.5ms"
    assert held(130e-6, 8000, 1, framed=False) == "rate:=4000"
    assert held(160e-6, 4000, 4, framed=True) == "rate:=2000 frame:=2 latency:=2ms"
    assert held(70e-6, 8000, 1, framed=True) == "rate:=8000 frame:=8 latency:=1.5ms"
    assert held(70e-6, 8000, 8, framed=True) == "rate:=4000 frame:=4 latency:=1.5ms"
    assert held(1.1e-3, 1000, 1, framed=True) == "rate:=500"
    # Of forces 2.2 ms after their sample, one sample and a quarter is 2.5 ms at 500 Hz.
    assert held(0.1e-3, 1000, 1, framed=True, age=2.2e-3) == "rate:=500"
    assert held(0.1e-3, 1000, 1, framed=True, age=3e-3) == ""
    assert held(0.1e-3, 1000, 1, framed=True, age=3e-3, latency=2) == "rate:=500"
    assert held(1.3e-3, 1000, 1, framed=True) == held(math.nan, 1000, 1, framed=True) == ""


def test_threads_that_a_library_made_real_time_stay_so(monkeypatch: pytest.MonkeyPatch) -> None:
    priorities = {1: 0, 2: 60, 3: 5, 4: timing.FORCE_PRIORITY}
    monkeypatch.setattr(os, "listdir", lambda _: map(str, priorities))
    monkeypatch.setattr(os, "sched_getparam", lambda each: os.sched_param(priorities[each]))

    def schedule(thread: int, _: int, param: os.sched_param) -> None:
        priorities[thread] = param.sched_priority

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    timing.schedule(os.SCHED_FIFO, timing.COIL_PRIORITY)
    assert priorities == {1: timing.COIL_PRIORITY, 2: 60, 3: 5, 4: timing.COIL_PRIORITY}


def test_system_and_steady_time_go_on_together() -> None:
    before = system_time(0)
    time.sleep(0.01)
    assert system_time(0) == pytest.approx(before, abs=1_000_000)


def looks(arrival: Callable[[int], float], ticks: int = 3000) -> list[int]:
    """Return the number of looks in each period of 1 ms, of messages that arrive at an offset."""
    clock = FakeClock(10.0)
    keeper = ArrivalKeeper(1000.0, clock)
    counts = [0] * ticks
    come = [10.0 + tick * 1e-3 + arrival(tick) for tick in range(ticks)]
    taken = 0
    while (tick := int((clock.now - 10.0) * 1000)) < ticks:
        counts[tick] += 1
        newest = taken
        while newest < ticks and come[newest] <= clock.now:
            newest += 1
        clock.now = max(keeper.polled(found=newest > taken), clock.now + 1e-6)
        taken = newest
    return counts


@pytest.mark.parametrize("later", [0.2e-3, 0.7e-3])
def test_looks_settle_just_behind_the_arrival_of_a_ticks_messages(later: float) -> None:
    counts = looks(lambda tick: 0.2e-3 if tick < 1000 else later)
    assert sum(counts[-1000:]) < 1.3 * 1000


def test_without_messages_there_is_one_look_a_period() -> None:
    clock = FakeClock(10.0)
    keeper = ArrivalKeeper(1000.0, clock)
    for _ in range(100):
        clock.now = keeper.polled(found=False)
    assert clock.now == pytest.approx(10.1, abs=2e-3)

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.nodes.scheduling import RateKeeper

PERIOD = NANOSECONDS // 1000


class FakeClock:
    """Steady time that a test sets."""

    def __init__(self) -> None:
        self.now = 17 * PERIOD

    def __call__(self) -> int:
        return self.now


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def keeper(clock: FakeClock) -> RateKeeper:
    return RateKeeper(1000, clock)


def test_ticks_lie_on_whole_multiples_of_the_period(clock: FakeClock, keeper: RateKeeper) -> None:
    for index in range(20, 30):
        clock.now = index * PERIOD + 80_000
        assert keeper.tick() == index * PERIOD
    assert (keeper.ticks, keeper.late, keeper.missed) == (10, 0, 0)


def test_a_timer_that_fires_a_little_early_is_meant_for_the_tick_to_come(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    clock.now = 20 * PERIOD - 100_000
    assert keeper.tick() == 20 * PERIOD
    assert keeper.late == 0


def test_a_tick_later_than_half_a_period_is_late_and_shifts_no_other(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    clock.now = 20 * PERIOD + 600_000
    assert keeper.tick() == 20 * PERIOD
    clock.now = 21 * PERIOD + 50_000
    assert keeper.tick() == 21 * PERIOD
    assert (keeper.ticks, keeper.late, keeper.missed) == (2, 1, 0)


def test_what_is_missed_is_counted_and_not_made_up_for(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    clock.now = 20 * PERIOD
    keeper.tick()
    clock.now = 70 * PERIOD
    assert keeper.tick() == 70 * PERIOD
    assert keeper.missed == 49
    assert keeper.lateness.maximum == pytest.approx(0.049)
    assert keeper.tick() is None  # a second call for the same grid point
    assert keeper.ticks == 2


@given(
    rate=st.floats(50, 20e3),
    delays=st.lists(st.floats(0, 0.7), min_size=2, max_size=200),
)
def test_no_drift_at_any_rate(rate: float, delays: list[float]) -> None:
    clock = FakeClock()
    keeper = RateKeeper(rate, clock)
    period = NANOSECONDS / rate
    first = 1 + int(clock.now / period)
    for index, delay in enumerate(delays):
        clock.now = round((first + index + delay) * period) + 1
        due = keeper.tick()
        assert due == pytest.approx((first + index) * period, abs=1)
    assert keeper.ticks == len(delays)
    assert keeper.missed == 0


def test_the_longest_gap_is_told_once(clock: FakeClock, keeper: RateKeeper) -> None:
    for place in (20, 71, 73):
        clock.now = place * PERIOD
        keeper.tick()
    assert keeper.take_longest_gap() == pytest.approx(0.050)
    assert keeper.take_longest_gap() == 0.0


def test_lateness_is_counted_from_the_last_grid_point(
    clock: FakeClock, keeper: RateKeeper
) -> None:
    clock.now = 20 * PERIOD + 300_000
    assert keeper.lateness_now() == pytest.approx(300e-6)
    assert keeper.lateness_now(lead=100e-6) == pytest.approx(400e-6)


def test_a_timer_may_be_started_ahead_of_the_grid() -> None:
    # A clock that goes on by 10 us whenever it is looked at.
    keeper = RateKeeper(100, itertools.count(17_000_000, 10_000).__next__)
    keeper.wait_for_grid(lead=0.004)
    # 4 ms before a grid point is 6 ms after the last.
    assert keeper.lateness_now() == pytest.approx(0.006, abs=30e-6)

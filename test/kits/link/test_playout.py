# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, ALL_AXES, along_actuator
from haptic_accel.core.model import FloatArray
from haptic_accel.core.network import Channel, ChannelParameters
from haptic_accel.kits.link.playout import DECAY, LOWERING, MISSED, STEPS, Played, Playout
from nightly import rest_slow

RATE = 1000.0
START = 1_790_000_000_000
"""Number of the first sample: samples since 1970 at `RATE`."""

BOOTED = 5.0e4
"""Reading of the receiver's clock at the first sample, s."""

CLEAN = ChannelParameters(delay=0.0204)


class Tick(NamedTuple):
    """Sample that a tick played, and its source."""

    played: Played
    position: float
    delay: float


def ticks(
    playout: Playout,
    signal: FloatArray,
    parameters: ChannelParameters = CLEAN,
    *,
    period: int = 1,
    repeats: int = 16,
    drift: float = 0.0,
    change: Callable[[int], ChannelParameters] | None = None,
    blackouts: tuple[tuple[float, float], ...] = (),
) -> Iterator[Tick]:
    """Play a signal that crosses a channel; positions count from its first sample."""
    channel = Channel[tuple[int, list[float]]](parameters, seed=4, blackouts=blackouts)
    for tick in range(len(signal)):
        now = tick / RATE
        if change:
            channel.parameters = change(tick)
        if tick % period == 0:
            first = max(0, tick + 1 - repeats)
            channel.send((START + first, signal[first : tick + 1].tolist()), now)
        clock = BOOTED + now * (1.0 + drift)
        for first, samples in channel.arrived(now):
            playout.put(first, samples, clock)
        played = playout.play(clock)
        yield Tick(played, playout.position - START, playout.delay)


def texture(seconds: float) -> FloatArray:
    return np.random.default_rng(2).standard_normal(round(seconds * RATE))


@pytest.mark.parametrize("period", [1, 2, 4])
def test_with_a_constant_delay_every_sample_is_played_bit_for_bit(period: int) -> None:
    signal = texture(3.0)
    found = list(ticks(Playout(RATE), signal, period=period))[100:]
    assert all(played.kind == "true" for played, _, _ in found)
    assert all(after.position - before.position == 1 for before, after in pairwise(found))
    assert [played.value[ACTUATOR_AXIS] for played, _, _ in found] == [
        signal[round(position)] for _, position, _ in found
    ]
    assert found[-1].delay <= period / RATE + 1e-9


def test_it_waits_until_something_came_and_starts_with_it() -> None:
    playout = Playout(RATE)
    assert playout.play(1.0) == (along_actuator(0.0), "waiting")
    playout.put(START, [3.0, 4.0], 1.001)
    assert playout.play(1.001) == (along_actuator(4.0), "true")
    playout.clear()
    assert playout.play(1.002) == (along_actuator(4.0), "waiting")  # no step in what is felt
    assert playout.counts == {"waiting": 2, "true": 1, "late": 0}


@pytest.mark.parametrize("drift", rest_slow([100e-6, -100e-6]))
def test_a_drift_of_the_clocks_is_followed(drift: float) -> None:
    playout = Playout(RATE)
    found = list(ticks(playout, texture(60.0), drift=drift))
    ages = [tick - position for tick, (_, position, _) in enumerate(found)][1000:]
    assert max(ages) - min(ages) <= 2.0  # 6 samples of drift are not in it
    assert max(ages) <= CLEAN.delay * RATE + 3
    assert playout.counts["concealed"] <= 10
    between = sum(position % 1 > 0 for _, position, _ in found)
    assert between <= 8 * STEPS


def test_a_longer_delay_is_met_at_once_and_a_shorter_one_slowly() -> None:
    def change(tick: int) -> ChannelParameters:
        return ChannelParameters(delay=0.0504 if 2000 <= tick < 6000 else 0.0204)

    found = list(ticks(Playout(RATE), texture(40.0), change=change))
    ages = [tick - position for tick, (_, position, _) in enumerate(found)]
    assert ages[1999] <= 22
    assert ages[2200] >= 50  # after as many samples more than 1 % of the window
    fall = [ages[tick] - ages[tick + 1000] for tick in range(9000, 30000, 1000)]
    assert max(fall) <= 1.0 / STEPS * RATE
    assert np.mean(fall) <= LOWERING * RATE + 0.5
    assert ages[-1] <= 22


@pytest.mark.parametrize(("stall", "seconds"), [(0.06, 14), (0.4, 4)])
def test_after_a_host_stood_still_the_delay_is_soon_as_before(stall: float, seconds: int) -> None:
    def change(tick: int) -> ChannelParameters:
        left = stall - (tick - 5000) / RATE
        return ChannelParameters(delay=0.0204 + max(0.0, left if left <= stall else 0.0))

    found = list(ticks(Playout(RATE), texture(20.0), change=change))
    ages = [tick - position for tick, (_, position, _) in enumerate(found)]
    assert max(ages[5000:]) > ages[4999] + 10.0
    assert max(ages[5000 + 1000 * seconds :]) <= ages[4999] + 1.0


def test_the_pace_changes_by_no_more_than_two_percent() -> None:
    jittery = ChannelParameters(delay=0.03, jitter=0.02, loss=0.1)
    found = list(ticks(Playout(RATE), texture(20.0), jittery))
    paces = [after.position - before.position for before, after in pairwise(found[100:])]
    assert all(abs(pace - 1) <= 1.001 / STEPS or abs(pace) < 1 for pace in paces)
    assert np.mean([abs(pace) < 0.9 for pace in paces]) < 0.005  # stands, in a gap


def test_lost_packets_are_repaired_from_later_ones() -> None:
    signal = texture(10.0)
    playout = Playout(RATE)
    lossy = ChannelParameters(delay=0.0204, loss=0.1)
    found = list(ticks(playout, signal, lossy))[1000:]
    repaired = [tick for tick in found if tick.played.kind == "repaired"]
    assert len(repaired) == pytest.approx(0.1 * len(found), rel=0.2)
    for (value, _), position, _ in repaired:
        whole = int(position)
        between = signal[whole] + position % 1 * (signal[whole + 1] - signal[whole])
        assert value[ACTUATOR_AXIS] == pytest.approx(between, abs=1e-4)
    assert playout.counts["concealed"] < 0.02 * len(signal)


def test_in_a_blackout_the_signal_fades_out_and_afterwards_it_goes_on_as_before() -> None:
    gravity = 9.81
    signal = gravity + np.sin(2 * np.pi * 100 / RATE * np.arange(5000))
    found = list(ticks(Playout(RATE), signal, blackouts=((2.0, 4.0),)))
    gap = found[2021 : 2021 + round(DECAY * RATE) + 1]
    assert all(played.kind == "concealed" for played, _, _ in gap)
    felt = [played.value[ACTUATOR_AXIS] - gravity for played, _, _ in gap]
    assert max(map(abs, felt[:5])) > 0.5  # it goes on at first
    assert max(map(abs, felt)) < 1.5
    assert abs(felt[-1]) < 0.05
    assert all(played.value == gap[-1].played.value for played, _, _ in found[2060:4000])
    assert 4021 - found[4021].position <= 23
    assert all(played.kind == "true" for played, _, _ in found[4030:])


def test_samples_that_come_after_they_were_due_are_dropped_and_counted() -> None:
    playout = Playout(RATE)
    for tick in range(500):
        playout.put(START + tick, [float(tick)], BOOTED + tick / RATE)
        playout.play(BOOTED + tick / RATE)
    assert playout.play(BOOTED + 0.5).kind == "concealed"
    playout.put(START + 501, [501.0], BOOTED + 0.501)
    assert playout.play(BOOTED + 0.501) == (along_actuator(501.0), "true")
    assert playout.counts["late"] == 0
    for _ in range(2):  # the second time it is no news
        playout.put(START + 500, [500.0, 501.0], BOOTED + 0.5015)
        assert playout.counts["late"] == 1
    playout.put(START + 502, [502.0], BOOTED + 0.502)
    assert playout.play(BOOTED + 0.502) == (along_actuator(502.0), "true")


@pytest.mark.parametrize("step", [-(10**7), 10**7])
def test_a_step_of_the_senders_clock_is_a_new_start(step: int) -> None:
    playout = Playout(RATE)
    for tick in range(2000):
        moved = START + tick + step * (tick >= 1000)
        playout.put(moved, [float(tick)], BOOTED + tick / RATE)
        assert playout.play(BOOTED + tick / RATE) == (along_actuator(float(tick)), "true")


def test_ticks_that_are_served_late_keep_the_pace() -> None:
    playout, played = Playout(RATE), []
    for tick in range(3000):
        playout.put(START + tick, [float(tick)], BOOTED + tick / RATE)
        if tick % 8 == 7:  # eight in a row, each with its own time
            played += [playout.play(BOOTED + each / RATE) for each in range(tick - 7, tick + 1)]
    later = [found.value[ACTUATOR_AXIS] for found in played[100:]]
    assert later == list(range(int(later[0]), int(later[0]) + len(later)))


def test_missed_ticks_are_left_out() -> None:
    playout = Playout(RATE)
    missed = range(1000, 1000 + round(2 * MISSED * RATE))
    for tick in range(2000):
        playout.put(START + tick, [float(tick)], BOOTED + tick / RATE)
        if tick not in missed:
            assert playout.play(BOOTED + tick / RATE).value == along_actuator(tick)


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(-50, 50), st.lists(st.floats(width=32), max_size=16), st.floats(0.0, 0.1)
        ),
        max_size=60,
    )
)
def test_whatever_arrives_what_is_played_is_finite(
    packets: list[tuple[int, list[float], float]],
) -> None:
    playout, now = Playout(RATE), BOOTED
    largest = 0.0
    for shift, samples, wait in packets:
        now += wait
        playout.put(START + round((now - BOOTED) * RATE) + shift, samples, now)
        largest = max([largest, *(abs(s) for s in samples if np.isfinite(s))])
        played = playout.play(now)
        assert np.isfinite(played.value).all()
        if played.kind in ("true", "repaired"):
            assert abs(played.value[ACTUATOR_AXIS]) <= largest * (1 + 1e-9)
        assert playout.delay >= -1.0


# Three axes


def test_three_axes_are_played_and_concealed_as_each_alone() -> None:
    signal = np.random.default_rng(3).standard_normal((8000, 3))
    bad = ChannelParameters(delay=0.02, jitter=0.01, loss=0.3)
    channel = Channel[tuple[int, list[float]]](bad, seed=4)
    together, each = Playout(RATE), [Playout(RATE) for _ in range(3)]
    for tick in range(len(signal)):
        now = tick / RATE
        first = max(0, tick - 3)
        channel.send((START + first, signal[first : tick + 1].ravel().tolist()), now)
        for start, samples in channel.arrived(now):
            together.put(start, samples, BOOTED + now, ALL_AXES)
            for axis, playout in enumerate(each):
                playout.put(start, samples[axis::3], BOOTED + now)
        value, kind = together.play(BOOTED + now)
        found = [playout.play(BOOTED + now) for playout in each]
        assert value == tuple(one.value[ACTUATOR_AXIS] for one in found)
        assert [one.kind for one in found] == [kind] * 3
    assert together.counts == each[0].counts
    assert together.counts["concealed"] > 100


def test_a_component_that_is_no_number_is_missing_and_other_axes_are_a_new_start() -> None:
    playout = Playout(RATE)
    playout.put(START, [1.0, 2.0, 3.0], 1.0, ALL_AXES)
    assert playout.play(1.0) == ((1.0, 2.0, 3.0), "true")
    playout.put(START + 1, [1.0, np.nan, 3.0], 1.001, ALL_AXES)
    assert playout.play(1.001).kind == "concealed"
    playout.put(START + 2, [4.0], 1.002)
    assert playout.play(1.002) == (along_actuator(4.0), "true")

"""When samples were taken, found from frames that come more or less late."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.devices.serial.clock import SampleClock, unwrapped
from haptic_accel.devices.serial.protocol import CLOCKS

SHORTEST = 200e-6
"""Of all frames' time on the way, s."""


def errors(
    frames: int,
    *,
    rate: float = 1000.0,
    drift: float = 0.0,
    stamp_noise: float = 0.0,
    jitter: float = 100e-6,
    stragglers: float = 0.01,
) -> tuple[np.ndarray, SampleClock]:
    """Return by how much a clock errs, s, for each frame of one sample."""
    rng = random.Random(1)
    clock = SampleClock(rate)
    found, last = [], 0.0
    for index in range(frames):
        true = 1000.0 + index / rate
        stamp = round(1e6 * ((true - 1000.0) * (1 + drift) + stamp_noise * rng.random()))
        late = rng.expovariate(1 / jitter) + (5e-3 if rng.random() < stragglers else 0.0)
        last = max(last, true + SHORTEST + late)
        clock.add(index, 4_000_000_000 + stamp, last)
        found.append(clock.time(index) - true)
    return np.array(found), clock


@pytest.mark.parametrize("drift", [0.0, 1e-4, -1e-4])
def test_samples_are_placed_evenly_though_frames_come_unevenly(drift: float) -> None:
    found, _ = errors(12_000, drift=drift, stamp_noise=20e-6)
    settled = found[4000:]
    # A fiftieth of the jitter of arrival; what remains is the shortest time on the way.
    assert settled.std() < 2e-6
    assert settled.mean() == pytest.approx(SHORTEST, abs=20e-6)


def test_the_first_samples_have_times_as_well() -> None:
    found, _ = errors(40)
    assert np.all(found > 0)
    assert np.all(found < SHORTEST + 1e-3)


def test_the_true_rate_is_found() -> None:
    rng = random.Random(1)
    clock = SampleClock(1000.0)
    for index in range(20_000):
        # A crystal that runs 50 ppm fast takes samples too often, and believes it does not.
        clock.add(index, index * 1000, index / 1000.05 + rng.expovariate(1e4))
    assert 10_000 / (clock.time(20_000) - clock.time(10_000)) == pytest.approx(1000.05, abs=1e-3)


def test_a_device_that_stood_still_is_followed() -> None:
    clock = SampleClock(1000.0)
    for index in range(4000):
        stood = 0.2 if index >= 1500 else 0.0
        clock.add(index, index * 1000, index * 1e-3 + stood)
    assert clock.time(4000) == pytest.approx(4.2, abs=1e-4)


def test_the_delay_covers_most_frames_and_never_more_than_a_period() -> None:
    _, clock = errors(5000, jitter=100e-6, stragglers=0.0)
    # 95 of 100 exponential waits are over after 3 means.
    assert clock.delay == pytest.approx(300e-6, abs=60e-6)
    _, clock = errors(5000, jitter=10e-3)
    assert clock.delay <= 1e-3


def test_a_clock_that_jumps_is_followed() -> None:
    clock = SampleClock(1000.0)
    for index in range(1000):
        clock.add(index, index * 1000, index * 1e-3)
    for index in range(1000, 2000):  # half a second in which no sample was taken
        clock.add(index, index * 1000 + 500_000, index * 1e-3 + 0.5)
    assert clock.time(2000) == pytest.approx(2.5, abs=1e-4)


def test_a_stall_of_the_link_is_no_jump() -> None:
    clock = SampleClock(1000.0)
    for index in range(2000):
        arrival = index * 1e-3
        if 1000 <= index < 1080:  # come all at once
            arrival = 1.08
        clock.add(index, index * 1000, arrival)
        assert clock.time(index) == pytest.approx(index * 1e-3, abs=1e-3)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.lists(st.integers(0, 2**31 - 1), max_size=20))
def test_a_count_that_begins_anew_goes_on(first: int, steps: list[int]) -> None:
    expected = unwrapped(first, first)
    assert expected == first
    for step in steps:
        before, expected = expected, expected + step
        assert unwrapped(expected % CLOCKS, before) == expected

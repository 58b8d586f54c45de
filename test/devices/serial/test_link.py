# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device's clock, found from frames that come more or less late."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from haptic_accel.devices.serial.link import DeviceClock, unwrapped
from haptic_accel.devices.serial.protocol import CLOCKS

SHORTEST = 200e-6
"""Least time of a frame on the way, s."""

START = 4_000_000_000
"""Start of the device's clock, shortly before it wraps, us."""


def errors(
    frames: int, *, drift: float = 0.0, jitter: float = 100e-6, stragglers: float = 0.01
) -> tuple[np.ndarray, DeviceClock]:
    """Return by how much a clock errs, s, for each frame of one sample at 1 kHz."""
    rng = random.Random(1)
    clock = DeviceClock()
    found, last = [], 0.0
    for index in range(frames):
        true = 1000.0 + index * 1e-3
        stamp = START + round(1e6 * (true - 1000.0) * (1 + drift))
        late = rng.expovariate(1 / jitter) + (5e-3 if rng.random() < stragglers else 0.0)
        last = max(last, true + SHORTEST + late)
        clock.add(stamp, last)
        found.append(clock.time(stamp) - true)
    return np.array(found), clock


@pytest.mark.parametrize("drift", [0.0, 1e-4, -1e-4, 1e-3, -1e-3])
def test_samples_are_placed_evenly_though_frames_come_unevenly(drift: float) -> None:
    found, _ = errors(12_000, drift=drift)
    settled = found[4000:]
    # A fiftieth of the jitter of arrival; what remains is the shortest time on the way.
    assert settled.std() < 2e-6
    assert settled.mean() == pytest.approx(SHORTEST, abs=20e-6)
    # Before the slope is known, the drift of the last few blocks adds to it.
    assert np.all(np.abs(found[32:] - SHORTEST) < 60e-6 + 130e-3 * abs(drift))


def test_the_first_samples_have_times_as_well() -> None:
    found, clock = errors(31)
    assert not clock.known
    assert np.all(found > 0)
    assert np.all(found < SHORTEST + 1e-3)
    assert errors(32)[1].known


def test_the_host_s_time_becomes_the_device_s() -> None:
    _, clock = errors(4000, drift=1e-4)
    # 10 s on, the device's clock shows 1 ms more; it is taken to be late by the shortest time.
    expected = START + 10e6 * (1 + 1e-4) - SHORTEST * 1e6
    assert clock.device_time(1010.0) == pytest.approx(expected, abs=50)
    assert clock.time(clock.device_time(1234.5)) == pytest.approx(1234.5, abs=1e-9)
    assert clock.device_duration(1.0) == pytest.approx(1e6 * (1 + 1e-4), abs=5)


def test_a_device_that_stood_still_is_followed() -> None:
    clock = DeviceClock()
    for index in range(4000):
        stood = 0.2 if index >= 1500 else 0.0
        clock.add(index * 1000, index * 1e-3 + stood)
    assert clock.time(4_000_000) == pytest.approx(4.2, abs=1e-4)


def test_a_stall_of_the_link_is_no_jump() -> None:
    clock = DeviceClock()
    for index in range(2000):
        arrival = index * 1e-3
        if 1000 <= index < 1080:  # come all at once
            arrival = 1.08
        clock.add(index * 1000, arrival)
        assert clock.time(index * 1000) == pytest.approx(index * 1e-3, abs=1e-3)


instants = st.tuples(st.integers(0, 2**32), st.floats(0, 1e-3)) | st.tuples(
    st.just(0), st.sampled_from([0.0, 1e-9, 1e-4])
)


@settings(max_examples=40)
@given(st.lists(st.tuples(instants, st.integers(1, 99)), max_size=6))
@example([((0, 0.0), 2000)])
def test_whatever_a_device_says_its_clock_is_a_number(
    stretches: list[tuple[tuple[int, float], int]],
) -> None:
    clock, stamp, now = DeviceClock(), 0, 0.0
    for (step, interval), frames in stretches:
        for _ in range(frames):
            stamp, now = unwrapped((stamp + step) % CLOCKS, stamp), now + interval
            clock.add(stamp, now)
    assert math.isfinite(clock.time(stamp))
    assert math.isfinite(clock.device_time(now))
    assert 0.99e6 < clock.device_duration(1.0) < 1.01e6


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.lists(st.integers(0, 2**31 - 1), max_size=20))
def test_a_count_that_begins_anew_goes_on(first: int, steps: list[int]) -> None:
    expected = unwrapped(first, first)
    assert expected == first
    for step in steps:
        before, expected = expected, expected + step
        assert unwrapped(expected % CLOCKS, before) == expected

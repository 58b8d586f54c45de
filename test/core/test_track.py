# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded arms: put on a grid, resampled, looped, brought to rest, played."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import Stamped
from haptic_accel.core.track import (
    FADE,
    QUIET,
    SHORTEST,
    ReplayRig,
    Track,
    at_rest,
    cut,
    gridded,
    looped,
    played_at,
    quieted,
)
from haptic_accel.core.trial import run_trial

RATE = 1000.0
PERIOD = 1_000_000
START = 1_255_392_000_000_000_000


def stamps_at(places: list[int] | np.ndarray, jitter: float = 0.0, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, len(places))
    return START + np.rint((np.asarray(places) + noise) * PERIOD).astype(np.int64)


def along_z(values: np.ndarray) -> np.ndarray:
    return np.column_stack([np.zeros((len(values), 2)), values])


def numbered(places: list[int] | np.ndarray, jitter: float = 0.0) -> Stamped:
    """Return a signal whose value at each place is the place."""
    return stamps_at(places, jitter), along_z(np.asarray(places, dtype=float))


def track_of(acceleration: np.ndarray, position: np.ndarray | None = None) -> Track:
    track = at_rest(acceleration, RATE)
    if position is None:
        return track
    velocity = np.gradient(position, axis=0) * RATE
    return Track(RATE, acceleration, position, velocity, track.lost)


# The grid


@given(st.sets(st.integers(0, 400), min_size=3), st.floats(0.0, 0.2))
def test_samples_lie_at_their_places_and_lost_ones_hold_the_one_before(
    places: set[int], jitter: float
) -> None:
    kept = sorted(places)
    track = gridded(numbered(kept, jitter), None, None, RATE)
    first = kept[0]
    assert len(track) == kept[-1] - first + 1
    assert np.array_equal(np.flatnonzero(~track.lost) + first, kept)
    for index, value in enumerate(track.acceleration):
        assert value == max(place for place in kept if place <= index + first)


def test_a_clock_that_is_slewed_costs_no_sample() -> None:
    # 500 ppm, what NTP does at most, for a minute: thirty periods in all.
    stamps = START + np.rint(np.arange(60_000) * PERIOD * 1.0005).astype(np.int64)
    track = gridded((stamps, along_z(np.arange(60_000.0))), None, None, RATE)
    assert not track.lost.any()
    assert np.array_equal(track.acceleration, np.arange(60_000.0))


def test_motion_is_put_beside_the_acceleration_and_holds_too() -> None:
    places = np.arange(300)
    position = stamps_at(places[::2]), np.column_stack([places[::2], places[::2], places[::2]])
    track = gridded(numbered(places), position, None, RATE)
    assert np.array_equal(track.position[:, 0], np.repeat(places[::2], 2))
    assert not track.velocity.any()


def test_the_order_of_messages_and_values_that_are_no_number_do_not_matter() -> None:
    stamps, values = numbered(np.arange(300))
    values[17, 2] = np.nan
    order = np.random.default_rng(1).permutation(300)
    track = gridded((stamps[order], values[order]), None, None, RATE)
    assert list(np.flatnonzero(track.lost)) == [17]
    assert track.acceleration[17] == 16.0


def test_what_is_before_the_start_is_left_out_and_stamps_far_apart_are_refused() -> None:
    far = np.array([START, START + 10**18])
    with pytest.raises(ParameterError, match="must be at most"):
        gridded((far, np.zeros((2, 3))), None, None, RATE)
    track = gridded(numbered(np.arange(300)), None, None, RATE, START + 100 * PERIOD)
    assert track.acceleration[0] == 100.0
    with pytest.raises(ParameterError, match="no acceleration is left"):
        gridded(numbered(np.arange(300)), None, None, RATE, START + 301 * PERIOD)


# Changes of a track


def test_cutting_leaves_what_follows_and_its_own_rate_and_speed_all() -> None:
    track = track_of(np.arange(1000.0))
    assert played_at(track, RATE) is track
    assert cut(track, 0.25).acceleration[0] == 250.0
    with pytest.raises(ParameterError, match="start = 0.9.*at most 0.8"):
        cut(track, 0.9)


@pytest.mark.parametrize(("rate", "speed"), [(2000.0, 1.0), (500.0, 1.0), (1000.0, 0.5)])
def test_a_tone_keeps_its_height_and_is_stretched_in_time(rate: float, speed: float) -> None:
    time = np.arange(2000) / RATE
    tone = np.sin(2 * np.pi * 50.0 * time)
    track = track_of(tone, np.column_stack([tone, tone, tone]))
    played = played_at(track, rate, speed)
    assert played.rate == rate
    assert played.seconds == pytest.approx(2.0 / speed)
    expected = np.sin(2 * np.pi * 50.0 * speed * np.arange(len(played)) / rate)
    inner = slice(len(played) // 10, -len(played) // 10)
    # The resampler's pass band is flat within its 80 dB.
    assert played.acceleration[inner] == pytest.approx(expected[inner], abs=1e-3)
    assert played.position[inner, 1] == pytest.approx(expected[inner], abs=1e-3)


def test_lost_samples_stay_marked_when_resampled() -> None:
    track = gridded(numbered([place for place in range(1000) if place != 400]), None, None, RATE)
    assert set(np.flatnonzero(played_at(track, 2000.0).lost)) == {799, 800, 801}


def test_a_loop_goes_smoothly_from_its_end_to_its_beginning() -> None:
    time = np.arange(1000) / RATE
    path = np.column_stack([0.1 * time, 0 * time, 0.01 * np.cos(time)])
    track = looped(track_of(np.random.default_rng(0).normal(size=1000), path))
    assert len(track) == 1000 - round(FADE * RATE)
    twice = np.concatenate([track.position, track.position])
    steps = np.abs(np.diff(twice[:, 0])).max()
    # 95 mm in 50 ms on a raised cosine: at most pi/2 times the mean speed.
    assert steps < 1.05 * np.pi / 2 * 0.1 / (FADE * RATE)
    # The velocity is that of the path, also on the way back.
    assert track.velocity[1:-1, 0] == pytest.approx(
        np.gradient(track.position[:, 0])[1:-1] * RATE, abs=0.05
    )


def test_an_end_brings_the_acceleration_to_rest_and_the_arm_to_a_stop() -> None:
    acceleration = np.full(600, 0.5)
    acceleration[-100:] = 20.0
    path = np.column_stack([np.arange(600) * 1e-4] * 3)
    track = quieted(track_of(acceleration, path))
    assert len(track) == 600 + round((FADE + QUIET) * RATE)
    assert np.abs(np.diff(track.acceleration[599:])).max() < 20.0 * np.pi / 2 / (FADE * RATE)
    assert (track.acceleration[-round(QUIET * RATE) :] == 0.5).all()
    assert (track.position[600:] == path[-1]).all()
    assert not track.velocity[-1].any()


# The rig


def test_it_waits_at_rest_for_its_first_force_and_plays_from_the_next_sample_on() -> None:
    acceleration = np.concatenate([np.arange(1.0, 101.0), np.full(200, 0.25)])
    rig = ReplayRig(track_of(acceleration, np.full((300, 3), 0.02)))
    for index in range(10):
        rig.advance(7.0 + index / RATE)
        sample = rig.measure()
        assert sample[:3] == ((0.02, 0.02, 0.02), ZERO, along_actuator(0.25))
    rig.apply_arm_force(ZERO)
    rig.advance(7.0105)
    played = []
    for index in range(300):
        rig.advance(7.011 + index / RATE)
        assert not rig.ended
        played.append(rig.measure().acceleration[ACTUATOR_AXIS])
    assert np.array_equal(played, acceleration)
    assert rig.ended


@given(st.sets(st.integers(1, 298)), st.booleans())
def test_a_tick_that_is_missed_costs_its_sample_and_no_other_and_a_loop_never_ends(
    missed: set[int], loop: bool
) -> None:
    rig = ReplayRig(track_of(np.arange(300.0)), loop=loop)
    rig.apply_arm_force(ZERO)
    for index in sorted({*range(1000 if loop else 300)} - missed):
        rig.advance(index / RATE)
        assert rig.measure().acceleration[ACTUATOR_AXIS] == index % 300
    assert rig.ended is not loop
    assert rig.counters()["samples_skipped"] == len(missed)


def test_forces_are_counted_and_change_nothing_and_lost_samples_are_counted_once() -> None:
    lost = np.zeros(300, dtype=bool)
    lost[5:8] = True
    one = ReplayRig(Track(RATE, np.arange(300.0), np.zeros((300, 3)), np.zeros((300, 3)), lost))
    one.apply_arm_force((3.0, 0.0, 0.0))
    one.apply_actuator_force(along_actuator(2.0))
    one.release()
    for index in range(300):
        one.advance(index / RATE)
        for _ in range(2):
            assert one.measure()[:3] == (ZERO, ZERO, along_actuator(index))
    assert one.counters() == {
        "samples_lost_in_recording": 3,
        "samples_skipped": 0,
        "arm_forces_ignored": 1,
        "actuator_forces_ignored": 1,
    }


def test_the_shortest_track_can_be_looped() -> None:
    assert len(looped(track_of(np.ones(round(SHORTEST * RATE))))) > 0


# In a trial


def test_a_trial_plays_the_track_after_its_first_force_whatever_the_surface_and_seed() -> None:
    track = track_of(np.random.default_rng(2).normal(size=300))
    trials = [run_trial("constant", duration=0.3, seed=seed, replayed=track) for seed in (0, 1)]
    for trial in trials:
        # The first force comes at once, and takes effect one sample later.
        expected = [track.rest, track.rest, *track.acceleration[:-2]]
        assert trial.tool_acceleration.tolist() == expected
    assert np.array_equal(trials[0].actuator_force, trials[1].actuator_force)
    with pytest.raises(ParameterError, match="rate = 2000: must be 1000 Hz"):
        run_trial("constant", duration=0.3, rate=2000.0, replayed=track)

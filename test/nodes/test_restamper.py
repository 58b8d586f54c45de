# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""`ros2 bag play` in the slave's place, beside the replay device."""

from __future__ import annotations

import itertools
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bag_maker import NANOSECONDS, BagContent, write_bag
from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.core import topics
from haptic_accel.nodes.restamper import LEAD, LISTENING, PACE_TIME, PaceError, StampShift
from running import BAG_PLAYER, Start

RATE = 200.0
"""Rate of what is played, Hz: a busy machine then rarely misses a sample."""

SECONDS = 3.0
"""Length of what is played, s."""

MEMORY = 0.3
"""Time after which the paper's high-pass has forgotten a lost sample but for some 1e-5, s."""


def tool_acceleration() -> np.ndarray:
    """Return a texture of three tones that the constant gain follows, quiet for half a second."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    tones = [np.sin(2 * np.pi * frequency * time) for frequency in (61.0, 74.0, 85.0)]
    return np.where(time < 0.5, 0.0, 2.0 * np.sum(tones, axis=0))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag at `RATE` that knows nothing but the slave's signals."""
    samples = round(SECONDS * RATE)
    turn = np.linspace(0.0, 2 * np.pi, samples)
    path = 0.01 * np.column_stack([1 - np.cos(turn), np.zeros(samples), -np.sin(turn)])
    signals = {
        topics.TOOL_ACCELERATION.name: tool_acceleration(),
        topics.SLAVE_POSITION.name: path,
        topics.SLAVE_VELOCITY.name: np.gradient(path, axis=0) * RATE,
    }
    return write_bag(tmp_path / "played", BagContent(signals, RATE, arms=False))


def desired_by_sample(recorded: Bag) -> dict[int, float]:
    """Return the desired acceleration by sample of the bag, where nothing was lost before."""
    played = {value: place for place, value in enumerate(tool_acceleration().tolist()) if value}
    tool = recorded.signals[topics.TOOL_ACCELERATION.name]
    rows = list(zip(tool.stamps.tolist(), tool.values[:, 2].tolist(), strict=True))
    stamps: dict[int, int] = {}
    for stamp, value in rows:
        if value in played:
            stamps.setdefault(played[value], stamp)
    # What was played is what was recorded, to the last bit, until the device fades out.
    last = max(stamps.values())
    assert all(value in played for stamp, value in rows if value and stamp <= last)
    signal = recorded.signals[topics.DESIRED_ACCELERATION.name]
    desired = dict(zip(signal.stamps.tolist(), signal.values[:, 2].tolist(), strict=True))
    period, memory = NANOSECONDS / RATE, round(MEMORY * RATE)

    def follows(place: int) -> bool:
        """Return True if a sample came one period after the one before it."""
        return abs(stamps[place] - stamps.get(place - 1, 0) - period) < period / 2

    return {
        place: desired[stamp]
        for place, stamp in stamps.items()
        if stamp in desired
        and all(each in stamps and follows(each) for each in range(place - memory, place + 1))
    }


@pytest.mark.slow
def test_the_device_and_played_topics_give_the_controller_the_same_input(
    haptic_accel: Start, start: Start, bag: Path, tmp_path: Path
) -> None:
    words = ("replay", bag, "controller:=constant", "rig:=ideal")
    by_device = haptic_accel(*words, "output:=device")
    assert by_device.end() == 0, by_device.text
    assert "Traceback" not in by_device.text
    by_topics = haptic_accel(*words, "source:=topics", "output:=topics")
    by_topics.wait_for("ros2 bag play .* --remap")
    by_topics.wait_for("ready: play")
    player = start(BAG_PLAYER, bag)
    assert player.end() == 0, player.text
    assert by_topics.end(signal.SIGINT) == 0, by_topics.text
    assert "a clock was set" not in by_topics.text

    from_device, from_topics = (read_bag(tmp_path / name) for name in ("device", "topics"))
    one, other = desired_by_sample(from_device), desired_by_sample(from_topics)
    both = sorted(one.keys() & other.keys())
    assert len(both) > 50
    scale = np.std(tool_acceleration())
    for place in both:
        assert other[place] == pytest.approx(one[place], abs=1e-3 * scale)
    check_what_was_recorded(from_device, bag, "replay")
    check_what_was_recorded(from_topics, bag, "topics")
    # The end brings the actuator to rest before the graph ends.
    force = from_device.signals[topics.ACTUATOR_FORCE.name].values[:, 2]
    assert np.abs(force).max() > 0.1
    assert np.abs(force[-10:]).max() < 1e-3


@pytest.mark.slow
def test_a_bag_played_at_another_speed_is_refused_in_one_line(
    haptic_accel: Start, start: Start, bag: Path
) -> None:
    graph = haptic_accel("replay", bag, "source:=topics", "controller:=none", "output:=result")
    graph.wait_for("ready: play")
    player = start(BAG_PLAYER, bag, "0.5")
    assert graph.end() == 1
    assert re.search(r"/played: stamps advance by 0\.\d+ s per second: must be played", graph.text)
    assert "Traceback" not in graph.text
    assert "is not held" not in graph.text
    player.end(signal.SIGINT)


def check_what_was_recorded(recorded: Bag, bag: Path, slave: str) -> None:
    """Check that a bag says what was replayed, and that every force was caused by a sample."""
    assert recorded.metadata["arguments"]["replay"] == str(bag)
    assert recorded.metadata["arguments"]["slave"] == slave
    desired = recorded.signals[topics.DESIRED_ACCELERATION.name]
    force = recorded.signals[topics.ACTUATOR_FORCE.name]
    caused = dict(zip(desired.stamps.tolist(), desired.values[:, 2], strict=True))
    both = zip(force.stamps.tolist(), force.values[:, 2], strict=True)
    pairs = [(caused[stamp], value) for stamp, value in both if stamp in caused]
    # Table I: the constant gain is the 0.128 kg of handle and hand.
    assert all(value == pytest.approx(0.128 * cause, abs=1e-12) for cause, value in pairs)
    # Moved stamps keep the bag's spacing exactly.
    if slave == "topics":
        stamps = recorded.signals[topics.TOOL_ACCELERATION.name].stamps
        assert set(np.diff(stamps) % round(NANOSECONDS / RATE)) == {0}


PERIOD = 1_000_000
LIMIT = 100 * PERIOD
AHEAD = LEAD + 2 * PERIOD + LIMIT
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


def test_what_was_held_up_all_the_time_that_it_listened_keeps_its_offset() -> None:
    shifted = shift()
    for place in range(1000):
        held_up = 30 * PERIOD if place < 2 * FIRST else 0
        arrival = NOW + place * PERIOD + held_up
        moved = shifted.moved(THEN + place * PERIOD, arrival)
    assert moved == arrival + 30 * PERIOD + LEAD
    assert shifted.anchored == 1


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


@pytest.mark.parametrize("speed", [0.9, 1.1])
def test_a_player_that_is_nearly_right_is_followed_and_noticed(speed: float) -> None:
    shifted = shift()
    for place in range(5000):
        arrival = NOW + round(place * PERIOD / speed)
        moved = shifted.moved(THEN + place * PERIOD, arrival)
        if moved is not None:
            assert -AHEAD <= arrival - moved <= LIMIT
    assert shifted.anchored > 3


@pytest.mark.parametrize("speed", [0.1, 0.5, 2.0, 10.0])
def test_another_speed_is_refused_before_any_sample_is_used(speed: float) -> None:
    shifted = shift()

    def moved(place: int) -> int | None:
        return shifted.moved(THEN + place * PERIOD, NOW + round(place * PERIOD / speed))

    first = round(PACE_TIME / PERIOD * speed)
    assert not any(moved(place) for place in range(first))
    with pytest.raises(PaceError, match=f"advance by {speed:.2g} s per second: must be played"):
        moved(first)


@pytest.mark.parametrize("advance", [[2600 * PERIOD], [0], [PERIOD, -PERIOD, 10 * PERIOD]])
def test_stamps_that_no_player_sends_end_no_node(advance: list[int]) -> None:
    shifted = shift()
    stamps = itertools.accumulate(itertools.cycle(advance), initial=THEN)
    times = range(NOW, NOW + 3 * PACE_TIME, PERIOD)
    assert not any(shifted.moved(stamp, now) for stamp, now in zip(stamps, times, strict=False))


def test_samples_that_come_early_move_no_stamp_back() -> None:
    shifted = shift()
    last = 0
    for place in range(3000):
        # A busy machine holds the first up, each later group for less.
        held_up = max(0, 40 - place // 60) * PERIOD
        moved = shifted.moved(THEN + place * PERIOD, NOW + place * PERIOD + held_up)
        if moved is not None:
            assert moved > last
            last = moved
    assert shifted.anchored == 1

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Order and times of samples where messages are out of order or a clock was set."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from haptic_accel.bags.timeline import Arrivals, Timeline, timeline

PERIOD, SAMPLES, START = 1_000_000, 4000, 10**18
SECOND = 10**9

Change = Callable[[np.ndarray], np.ndarray]  # type: ignore[type-arg]


def made(changes: dict[str, Change], rate: float | None = 1000.0) -> Timeline:
    """Return the timeline of topics whose stamps were changed; ``both`` changes all."""
    steady = START + PERIOD * np.arange(SAMPLES, dtype=np.int64)
    topics = {}
    for number, name in enumerate(("tool", "handle", "force")):
        change = changes.get(name, changes.get("all", lambda stamps: stamps))
        places = 3 * np.arange(SAMPLES, dtype=np.int64) + number
        marks = np.random.default_rng(number).integers(0, 2**60, SAMPLES)
        topics[name] = Arrivals(change(steady.copy()), places, marks)
    return timeline(topics, rate)


def after(share: float, by: int) -> Change:
    def change(stamps: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        stamps[round(share * SAMPLES) :] += by
        return stamps

    return change


def placed(index: int, stamp: Callable[[int], int]) -> Change:
    """Give a sample the stamp that a function makes of its own."""

    def change(stamps: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        stamps[index] = stamp(int(stamps[index]))
        return stamps

    return change


@pytest.mark.parametrize("back", [0.001, 0.0123456, 0.5, 0.5004, 1.9, 3.0, 10.0, 3600.0])
def test_a_clock_that_is_set_back_changes_no_order(back: float) -> None:
    found = made({"all": after(0.5, -round(back * SECOND))})
    for name in ("tool", "handle", "force"):
        assert found.chosen[name].tolist() == list(range(SAMPLES))
        assert set(np.diff(found.stamps[name])) == {PERIOD}
    (line,) = found.notes
    assert f"set back by {back:.4g} s at 2.0 s" in line


def test_each_of_several_steps_is_followed() -> None:
    found = made({"all": lambda stamps: after(0.75, -SECOND)(after(0.25, -2 * SECOND)(stamps))})
    assert found.chosen["tool"].tolist() == list(range(SAMPLES))
    assert len(found.notes) == 2


def test_other_times_move_with_the_samples() -> None:
    found = made({"all": after(0.5, -3 * SECOND)})
    places = np.array([0, 3 * SAMPLES // 2, 3 * SAMPLES - 1])
    times = np.array([START, START - SECOND, START + SECOND])
    assert found.moved(times, places).tolist() == [START, START + 2 * SECOND, START + 4 * SECOND]


def test_a_topic_with_a_clock_of_its_own_is_left_out_from_its_step_on() -> None:
    found = made({"handle": after(0.5, -SECOND)})
    assert [len(found.stamps[name]) for name in ("tool", "handle", "force")] == [4000, 2000, 4000]
    assert "handle: its stamps go back by 1 s, unlike" in found.notes[0]


@pytest.mark.parametrize("index", [0, 1, 1234, SAMPLES - 1])
@pytest.mark.parametrize("stamp", [0, START + SECOND // 4, START - 9**18, 2**62])
def test_a_stamp_far_from_its_neighbours_is_left_out(index: int, stamp: int) -> None:
    found = made({"tool": placed(index, lambda _: stamp)})
    assert len(found.notes) == 1
    for name in ("handle", "force"):
        assert len(found.stamps[name]) == SAMPLES
    assert index not in found.chosen["tool"] or stamp == START + SECOND // 4


@pytest.mark.parametrize("rate", [-1e-3, -5e-4, 5e-4, 1e-3, 0.05])
def test_samples_of_a_slewed_clock_are_counted(rate: float) -> None:
    def change(stamps: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        stamps[1000:] += np.round((stamps[1000:] - stamps[1000]) * rate).astype(np.int64)
        return stamps

    found = made({"all": change})
    assert np.abs(np.diff(found.stamps["tool"]) - PERIOD).max() <= 1
    assert "its clock ran at another rate than its samples" in found.notes[0]


@pytest.mark.parametrize("share", [0.05, 0.3, 0.49, 0.51, 0.95])
def test_a_last_message_beside_the_grid_is_no_slewed_clock(share: float) -> None:
    beside = placed(-1, lambda last: last - PERIOD + round(share * PERIOD))
    assert made({"tool": beside}).notes == []


def test_gaps_and_jitter_stay_as_they_are() -> None:
    jitter = np.random.default_rng(0).integers(-200_000, 200_000, SAMPLES)

    def change(stamps: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        return after(0.3, 5 * SECOND)(stamps + jitter)

    found = made({"all": change})
    expected = change(START + PERIOD * np.arange(SAMPLES, dtype=np.int64))
    assert (found.notes, found.stamps["tool"].tolist()) == ([], expected.tolist())


@pytest.mark.parametrize("by", [-PERIOD, -2 * PERIOD, 0])
def test_a_message_that_is_sent_again_costs_no_other(by: int) -> None:
    found = made({"force": placed(1000, lambda stamp: stamp + by)})
    doubled = {1000 + by // PERIOD} - {1000}
    assert set(range(SAMPLES)) - set(found.chosen["force"].tolist()) == doubled
    assert len(found.notes) == len(doubled)


def test_a_step_and_a_message_sent_again_are_told_apart() -> None:
    step, again = after(0.5, -3 * SECOND), placed(1000, lambda stamp: stamp - PERIOD)
    found = made({"force": lambda stamps: step(again(stamps)), "all": step})
    assert [len(found.chosen[name]) for name in ("tool", "handle", "force")] == [4000, 4000, 3999]
    assert [line[:24] for line in found.notes] == [
        "its clock was set back b",
        "force: 1 messages have t",
    ]

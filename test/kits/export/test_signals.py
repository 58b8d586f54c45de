# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of a learning set: windows of known signals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exported import START, Recorded, write_bag
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import measured
from haptic_accel.bags.reading import Bag, Signal, read_bag
from haptic_accel.core import topics
from haptic_accel.core.evaluation.metrics import indistinguishable
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import resampled
from haptic_accel.kits.export.signals import FrameRate, engagements, frames_of, recorded_rate
from haptic_accel.kits.export.sound import write_wav

SECONDS, RATE = 4.0, 1000.0
TIME = np.arange(int(SECONDS * RATE)) / RATE
BEGIN, END = START + 1_000_000_000, START + 3_000_000_000


def bag(tool: FloatArray, *, slave_late: float = 0.0) -> Bag:
    """Return a bag of four seconds; positions are their time, in s."""
    stamps = START + np.round(TIME * 1e9).astype(np.int64)
    none = np.array([], np.int64)

    def signal(along: FloatArray, late: float = 0.0) -> Signal:
        vectors = np.zeros((len(TIME), 3))
        vectors[:, 2] = along
        return Signal(stamps + round(late * 1e9), none, vectors)

    found = Bag(Path("bag"))
    for topic in (topics.MASTER_POSITION, topics.MASTER_VELOCITY):
        found.signals[topic.name] = signal(TIME)
    for topic in (topics.SLAVE_POSITION, topics.SLAVE_VELOCITY):
        found.signals[topic.name] = signal(TIME, slave_late)
    found.signals[topics.TOOL_ACCELERATION.name] = signal(tool, slave_late)
    found.signals[topics.HANDLE_ACCELERATION.name] = signal(-tool)
    return found


def test_windows_one_after_the_other_are_the_signal_since_the_start() -> None:
    tone = np.sin(2 * np.pi * 100 * TIME)
    found = frames_of(bag(tone), BEGIN, END, FrameRate.of(30, 0.0, RATE))
    assert found.tool.shape == found.handle.shape == (60, 32, 1)
    at = 1.0 + np.arange(60 * 32) / 960  # from the start of the period
    assert found.tool.ravel() == pytest.approx(np.sin(2 * np.pi * 100 * at), abs=2e-4)
    assert np.array_equal(found.handle, -found.tool)


def test_at_the_recorded_rate_samples_are_those_of_the_bag() -> None:
    noise = np.random.default_rng(1).normal(size=len(TIME))
    found = frames_of(bag(noise), BEGIN, END, FrameRate.of(50, 0.0, RATE))
    assert found.tool.shape == (100, 20, 1)
    assert np.array_equal(found.tool.ravel(), noise[1000:3000].astype(np.float32))


def test_a_state_is_the_last_one_at_the_time_of_the_frame() -> None:
    found = frames_of(bag(TIME), BEGIN, END, FrameRate.of(50, 0.0, RATE))
    expected = 1.0 + np.arange(1, 101) / 50
    assert found.state[:, 2] == pytest.approx(expected, abs=1e-6)
    assert found.action[:, 5] == pytest.approx(expected, abs=1e-6)
    assert found.notes == []


def test_missing_and_infinite_samples_repeat_the_one_before_and_are_counted() -> None:
    tone = np.sin(2 * np.pi * 50 * TIME)
    damaged = bag(tone)
    tool = damaged.signals[topics.TOOL_ACCELERATION.name]
    tool.values[1500, 2] = np.nan
    kept = np.delete(np.arange(len(TIME)), np.arange(2000, 2010))
    lossy = Signal(tool.stamps[kept], tool.received, tool.values[kept])
    damaged.signals[topics.TOOL_ACCELERATION.name] = lossy
    found = frames_of(damaged, BEGIN, END, FrameRate.of(50, 0.0, RATE))
    expected = tone[1000:3000].copy()
    expected[500] = tone[1499]
    expected[1000:1010] = tone[1999]
    assert np.array_equal(found.tool.ravel(), expected.astype(np.float32))
    assert found.notes == ["tool_acceleration: 11 of 2000 samples repeat the one before"]


@pytest.mark.parametrize("late", [-100.0, 2.5, 86_400.0])
def test_clocks_that_disagree_are_refused(late: float) -> None:
    with pytest.raises(ParameterError, match=r"^bag: (slave|tool)_.*(clocks|no samples)"):
        frames_of(bag(TIME, slave_late=late), BEGIN, END, FrameRate.of(30, 0.0, RATE))


def test_years_without_samples_are_refused_before_they_take_memory(tmp_path: Path) -> None:
    years = 40 * 365 * 86_400
    with measured(), pytest.raises(ParameterError, match="clocks"):
        frames_of(bag(TIME), BEGIN, END + years * 10**9, FrameRate.of(30, 0.0, RATE))
    with measured(), pytest.raises(ParameterError, match="clocks"):
        write_wav(bag(TIME, slave_late=years), tmp_path)


@given(st.integers(1, 1000), st.floats(10.0, 20_000.0))
def test_a_frame_has_a_whole_number_of_samples_at_no_more_than_the_recorded_rate(
    fps: int, recorded: float
) -> None:
    if recorded < fps:
        with pytest.raises(ParameterError, match="^fps = "):
            FrameRate.of(fps, 0.0, recorded)
        return
    found = FrameRate.of(fps, 0.0, recorded)
    assert recorded / 2 < found.rate <= recorded
    assert found.samples * fps == found.rate


@pytest.mark.parametrize("rate", [1000.0, 45.0, 10.0, 1020.0])
def test_a_rate_that_is_no_multiple_or_too_high_is_refused(rate: float) -> None:
    with pytest.raises(ParameterError, match="multiple of fps = 30, at most 990$"):
        FrameRate.of(30, rate, 1000.0)


def test_resampling_reaches_beyond_a_sample_as_far_as_it_is_stated() -> None:
    impulse = np.zeros(4000)
    impulse[2000] = 1.0
    rates = FrameRate.of(30, 0.0, RATE)
    at = np.flatnonzero(resampled(impulse, RATE, rates.rate)) / rates.rate - 2.0
    assert -rates.look_ahead - 1e-9 <= at.min() <= -rates.look_ahead + 2e-3
    assert FrameRate.of(50, 0.0, RATE).look_ahead == 0.0


@pytest.mark.parametrize("surface", ["plywood", "text", "vinyl"])
def test_a_hand_cannot_tell_exported_windows_from_the_recording(
    tmp_path: Path, surface: str
) -> None:
    write_bag(tmp_path / "bag", surface=surface)
    found = read_bag(tmp_path / "bag")
    ((begin, end),) = engagements(found)
    frames = frames_of(found, begin, end, FrameRate.of(30, 0.0, RATE))
    both = ((frames.tool, topics.TOOL_ACCELERATION), (frames.handle, topics.HANDLE_ACCELERATION))
    for windows, topic in both:
        back = resampled(windows.ravel().astype(float), 960.0, RATE)
        desired, _ = found.signals[topic.name].on_grid(begin, RATE, len(back))
        assert indistinguishable(desired, back, RATE) >= 0.99


def test_tool_and_handle_must_have_one_rate(recorded: Recorded) -> None:
    found = read_bag(recorded.path)
    assert recorded_rate(found) == RATE
    handle = found.signals[topics.HANDLE_ACCELERATION.name]
    slower = Signal(handle.stamps[::2], handle.received[::2], handle.values[::2])
    found.signals[topics.HANDLE_ACCELERATION.name] = slower
    found.metadata.clear()
    with pytest.raises(ParameterError, match="1000 and 500 Hz: must have one rate"):
        recorded_rate(found)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals that the scope keeps and derives, against known answers."""

from __future__ import annotations

import struct
import time
import warnings
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from fuzzing import fuzz
from haptic_accel.core.axes import Axes
from haptic_accel.core.control.filters import high_pass, without_hand_motion
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import Suspension
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import TravelEstimator
from haptic_accel.scope import windows
from haptic_accel.scope.state import PLOTS, SAMPLES, TRACES, Cursor, plots_frame, vectors_frame
from nightly import rest_slow
from running import wait_until

START = 1_800_000_000 * NANOSECONDS
RATE = 1000.0
MILLISECOND = NANOSECONDS // 1000


def put(values: Iterable[float], *rings: windows.Ring, first: int = 0) -> None:
    """Put one value a millisecond into rings."""
    for index, value in enumerate(values, first):
        for ring in rings:
            ring.put(START + index * MILLISECOND, value)


@given(
    st.lists(st.lists(st.integers(0, 2**40), max_size=30), max_size=12),
    st.integers(4, 40),
    st.booleans(),
)
def test_who_keeps_up_gets_every_sample_once_and_in_order(
    bursts: list[list[int]], capacity: int, by_block: bool
) -> None:
    ring = windows.Ring(capacity)
    readable = int(capacity / windows.SLACK)
    count, put, got = 0, [], []
    for burst in bursts:
        if by_block:
            ring.extend(np.array(burst, np.int64), np.array(burst, float) / 2)
        else:
            for stamp in burst:
                ring.put(stamp, stamp / 2)
        put += burst
        count, stamps, values = ring.since(count)
        expected = burst[-readable:]
        assert stamps.tolist() == expected
        assert values.tolist() == [stamp / 2 for stamp in expected]
        got += stamps.tolist()
        assert ring.newest == (put[-1] if put else 0)
    if all(len(burst) <= readable for burst in bursts):
        assert got == put


@given(st.integers(0, 200), st.floats(0.0, 0.3))
def test_the_last_seconds_end_with_the_newest_sample(samples: int, seconds: float) -> None:
    ring = windows.Ring(1000)
    put(range(samples), ring)
    stamps, values = ring.last(seconds)
    expected = min(samples, int(seconds * NANOSECONDS) // MILLISECOND + 1)
    assert values.tolist() == list(range(samples - expected, samples))
    assert len(stamps) == expected


def test_after_a_clock_was_set_back_only_what_came_since_counts() -> None:
    ring = windows.Ring(1000)
    put([1.0] * 2, ring)
    put([2.0] * 100, ring, first=-100_000)
    _, values = ring.last(0.05)
    assert values.tolist() == [2.0] * 51


@pytest.mark.parametrize("rate", [50.0, 1000.0, 2048.0, 20000.0])
def test_the_rate_is_told_by_stamps_that_are_a_little_off(rate: float) -> None:
    ring = windows.Ring()
    off = np.random.default_rng(0).normal(0.0, 2e3, 600)
    for index in range(600):
        ring.put(START + int(index / rate * NANOSECONDS + off[index]), 0.0)
    assert windows.live_rate(ring) == pytest.approx(rate, rel=2e-2)


def test_there_is_no_rate_of_few_or_of_equal_stamps() -> None:
    ring = windows.Ring()
    assert windows.live_rate(ring) is None
    for _ in range(100):
        ring.put(START, 0.0)
    assert windows.live_rate(ring) is None


stamp_lists = st.lists(st.integers(0, 60), unique=True, max_size=40).map(sorted)


@given(stamp_lists, stamp_lists, st.integers(0, 3))
def test_pairs_are_those_of_equal_ticks_shifted(
    desired: list[int], actual: list[int], shift: int
) -> None:
    jitter = np.random.default_rng(1)

    def stamps(ticks: list[int]) -> np.ndarray:
        off = jitter.integers(-20_000, 20_000, len(ticks))
        return START + np.array(ticks, np.int64) * MILLISECOND + off

    signals = stamps(desired), np.array(desired, float), stamps(actual), np.array(actual, float)
    first, second = windows.paired(*signals, shift, RATE)
    expected = [tick for tick in desired if tick + shift in actual]
    assert first.tolist() == expected
    assert second.tolist() == [tick + shift for tick in expected]


@given(stamp_lists, stamp_lists)
def test_a_command_holds_until_the_next_and_not_for_ever(
    commands: list[int], moments: list[int]
) -> None:
    spread = 5  # ms between ticks, so that some are older than a command lives
    values = windows.held(
        START + spread * MILLISECOND * np.array(commands, np.int64),
        np.array(commands, float) + 1.0,
        START + spread * MILLISECOND * np.array(moments, np.int64),
        RATE,
    )
    alive = int(windows.HELD * 1e3) // spread
    expected = []
    for moment in moments:
        before = [tick for tick in commands if moment - alive <= tick <= moment]
        expected.append(before[-1] + 1.0 if before else 0.0)
    assert values.tolist() == expected


def filled(
    seconds: float,
    gravity: float = 9.81,
    gain: float = 0.8,
    delay: int = 2,
    amplitude: float = 3.0,
) -> tuple[windows.Windows, np.ndarray, np.ndarray]:
    """Return windows with a known texture, and the handle's acceleration and force."""
    made = windows.Windows()
    count = int(seconds * RATE)
    noise = np.random.default_rng(2).normal(0.0, amplitude, count)
    texture = signal.sosfilt(high_pass(15.0, RATE), noise)
    stroke = 2.0 * np.sin(2 * np.pi * 0.7 * np.arange(count) / RATE)
    handle = gravity + stroke + gain * np.roll(texture, delay)
    force = 0.1 * texture
    for index in range(count):
        stamp = START + index * MILLISECOND
        made.desired.put(stamp, texture[index])
        made.handle.put(stamp + 3000, handle[index])
        made.force.put(stamp, force[index])
        made.age.put(stamp, 200e-6 if index % 50 else 900e-6)
    return made, handle, force


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_metrics_are_those_of_a_known_gain_without_gravity_and_strokes(latency: int) -> None:
    made, _, _ = filled(4.0, delay=latency + 1)
    made.settings = windows.GraphSettings(latency=latency)
    metrics = made.metrics()
    values = metrics.values
    assert values["rate"] == RATE
    # Actual is 0.8 of desired after the latency and one sample: 20 % are missing.
    assert values["nrmse_percent"] == pytest.approx(20.0, abs=1.0)
    assert values["slope"] == pytest.approx(1 / 0.8, rel=0.03)
    assert values["r2"] > 0.98
    assert values["indistinguishable_percent"] > 98.0  # 0.8 is 2 dB, which no hand notices
    assert values["rms_desired"] == pytest.approx(3.0, rel=0.05)
    assert values["age_p50"] == pytest.approx(200e-6)
    assert values["age_p99"] == pytest.approx(900e-6)
    assert metrics.spectra is not None
    # White noise of 3 m/s^2 over 500 Hz.
    density = np.median(metrics.spectra.desired)
    assert density == pytest.approx(3.0 / np.sqrt(500.0), rel=0.15)
    assert len(metrics.desired) == len(metrics.actual) <= windows.CLOUD_POINTS


def test_what_is_drawn_has_no_gravity_and_is_near_the_filter_without_phase() -> None:
    made, handle, _ = filled(4.0)
    made.advance()
    _, actual = made.actual.last(4.0)
    assert len(actual) == len(handle)
    assert abs(np.mean(actual)) < 0.05
    reference = without_hand_motion(handle, 15.0, RATE)
    error = (actual - reference)[1000:-1000]
    assert np.std(error) < 0.25 * np.std(reference[1000:-1000])


@settings(max_examples=20)
@given(st.lists(st.integers(1, 200), min_size=1, max_size=5))
def test_derived_in_whatever_steps_the_result_is_the_same(steps: list[int]) -> None:
    source, handle, force = filled(sum(steps) / RATE + 0.2)
    made, at = windows.Windows(), 0
    _, stamps, _ = source.handle.since(0)
    for step in [100, *steps]:
        for index in range(at, at + step):
            made.force.put(int(stamps[index]), force[index])
            made.handle.put(int(stamps[index]), handle[index])
        at += step
        made.advance()
    estimator = TravelEstimator(Suspension(), RATE)
    # A force acts from one sample after its cause on, the latency.
    acting = [0.0, *force[: at - 1]]
    expected = [estimator.observe(*pair) for pair in zip(acting, handle[:at], strict=True)]
    _, _, travel = made.travel.since(0)
    assert travel == pytest.approx(np.array(expected), abs=1e-12)


def test_a_sample_waits_for_the_force_that_acts_with_it() -> None:
    made, _, _ = filled(0.2)
    made.handle.put(START + 201 * MILLISECOND, 0.0)
    made.advance()
    assert made.travel.count == 200
    made.force.put(START + 201 * MILLISECOND, 1.0)
    made.advance()
    assert made.travel.count == 201


def test_without_a_compensator_travel_is_derived_without_force() -> None:
    made = windows.Windows()
    put([9.81] * 1000, made.handle)
    made.advance()
    # The static sag of the actuator on its spring, m_a g / k_s.
    assert made.travel.last(0.0)[1] == pytest.approx(-0.018 * 9.81 / 266.0, rel=1e-2)


def test_a_tool_that_touches_nothing_has_no_error() -> None:
    # The noise of an accelerometer of 250 ug/sqrt(Hz) over 500 Hz: 0.06 m/s^2.
    values = filled(4.0, amplitude=0.06)[0].metrics().values
    assert values["rms_desired"] == pytest.approx(0.06, rel=0.1)
    assert not {"nrmse_percent", "indistinguishable_percent", "slope", "r2"} & set(values)


def test_a_handle_that_shakes_by_itself_is_told_though_the_tool_touches_nothing() -> None:
    made = windows.Windows()
    put([0.0] * 4000, made.desired)
    put(np.sin(2 * np.pi * 150 * np.arange(4000) / RATE), made.handle)
    values = made.metrics().values
    assert "nrmse_percent" not in values
    assert values["indistinguishable_percent"] < 1.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_what_is_not_finite_is_no_metric_and_passes(bad: float) -> None:
    made, _, _ = filled(1.0)
    put([bad], made.handle, first=1000)
    put([0.0], made.force, first=1000)
    with np.errstate(all="ignore"):
        made.advance()
        assert "nrmse_percent" not in made.metrics().values
    put([0.0] * 7999, made.handle, made.force, first=1001)
    with np.errstate(all="ignore"):
        made.advance()
    put([0.0], made.handle, made.force, first=9000)
    made.advance()
    assert np.isfinite(made.actual.last(0.0)[1]).all()
    assert np.isfinite(made.travel.last(0.0)[1]).all()


def test_nothing_heard_gives_nothing_said() -> None:
    metrics = windows.Windows().metrics()
    assert metrics.values == {}
    assert metrics.spectra is None
    assert Cursor(windows.Windows()).frame() is None
    assert struct.unpack("<3I", plots_frame(windows.Metrics())) == (PLOTS, 0, 0)


def read_frame(frame: bytes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Read a frame of samples as the page does: times in s since 1970, and values."""
    kind, axis, *counts = struct.unpack_from("<8I", frame)
    assert kind == SAMPLES
    assert axis < 3
    (origin,) = struct.unpack_from("<d", frame, 44)
    blocks = np.frombuffer(frame, "<f4", offset=52)
    found, at = {}, 0
    for name, count in zip(TRACES, counts, strict=True):
        times = origin + blocks[at : at + count].astype(float)
        found[name] = (times, blocks[at + count : at + 2 * count])
        at += 2 * count
    assert at == len(blocks)
    return found


def test_frames_join_to_the_signals() -> None:
    source, _, _ = filled(1.0)
    made = windows.Windows()
    cursor, frames = Cursor(made), []
    _, stamps, desired = source.desired.since(0)
    for index in range(1000):
        made.desired.put(int(stamps[index]), desired[index])
        if index % 17 == 0 and (frame := cursor.frame()):
            frames.append(read_frame(frame))
    frames.append(read_frame(cursor.frame() or b""))
    values = np.concatenate([frame["desired"][1] for frame in frames])
    times = np.concatenate([frame["desired"][0] for frame in frames])
    assert values == pytest.approx(desired, abs=1e-5)
    assert times == pytest.approx(stamps / NANOSECONDS, abs=1e-6)


def test_who_comes_late_gets_the_longest_window_and_no_more() -> None:
    made = windows.Windows()
    put([0.0] * int(3 * windows.LONGEST_WINDOW * RATE), made.desired)
    frame = read_frame(Cursor(made).frame() or b"")
    assert len(frame["desired"][0]) == windows.LONGEST_WINDOW * RATE + 1


def test_a_signal_is_sent_from_when_it_is_chosen_until_it_is_not() -> None:
    made, _, _ = filled(0.1)
    put(range(10), made.position)
    cursor = Cursor(made)
    assert len(read_frame(cursor.frame() or b"")["position"][1]) == 0
    cursor.choose(["position"])
    put([10.0], made.position, first=10)
    assert read_frame(cursor.frame() or b"")["position"][1].tolist() == [10.0]
    cursor.choose([])
    put([11.0], made.position, first=11)
    assert cursor.frame() is None


def test_another_axis_comes_with_all_of_the_longest_window() -> None:
    made = windows.Windows()
    made.show_axes(Axes(("x", "z")))
    for place, one in enumerate(made.by_axis.values()):
        put(1000.0 * place + np.arange(100), one.desired)
    cursor = Cursor(made)
    for asked, axis, first in ([], 2, 1000.0), (["axis_x"], 0, 0.0), (["axis_y"], 2, 1000.0):
        cursor.choose(asked)
        frame = cursor.frame() or b""
        assert struct.unpack_from("<2I", frame) == (SAMPLES, axis)
        values = read_frame(frame)["desired"][1]
        assert values.tolist() == pytest.approx([first + index for index in range(100)])
        assert cursor.frame() is None


def test_what_a_page_may_not_receive_is_not_sent_though_it_asks() -> None:
    made, _, _ = filled(0.5)
    made.position.put(START, 1.0)
    made.vectors = {"tool": (1.0, 0.0, 2.0), "handle": (3.0, 0.0, 4.0)}
    cursor = Cursor(made, frozenset({"actual", "handle", "scene"}))
    for _ in range(2):
        frame = read_frame(cursor.frame() or b"")
        assert {name for name in TRACES if len(frame[name][1])} == {"actual"}
        cursor.choose(["position", "arm_force", "scene", "axis_x"])
        made.actual.put(made.actual.newest + MILLISECOND, 0.0)
    assert cursor.axis == made.axis
    x_and_z = np.frombuffer(cursor.vectors() or b"", "<f4", offset=4)
    assert x_and_z[np.isfinite(x_and_z)].tolist() == [3.0, 4.0]


def test_a_place_is_sent_however_far_it_is() -> None:
    frame = vectors_frame({"tool": (1e300, 0.0, -1e300), "handle": (np.nan, 0.0, np.inf)})
    found = np.frombuffer(frame, "<f4", offset=4)
    assert found[0] == -found[1] > 1e38
    assert np.isnan(found[2:5]).all()
    assert found[5] > 1e38


# Whatever comes

steps = st.one_of(
    st.just(MILLISECOND),
    st.sampled_from([0, 1, 10**5, 10**9, 10**12, -MILLISECOND, -(10**9), 2**61]),
    st.integers(-(2**62), 2**62),
)
values = st.floats(-windows.LARGEST_VALUE, windows.LARGEST_VALUE) | st.sampled_from(
    [windows.LARGEST_VALUE, -windows.LARGEST_VALUE, 0.0, 1e-320]
)
rings = st.sampled_from(["desired", "handle", "force", "age", "arm_force", "position"])
bursts = st.tuples(rings, st.integers(1, 120), steps, values)

LATEST = (2**31 - 1) * NANOSECONDS
"""Latest stamp that a message can have, ns."""

LONGEST_CASE = 5.0
"""Longest processor time in which frames and metrics are made of a few bursts, s."""


@fuzz
@given(st.lists(bursts, max_size=6))
def test_of_samples_with_any_stamps_frames_and_metrics_are_made(
    found: list[tuple[str, int, int, float]],
) -> None:
    made, stamp = windows.Windows(), START
    cursor = Cursor(made)
    begun = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name, count, step, value in found:
            for index in range(count):
                stamp = max(-LATEST, min(stamp + step, LATEST))
                getattr(made, name).put(stamp, value * (-1) ** index)
                if name == "handle":
                    made.desired.put(stamp, value)
            if frame := cursor.frame():
                read_frame(frame)
            metrics = made.metrics()
            assert np.isfinite(list(metrics.values.values())).all()
            plots_frame(metrics)
    assert time.process_time() - begun < LONGEST_CASE


@pytest.mark.slow
def test_an_input_that_no_motor_can_follow_has_a_high_lowest_error() -> None:
    def lowest(amplitude: float) -> float:
        made, _, _ = filled(4.0, amplitude=amplitude)
        made.settings = windows.GraphSettings(plant=Plant(), assumed=False)
        wait_until(lambda: "lowest_percent" in made.metrics().values, "the lowest error")
        return made.metrics().values["lowest_percent"]

    # At 1000 times the motor's acceleration almost all of the vibration is missing.
    gentle, violent = lowest(1.0), lowest(1e4)
    assert 0.0 < gentle < violent
    assert violent == pytest.approx(100.0, abs=1.0)


def test_without_a_plant_or_a_contact_there_is_no_lowest_error() -> None:
    made, _, _ = filled(4.0)
    assert "lowest_percent" not in made.metrics().values
    silent, _, _ = filled(4.0, amplitude=0.06)
    silent.settings = windows.GraphSettings(plant=Plant(), assumed=False)
    assert "lowest_percent" not in silent.metrics().values


@pytest.mark.parametrize("changed", rest_slow([True, False]))
def test_time_that_is_left_out_is_not_compared_and_no_time_for_a_new_controller(
    changed: bool,
) -> None:
    made, _, _ = filled(4.0)
    made.settings = windows.GraphSettings(plant=Plant(), assumed=False)
    wait_until(lambda: "lowest_percent" in made.metrics().values, "the lowest error")
    if changed:
        made.restart_comparison()
    made.leave_out(5 * NANOSECONDS)
    assert {"nrmse_percent", "lowest_percent"}.isdisjoint(made.metrics().values)

    rings = made.desired, made.handle, made.force
    # The stamps go on 5 s later, while the new controller only listens.
    put(np.sin(np.arange(500)), *rings, first=9000)
    assert "rms_desired" not in made.metrics().values
    put(np.sin(np.arange(1000)), *rings, first=9500)
    assert "nrmse_percent" in made.metrics().values
    assert "lowest_percent" not in made.metrics().values, "that of before the gap"

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded arms behind the interface of all devices: bags, CSV and WAV files."""

from __future__ import annotations

import struct
import wave
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bag_maker import START, BagContent, write_bag
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import Topic
from haptic_accel.core.track import FADE, QUIET
from haptic_accel.devices import Device, playback

RATE = 1000.0
PERIOD = 1 / RATE
SAMPLES = 600
TAIL = round((FADE + QUIET) * RATE)

Rows = dict[Topic, np.ndarray]

OF_MASTER = (topics.HANDLE_ACCELERATION, topics.MASTER_POSITION, topics.MASTER_VELOCITY)


def rows(samples: int = SAMPLES) -> Rows:
    """Return what both arms gave: each signal different, each sample different."""
    random = np.random.default_rng(4)
    played = (*topics.SLAVE_SIGNALS, *OF_MASTER)
    return {topic: random.normal(size=(samples, 3)) for topic in played}


def recorded(path: Path, signals: Rows | None = None, **others: Any) -> Path:
    """Return a bag of signals, those of `rows` unless told which."""
    found = rows() if signals is None else signals
    named = {topic.name: vectors for topic, vectors in found.items()}
    return write_bag(path, BagContent(named, RATE, arms=False, **others))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return recorded(tmp_path / "bag")


def opened(kind: type[Device], bag: Path, rate: float = RATE, **fields: Any) -> Device:
    device = kind(playback.ReplayParameters(str(bag), **fields), rate, 0)
    device.open()
    device.write(0.0, arm_force=(0.0, 0.0, 0.0))
    return device


def play(device: Device, samples: int = SAMPLES, rate: float = RATE) -> list[Any]:
    return [device.read(100.0 + index / rate) for index in range(samples)]


ARMS = [(playback.ReplaySlave, topics.SLAVE_SIGNALS), (playback.ReplayMaster, OF_MASTER)]


@pytest.mark.parametrize(("kind", "signals"), ARMS)
def test_every_sample_of_the_bag_comes_back_bit_by_bit(
    bag: Path, kind: type[Device], signals: tuple[Topic, ...]
) -> None:
    acceleration, position, velocity = (rows()[topic] for topic in signals)
    for index, sample in enumerate(play(opened(kind, bag))):
        assert sample.acceleration[ACTUATOR_AXIS] == acceleration[index, 2]
        assert sample.position == tuple(position[index])
        assert sample.velocity == tuple(velocity[index])


def test_lost_samples_hold_the_one_before_and_are_counted_and_told(tmp_path: Path) -> None:
    lost = {topic.name: {100, 101, 300} for topic in rows()}
    bag = recorded(tmp_path / "bag", dropped=lost)
    device = opened(playback.ReplaySlave, bag)
    played = play(device)
    expected = rows()[topics.TOOL_ACCELERATION][99, 2]
    pair = [sample.acceleration[ACTUATOR_AXIS] for sample in played[100:102]]
    assert pair == [expected, expected]
    assert device.counters()["samples_lost_in_recording"] == 3
    assert "3 missing samples repeat the previous one" in device.remark


def test_it_plays_from_where_the_arms_were_coupled(tmp_path: Path) -> None:
    forces = np.zeros((SAMPLES, 3))
    forces[250:] = 0.2
    pushed = rows() | {topics.SLAVE_ARM_FORCE: forces}
    late = {topics.SLAVE_ARM_FORCE.name: range(200)}
    bag = recorded(tmp_path / "bag", pushed, dropped=late)
    tool = rows()[topics.TOOL_ACCELERATION]
    assert play(opened(playback.ReplaySlave, bag))[0].acceleration[ACTUATOR_AXIS] == tool[200, 2]
    first = play(opened(playback.ReplaySlave, bag, start=0.1))[0]
    assert first.acceleration[ACTUATOR_AXIS] == tool[300, 2]
    assert playback.start_offset(read_bag(bag), 0.1) == pytest.approx(0.3)


def test_it_ends_after_its_rest_and_not_when_looped(bag: Path) -> None:
    once, looped = opened(playback.ReplaySlave, bag), opened(playback.ReplaySlave, bag, loop=True)
    play(once, SAMPLES + TAIL - 1)
    assert not once.ended
    last = play(once, SAMPLES + TAIL)[-1]
    assert once.ended
    assert last.acceleration[ACTUATOR_AXIS] == np.median(rows()[topics.TOOL_ACCELERATION][:, 2])
    assert last.velocity == (0.0, 0.0, 0.0)
    turn = SAMPLES - round(FADE * RATE)
    played = play(looped, 2 * turn)
    assert played[:turn] == played[turn:]
    assert not looped.ended


def test_forces_do_nothing_and_are_counted(bag: Path) -> None:
    quiet, pushed = opened(playback.ReplayMaster, bag), opened(playback.ReplayMaster, bag)
    pushed.write(0.0, arm_force=(3.0, 0.0, 0.0), actuator_force=along_actuator(6.0))
    assert play(pushed) == play(quiet)
    pushed.close()
    assert pushed.counters()["arm_forces_ignored"] == 2
    assert pushed.counters()["actuator_forces_ignored"] == 1


@pytest.mark.parametrize(("rate", "speed"), [(500.0, 1.0), (2000.0, 1.0), (1000.0, 2.0)])
def test_another_rate_or_speed_is_told(bag: Path, rate: float, speed: float) -> None:
    device = opened(playback.ReplaySlave, bag, rate, speed=speed)
    assert ("resampled from 1000 to" in device.remark) == (rate != RATE)
    assert ("2 times the speed" in device.remark) == (speed != 1.0)
    length = round(SAMPLES / RATE / speed * rate)
    play(device, length + round((FADE + QUIET) * rate) - 1, rate)
    assert not device.ended
    play(device, length + round((FADE + QUIET) * rate), rate)
    assert device.ended


def test_the_bag_s_own_word_on_its_rate_counts(tmp_path: Path) -> None:
    bag = recorded(tmp_path / "bag", metadata={"arguments": {"rate": 999.0}})
    assert playback.bag_rate(read_bag(bag)) == 999.0
    assert playback.bag_rate(read_bag(recorded(tmp_path / "other"))) == RATE


def test_a_file_of_a_bag_will_do_and_so_will_a_bag_without_motion(
    tmp_path: Path, bag: Path
) -> None:
    (file,) = bag.glob("*.mcap")
    assert play(opened(playback.ReplaySlave, file)) == play(opened(playback.ReplaySlave, bag))
    only = {topics.TOOL_ACCELERATION: rows()[topics.TOOL_ACCELERATION]}
    still = opened(playback.ReplaySlave, recorded(tmp_path / "still", only))
    assert {sample.position for sample in play(still)} == {(0.0, 0.0, 0.0)}
    assert "arm stands still" in still.remark


def test_csv_and_wav_files_are_played_too(tmp_path: Path) -> None:
    tone = np.sin(2 * np.pi * 40.0 * np.arange(1500) / 1000.0)
    table = tmp_path / "tone.csv"
    table.write_text("z\n" + "\n".join(f"{value:.9f}" for value in tone))
    sound = tmp_path / "tone.wav"
    with wave.open(str(sound), "wb") as file:
        file.setparams((1, 2, 1000, 0, "NONE", ""))
        file.writeframes(struct.pack("<1500h", *(tone * 668.0).astype(int)))
    of_table = playback.ReplayParameters(str(table), rate=1000.0, column="z")
    for parameters in (of_table, playback.ReplayParameters(str(sound))):
        device = playback.ReplaySlave(parameters, RATE, 0)
        device.write(0.0, arm_force=(0.0, 0.0, 0.0))
        played = [sample.acceleration[ACTUATOR_AXIS] for sample in play(device, 1500)]
        assert played == pytest.approx(tone, abs=2e-3)


def without_tool() -> Rows:
    return {topics.MASTER_POSITION: rows()[topics.MASTER_POSITION]}


@pytest.mark.parametrize(
    ("signals", "speed", "named"),
    [
        (None, 1.0, "nowhere: no such bag or file"),
        (without_tool(), 1.0, "has no message of slave/tool/acceleration"),
        (rows(1), 1.0, "rate not found"),
        (rows(50), 1.0, "start = 0"),
        (rows(), 10.0, "speed = 10"),
    ],
)
def test_what_cannot_be_replayed_is_refused_in_one_line(
    tmp_path: Path, signals: Rows | None, speed: float, named: str
) -> None:
    if signals:
        recorded(tmp_path / "nowhere", signals)
    with pytest.raises(ParameterError, match=named) as caught:
        opened(playback.ReplaySlave, tmp_path / "nowhere", speed=speed)
    assert "\n" not in str(caught.value)


def test_nothing_to_play_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="must be a bag"):
        opened(playback.ReplaySlave, tmp_path)
    with pytest.raises(ParameterError, match="replay.file = ''"):
        playback.ReplaySlave(playback.ReplayParameters(), RATE, 0)


def test_a_force_between_a_tick_s_time_and_a_late_tick_shifts_no_sample(bag: Path) -> None:
    prompt, late = opened(playback.ReplaySlave, bag), opened(playback.ReplaySlave, bag)
    expected = play(prompt)
    for index, sample in enumerate(expected):
        late.write(100.0 + (index + 0.9) * PERIOD, arm_force=(0.1, 0.0, 0.0))
        assert late.read(100.0 + index * PERIOD) == sample


def test_stamps_and_not_arrivals_count(tmp_path: Path) -> None:
    bag = recorded(tmp_path / "bag", delay=lambda place: place * 777_000)
    prompt = recorded(tmp_path / "prompt")
    assert play(opened(playback.ReplaySlave, bag)) == play(opened(playback.ReplaySlave, prompt))
    assert read_bag(bag).signals[topics.TOOL_ACCELERATION.name].stamps[0] == START

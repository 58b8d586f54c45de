# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sound of tool and handle, opened again by scipy and mcap."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from exported import START, Recorded, write_bag
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from scipy.io import wavfile

from haptic_accel.bags.writing import write_trial
from haptic_accel.core.sampling import resampled
from haptic_accel.core.trial import Trial
from haptic_accel.kits.export.sound import FULL
from verbs import output_of


def test_a_wav_file_times_its_scale_is_the_bag_to_the_last_digit(
    tmp_path: Path, recorded: Recorded
) -> None:
    output_of("export", recorded.path, "--format", "wav", "--out", tmp_path / "out")
    folder = tmp_path / "out" / recorded.path.name
    rate, samples = wavfile.read(folder / "vibration.wav")
    about = json.loads((folder / "signals.json").read_text())["sound"]
    assert (rate, about["channels"], about["start_ns"]) == (1000, ["tool.z", "handle.z"], START)
    assert 0.5 <= np.abs(samples).max() <= 1.0
    scaled = samples * about["full_scale_m_s2"]
    assert np.array_equal(scaled[:, 0], recorded.trial.tool_acceleration)
    assert np.array_equal(scaled[:, 1], recorded.trial.handle_acceleration)


def test_three_axes_are_six_channels(tmp_path: Path) -> None:
    trial = write_bag(tmp_path / "bag", rig="three_axis")
    output_of("export", tmp_path / "bag", "--format", "wav", "--out", tmp_path / "out")
    _, samples = wavfile.read(tmp_path / "out" / "bag" / "vibration.wav")
    about = json.loads((tmp_path / "out" / "bag" / "signals.json").read_text())["sound"]
    assert about["channels"] == [f"{part}.{axis}" for part in ("tool", "handle") for axis in "xyz"]
    assert np.array_equal(samples[:, 3:] * about["full_scale_m_s2"], trial.handle_acceleration)


def test_players_hear_tool_and_handle_at_their_times(tmp_path: Path, recorded: Recorded) -> None:
    output_of("export", recorded.path, "--format", "mcap-audio", "--out", tmp_path / "out")
    folder = tmp_path / "out" / recorded.path.name
    scale = json.loads((folder / "signals.json").read_text())["sound"]["full_scale_m_s2"]
    blocks: dict[str, list[bytes]] = {"/audio/tool": [], "/audio/handle": []}
    with (folder / "audio" / "audio.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert (schema.name, schema.encoding) == ("foxglove_msgs/msg/RawAudio", "ros2msg")
            seconds, nanoseconds, size = struct.unpack_from("<iII", message.data, 4)
            stamp = seconds * 1_000_000_000 + nanoseconds
            assert stamp == message.log_time
            assert stamp == START + len(b"".join(blocks[channel.topic])) // 2 * 125_000
            blocks[channel.topic].append(message.data[16 : 16 + size])
    trial = recorded.trial
    both = {"/audio/tool": trial.tool_acceleration, "/audio/handle": trial.handle_acceleration}
    for topic, expected in both.items():
        heard = np.frombuffer(b"".join(blocks[topic]), "<i2") / FULL * scale
        assert len(heard) == 8 * len(expected)
        inside = slice(100, -100)
        assert heard[::8][inside] == pytest.approx(expected[inside], abs=0.02 * np.ptp(expected))
    with AnyReader([folder / "audio"]) as stranger:
        topic, _, data = next(iter(stranger.messages()))
        block = stranger.deserialize(data, topic.msgtype)
    assert (block.format, block.sample_rate, block.number_of_channels) == ("pcm-s16", 8000, 1)


def test_parts_of_a_minute_meet_as_if_they_were_one(tmp_path: Path) -> None:
    length = 125_000
    noise = [np.random.default_rng(n).normal(size=length) for n in range(4)]
    trial = Trial("x", "none", 1000.0, np.arange(length) / 1000.0, *noise)
    write_trial(tmp_path / "bag", trial, {}, START)
    output_of("export", tmp_path / "bag", "--format", "mcap-audio", "--out", tmp_path / "out")
    heard = b""
    with (tmp_path / "out" / "bag" / "audio" / "audio.mcap").open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=["/audio/tool"]):
            (size,) = struct.unpack_from("<I", message.data, 12)
            heard += message.data[16 : 16 + size]
    scale = json.loads((tmp_path / "out" / "bag" / "signals.json").read_text())["sound"]
    whole = resampled(noise[0], 1000.0, 8000.0) * FULL / scale["full_scale_m_s2"]
    error = np.abs(np.frombuffer(heard, "<i2") - np.clip(whole, -FULL, FULL))
    assert error[:-1000].max() < 1.0  # the end is extended along another line

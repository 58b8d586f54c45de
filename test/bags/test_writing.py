# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from bag_maker import STRING, vector_bytes
from haptic_accel.bags.reading import read_bag
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import BagWriter, RecordingSession, write_trial
from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.trial import Trial
from reading import with_rosbags
from running import PATIENCE, python


def session(bag: Path, *, start_paused: bool = False) -> RecordingSession:
    return RecordingSession(str(bag), 1000, RecordingOptions(start_paused=start_paused), {})


def data_of(bag: Path) -> list[bytes]:
    return [data for _, _, data in with_rosbags(bag)]


def test_what_is_put_between_start_and_pause_is_in_the_bag(tmp_path: Path) -> None:
    recording = session(tmp_path / "bag", start_paused=True)
    put = recording.connect("/x", STRING, [])
    put(b"before")
    assert recording.start()[0]
    put(b"one")
    assert recording.split()[0]
    put(b"two")
    assert recording.pause()[0]
    put(b"pause")
    assert recording.start()[0]
    put(b"three")
    done, line = recording.stop()
    assert (done, line) == (True, f"{tmp_path / 'bag'}: 3 messages, 0 dropped")
    assert data_of(tmp_path / "bag") == [b"one", b"two", b"three"]
    assert data_of(tmp_path / "bag" / "bag_1.mcap") == [b"two", b"three"]


def test_a_start_after_a_stop_makes_another_bag_with_the_same_topics(tmp_path: Path) -> None:
    recording = session(tmp_path / "bag", start_paused=True)
    put = recording.connect("/x", STRING, [])
    recording.start()
    put(b"first")
    recording.stop()
    put(b"between")
    late = recording.connect("/late", STRING, [])
    late(b"between")
    (tmp_path / "bag-2").mkdir()
    assert recording.start() == (True, f"{tmp_path / 'bag-3'}: recording")
    put(b"second")
    late(b"late")
    recording.stop()
    assert data_of(tmp_path / "bag") == [b"first"]
    assert [row[::2] for row in with_rosbags(tmp_path / "bag-3")] == [
        ("/x", b"second"),
        ("/late", b"late"),
    ]


def test_what_cannot_be_done_is_answered_in_a_line(tmp_path: Path) -> None:
    recording = session(tmp_path / "bag")
    assert recording.start() == (False, f"{tmp_path / 'bag'}: is being recorded already")
    recording.pause()
    assert recording.pause() == (False, f"{tmp_path / 'bag'}: is paused already")
    recording.stop()
    for action in (recording.pause, recording.stop, recording.split):
        done, line = action()
        assert not done
        assert line.startswith(f"{tmp_path / 'bag'}: is stopped")
    assert recording.failures == []


def test_a_bag_that_cannot_be_made_leaves_the_recording_stopped(tmp_path: Path) -> None:
    recording = session(tmp_path / "folder" / "bag")
    recording.stop()
    (tmp_path / "folder").rename(tmp_path / "moved")
    (tmp_path / "folder").write_text("")
    done, line = recording.start()
    assert not done
    assert "must be a folder to make" in line
    assert recording.state == "stopped"


def test_what_was_recorded_before_is_kept_beside_the_new_bag(tmp_path: Path) -> None:
    for name in ("bag", "bag-2", "bag-3"):
        recording = session(tmp_path / "bag")
        assert recording.path == tmp_path / name
        recording.stop()


ACCEL = "geometry_msgs/msg/AccelStamped"
PERIOD = 1_000_000
"""Period of 1 kHz, ns."""


def serialised(value: float, stamp: int = 0) -> bytes:
    return vector_bytes(ACCEL, stamp, "slave_tool", (0.0, 0.0, value))


def writer(path: Path, capacity: int = 100_000) -> BagWriter:
    return BagWriter(path, capacity, RecordingOptions(), {})


def test_a_queue_that_is_full_drops_and_counts(tmp_path: Path) -> None:
    bag = writer(tmp_path / "bag", 1)
    put = bag.connect("/x", STRING, [])
    for _ in range(20_000):
        put(b"")
    bag.close()
    assert bag.dropped > 0
    assert bag.files.written + bag.dropped == 20_000
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == bag.files.written


def test_what_comes_in_a_pause_is_left_out_and_not_missing(tmp_path: Path) -> None:
    bag = writer(tmp_path / "bag")
    put = bag.connect("/x", ACCEL, [], sampled=True)
    for number in range(300):
        if number == 100:
            bag.pause()
        if number == 200:
            bag.resume()
        put(serialised(number, number * PERIOD))
    bag.close()
    assert (bag.files.written, bag.dropped, bag.missing) == (200, 0, 0)


def test_samples_that_did_not_come_are_counted_by_their_stamps(tmp_path: Path) -> None:
    bag = writer(tmp_path / "bag")
    put = bag.connect("/x", ACCEL, [], sampled=True)
    left_out = {*range(50, 60), 100, 200}
    for number in range(300):
        if number not in left_out:
            put(serialised(number, number * PERIOD))
    bag.close()
    assert bag.missing == len(left_out)


FULL = """
import resource, time
from pathlib import Path
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import FLUSH_PERIOD, BagWriter
bag = BagWriter(Path("bag"), 100_000, RecordingOptions(), {"fact": "kept"})
put = bag.connect("/x", "std_msgs/msg/String", [])
for number in range(300):
    put(bytes(1000))
while not bag.files.free_space or sum(p.stat().st_size for p in Path("bag").iterdir()) < 300_000:
    time.sleep(0.01)
resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))
for number in range(500):
    put(bytes(1000))
time.sleep(2 * FLUSH_PERIOD)
put(b"")
print(bag.close())
print(bag.files.trouble)
"""


def test_what_was_saved_before_the_disk_was_full_can_be_read(tmp_path: Path) -> None:
    done = python("-c", FULL, cwd=tmp_path, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    line, trouble = done.stdout.splitlines()
    # A limit on the size of files stands for the disk, which a test cannot fill.
    assert "File too large" in line
    assert "300 messages up to" in line
    assert line.endswith("are saved and can be read, 501 are not")
    assert trouble == ""
    assert len(with_rosbags(tmp_path / "bag")) == 300


@pytest.mark.parametrize("axes", [ACTUATOR_AXES, Axes(("x", "z")), ALL_AXES])
def test_a_trial_is_read_as_it_was_written(tmp_path: Path, axes: Axes) -> None:
    rate = 1000.0
    shape = (50,) if len(axes.names) == 1 else (50, len(axes.names))
    signals = [np.random.default_rng(seed).normal(size=shape) for seed in range(4)]
    trial = Trial("vinyl", "inverse", rate, np.arange(50) / rate, *signals, axes=axes)
    write_trial(tmp_path / "bag", trial, {}, 10**9)
    bag = read_bag(tmp_path / "bag")
    assert bag.axes == axes
    for topic, written in zip(topics.ANALYSED, signals, strict=True):
        found, seen = bag.signals[topic.name].on_grid(10**9, rate, 50, bag.axes)
        assert np.array_equal(found, written)
        assert seen.all()

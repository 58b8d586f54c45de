# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from __future__ import annotations

from pathlib import Path

from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.session import RecordingSession
from reading import with_rosbags

STRING = "std_msgs/msg/String"


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

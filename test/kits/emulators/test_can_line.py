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

"""The adapter's end of slcan."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.devices.can.protocol import Frame
from haptic_accel.kits.emulators.can_line import SlcanAdapter, frame_line, parse_frame_line

ids = st.integers(0, 0x7FF)
frames = st.builds(Frame, ids, st.binary(max_size=8), remote=st.just(False)) | st.builds(
    Frame, ids, st.just(b""), remote=st.just(True)
)


@given(frames)
def test_a_frame_comes_back(frame: Frame) -> None:
    line = frame_line(frame)
    assert line.endswith(b"\r")
    assert parse_frame_line(line[:-1]) == frame


def test_lines_are_those_of_the_manual() -> None:
    assert (
        frame_line(Frame(0x100, bytes.fromhex("0011223344556677"))) == b"t10080011223344556677\r"
    )
    assert frame_line(Frame(0x7, b"", remote=True)) == b"r0070\r"


@given(st.binary(max_size=40))
def test_no_line_is_too_strange(line: bytes) -> None:
    frame = parse_frame_line(line)
    if frame is not None:
        assert 0 <= frame.id <= 0x7FF
        assert len(frame.data) <= 8


@given(st.lists(st.binary(max_size=60), max_size=20), st.lists(frames, min_size=1, max_size=5))
def test_frames_are_found_after_any_bytes_however_cut(
    garbage: list[bytes], wanted: list[Frame]
) -> None:
    adapter = SlcanAdapter()
    for piece in garbage:
        adapter.receive(piece)
    adapter.receive(b"\rO\r")
    stream = b"".join(map(frame_line, wanted))
    found = [frame for byte in stream for frame in adapter.receive(bytes([byte]))[0]]
    assert found == wanted


def test_frames_pass_only_while_it_is_open() -> None:
    adapter = SlcanAdapter()
    line = frame_line(Frame(0x21))
    assert adapter.receive(line) == ([], b"\a")
    assert adapter.receive(b"S8\rO\r" + line) == ([Frame(0x21)], b"\r\r\r")
    assert adapter.receive(b"C\r" + line) == ([], b"\r\a")


def test_it_says_who_it_is() -> None:
    assert SlcanAdapter().receive(b"V\rN\rF\r?\r")[1] == b"V1013\rNHAPT\rF00\r\a"

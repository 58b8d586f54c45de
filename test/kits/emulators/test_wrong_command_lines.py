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

"""Wrong command lines of `emulate`: refused in one line."""

from __future__ import annotations

from pathlib import Path

from refusals import assert_refused, rows

REFUSED = {
    "emulate can faults:=fire": "faults: 'fire': must be NAME or NAME@SECONDS of drop, ...",
    "emulate can kinematics:=delta": "kinematics = 'delta': must be one of stage, planar, arm",
    "emulate can interface:=tin": "can.interface = 'tin': must be one of ...",
    "emulate can surface:=cheese": "surface = 'cheese': must be one of plywood, ...",
    "emulate can folder:=/dev/null": "folder = '/dev/null': must be a folder or new: File exists",
    "emulate can speed:=3": "speed: no such argument...",
    "emulate network delay:=-1": "delay = -1.0: must be from 0 to 10 s",
    "emulate serial faults:=fire": "faults: 'fire': must be NAME or NAME@SECONDS of garbage, ...",
    "emulate serial surface:=ice": "surface = 'ice': must be one of plywood, ...",
    "emulate serial folder:=file": "folder = 'file': must be a folder or new: File exists",
    "emulate serial rate:=1000": "rate: no such argument; ...",
}
"""Line of each command line, in which ... stands for any text."""


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)

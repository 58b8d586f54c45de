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

"""Wrong command lines of `bringup`: refused in one line."""

from __future__ import annotations

from pathlib import Path

from refusals import assert_refused, rows

REFUSED = {
    "bringup redo:=paint": "redo = 'paint': must be one of ...",
    "bringup master:=violin": "master = 'violin': must be one of simulated, ...",
    "bringup params_file:=nowhere.yaml": "params_file: .../nowhere.yaml: ...: No such file ...",
    "bringup rate:=5": "rate = 5.0: must be from 100 to 10000 Hz",
}
"""Line of each command line, in which ... stands for any text."""


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)

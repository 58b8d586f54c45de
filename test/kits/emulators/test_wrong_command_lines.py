# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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
    "emulate serial faults:=fire": "faults: 'fire': must be NAME or NAME@SECONDS of garbage, ...",
    "emulate serial surface:=ice": "surface = 'ice': must be one of plywood, ...",
    "emulate serial folder:=file": "folder = 'file': must be a folder or new: File exists",
    "emulate serial rate:=1000": "rate: no such argument; ...",
}
"""Line of each command line, in which ... stands for any text."""


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)

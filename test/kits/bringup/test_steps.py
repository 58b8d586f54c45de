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

"""The person's answers during a bring-up, without boards."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_accel.core.parameters import from_flat
from haptic_accel.kits.bringup.steps import BringUp, BringUpArguments, Watched
from haptic_accel.setup.rig_file import note_step, noted_steps, update_parameter_file


class Typist:
    """A person who types given answers, each once; the others stay empty or skip."""

    def __init__(self, at_resistor: list[str]) -> None:
        self._at_resistor = at_resistor
        self.lines: list[str] = []
        self.asked = 0

    def begin(self, number: int, step: str, purpose: str) -> None: ...

    def tell(self, line: str) -> None:
        self.lines.append(line)

    def show(self, watched: Watched | None) -> None: ...

    def request(self, line: str) -> None: ...

    def ask(self, request: str) -> str:
        if "resistor" in request:
            self.asked += 1
            return self._at_resistor.pop(0)
        if "without moving it" in request:
            raise EOFError
        return "s" if "type s" in request else ""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """Return a rig whose boards are calibrated, and not there."""
    path = tmp_path / "rig.yaml"
    board = {"serial": {"port": str(tmp_path / "none")}}
    update_parameter_file(path, {"master_device": {"device": "serial", **board}})
    for step in ("connect", "calibrate"):
        note_step(path, step, "before")
    return path


def test_only_s_skips_the_measurement_of_the_current_and_the_file_says_so(rig: Path) -> None:
    typist = Typist(["ok", "yes", "0.1", " S "])
    with pytest.raises(EOFError):
        BringUp(from_flat(BringUpArguments, {"file": str(rig)}), typist).run()
    assert typist.asked == 4
    for answer in ("ok", "yes", "0.1"):
        assert f"{answer}: must be Enter or s and Enter" in typist.lines
    assert "SKIPPED: current not measured" in typist.lines
    assert not any(line.startswith("ok: current") for line in typist.lines)
    assert "SKIPPED: current not measured; NOT PASSED: " in noted_steps(rig)["make_safe"]

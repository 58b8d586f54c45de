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

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from running import Command

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "lockstep_speed.py"

Start = Callable[..., Command]


@pytest.mark.quiet
def test_the_speed_of_a_trial_is_that_of_its_seconds(start: Start, tmp_path: Path) -> None:
    command = start(BENCHMARK, "--seconds", "2", "--json", "speed.json")
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "speed.json").read_text())
    assert (figures["rate_hz"], figures["simulated_seconds"]) == (1000.0, 2.0)
    assert figures["wall_seconds"] > 0
    assert figures["times_real_time"] == pytest.approx(2.0 / figures["wall_seconds"])
    assert "times real time" in command.text

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

from running import Command, nodes_of

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "memory.py"

Start = Callable[..., Command]
NODES = {"composed", "recorder"}


@pytest.mark.slow
def test_memory_stays_flat_with_recording(start: Start, tmp_path: Path, domain: int) -> None:
    command = start(BENCHMARK, "--seconds", "12", "--json", "memory.json")
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "memory.json").read_text())
    assert figures["seconds"] == 12.0
    assert set(figures["growth_mb"]) == set(figures["resident_mb"]) == NODES
    assert max(figures["growth_mb"].values()) <= 5.0
    assert set(figures["descriptors_growth"]) == NODES
    assert max(figures["descriptors_growth"].values()) <= 0  # fewer as they end
    for sizes in figures["resident_mb"].values():
        assert len(sizes) == len(figures["moments_s"]) >= 6
        assert min(sizes) > 10.0
    assert "growth" in command.text
    assert nodes_of(domain) == {}


@pytest.mark.parametrize("words", [["--seconds", "1"], ["--seconds", "10", "nothing:=1"]])
@pytest.mark.quiet
def test_a_wrong_argument_is_named_in_one_line(start: Start, words: list[str]) -> None:
    command = start(BENCHMARK, *words)
    assert command.end() == 2
    assert len(command.lines) == 1
    assert "Traceback" not in command.text

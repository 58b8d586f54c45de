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

"""The benchmark of the stop beside hostile connections, small."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hostile_connections import KINDS

from running import Command

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "hostile_connections.py"

Start = Callable[..., Command]


@pytest.mark.slow
@pytest.mark.quiet
def test_each_kind_is_measured(start: Start, tmp_path: Path) -> None:
    command = start(
        *(BENCHMARK, "--connections", "20", "--trials", "2"), *("--json", "figures.json")
    )
    status = command.end()
    figures = json.loads((tmp_path / "figures.json").read_text())
    late = sum(row["late"] for row in figures["rows"])
    assert status == (1 if late else 0), command.text
    assert [row["hostile"] for row in figures["rows"]] == [
        "none",
        *KINDS,
        "all",
        "stall",
        "command",
    ]


@pytest.mark.quiet
def test_a_wrong_argument_is_named_in_one_line(start: Start) -> None:
    command = start(BENCHMARK, "--trials", "0")
    assert command.end() == 2
    assert len(command.lines) == 1

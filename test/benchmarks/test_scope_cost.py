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

"""Cost of the scope, as the documentation quotes it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from running import Command
from scope_cost import scope_cost

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "scope_cost.py"


@pytest.mark.slow
def test_the_graph_is_measured_without_and_with_a_scope_that_is_looked_at(
    start: Callable[..., Command], tmp_path: Path
) -> None:
    words = (BENCHMARK, "rate:=200", "--seconds", "3", "--rounds", "1", "--json", "f.json")
    command = start(*words)
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "f.json").read_text())
    (without,), (looked,) = figures["without"], figures["with"]
    for run in (without, looked):
        assert 0 < run["age_us"]["p50"] <= run["age_us"]["p99"]
    assert "scope" not in without["cpu_cores"]
    assert looked["cpu_cores"]["scope"] > 0
    # Four traces of 200 samples a second, each of 8 bytes.
    assert looked["sent"]["bytes_per_s"] > 0
    assert looked["sent"]["frames_per_s"] > 0


@pytest.mark.parametrize(
    ("words", "seconds", "rounds", "named"),
    [
        (["scope:=true"], 5.0, 1, "scope"),
        (["duration:=3"], 5.0, 1, "duration"),
        ([], 1.0, 1, "seconds"),
        ([], float("nan"), 1, "seconds"),
        ([], 5.0, 0, "rounds"),
    ],
)
def test_what_the_benchmark_sets_itself_is_refused(
    words: list[str], seconds: float, rounds: int, named: str
) -> None:
    options = ["--seconds", str(seconds), "--rounds", str(rounds)]
    with pytest.raises(ParameterError, match=f"^{named}"):
        scope_cost.main([*options, *words], standalone_mode=False)

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from running import Command
from wires import reason_against

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "two_hosts.py"

Start = Callable[..., Command]


@pytest.mark.quiet
def test_where_there_can_be_no_network_the_benchmark_says_why(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CI", "true")
    command = start(BENCHMARK)
    assert command.end() == 2
    assert command.lines == [
        "two_hosts.py: no network between two hosts here: CI has no network namespaces"
    ]


@pytest.mark.slow
@pytest.mark.skipif(bool(reason_against()), reason=reason_against() or "")
def test_two_hosts_over_a_bad_network_lose_nothing_that_is_not_explained(
    start: Start, tmp_path: Path
) -> None:
    command = start(BENCHMARK, "--seconds", "5", "--transport", "dds", "--json", "figures.json")
    assert command.end() == 0, command.text
    found = json.loads((tmp_path / "figures.json").read_text())["transports"]["dds"]
    for side in ("master", "slave"):
        assert found[side]["lost_on_the_wire"] > 0
        assert found[side]["lost_unexplained"] == 0
        assert found[side]["zero_force_after_cable_s"] < found["cable_out_s"]
    assert found["across"]

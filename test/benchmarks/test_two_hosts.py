# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
from pathlib import Path

import pytest

from running import Start
from wires import reason_against

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "two_hosts.py"

FITTING = ("rate:=500", "controller:=inverse")
"""Graphs of which two cores carry two, and the network between them."""

LONGEST = 180.0
"""Time after which the benchmark counts as hanging, s: two minutes above what it says itself."""


@pytest.mark.quiet
def test_where_there_can_be_no_network_the_benchmark_says_why(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CI", "true")
    command = start(BENCHMARK)
    assert command.end() == 2
    why = "no network between two hosts here: CI has no network namespaces"
    assert command.lines == [f"two_hosts.py: {why}"]


@pytest.mark.slow
@pytest.mark.timeout(LONGEST + 60)
@pytest.mark.skipif(bool(reason_against()), reason=reason_against() or "")
def test_two_hosts_over_a_bad_network_lose_nothing_that_is_not_explained(
    start: Start, tmp_path: Path
) -> None:
    options = ("--seconds", "5", "--transport", "udp", "--json", "figures.json")
    command = start(BENCHMARK, *options, *FITTING)
    assert command.end(patience=LONGEST) == 0, command.text
    found = json.loads((tmp_path / "figures.json").read_text())["transports"]["udp"]
    for side in ("master", "slave"):
        assert found[side]["lost_on_the_wire"] > 0
        assert found[side]["lost_unexplained"] == 0
        assert found[side]["zero_force_after_cable_s"] < found["cable_out_s"]
    assert found["across"]

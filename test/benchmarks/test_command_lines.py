# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scripts that measure, run as a user runs them, small."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hostile_connections import KINDS

from running import Command, Start, ended_one_by_one, nodes_of

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"

BURSTS = 48
"""Bursts: of these, 14 to 20 had an effect while the present number of publishers decided."""

Measured = Callable[..., tuple[Command, Any]]


@pytest.fixture
def measured(start: Start, tmp_path: Path) -> Measured:
    """Run a benchmark to its end; return it and its figures."""

    def run(script: str, *words: str) -> tuple[Command, Any]:
        command = start(FOLDER / script, *words, "--json", "figures.json")
        status = command.end()
        figures = json.loads((tmp_path / "figures.json").read_text())
        assert status == any(row["late"] for row in figures.get("rows", ())), command.text
        return command, figures

    return run


@pytest.mark.quiet
@pytest.mark.slow
def test_the_speed_of_a_trial_is_that_of_its_seconds(measured: Measured) -> None:
    command, figures = measured("lockstep_speed.py", "--seconds", "2")
    assert (figures["rate_hz"], figures["simulated_seconds"]) == (1000.0, 2.0)
    assert figures["wall_seconds"] > 0
    assert figures["times_real_time"] == pytest.approx(2.0 / figures["wall_seconds"])
    assert "times real time" in command.text


@pytest.mark.slow
@pytest.mark.quiet
def test_each_kind_of_hostile_connection_is_measured(measured: Measured) -> None:
    _, figures = measured("hostile_connections.py", "--connections", "20", "--trials", "2")
    kinds = ["none", *KINDS, "all", "stall", "command"]
    assert [row["hostile"] for row in figures["rows"]] == kinds


@pytest.mark.slow
def test_memory_stays_flat_with_recording(measured: Measured, domain: int) -> None:
    command, figures = measured("memory.py", "--seconds", "12")
    nodes = {"composed", "recorder"}
    assert figures["seconds"] == 12.0
    assert set(figures["growth_mb"]) == set(figures["resident_mb"]) == nodes
    assert max(figures["growth_mb"].values()) <= 5.0
    assert set(figures["descriptors_growth"]) == nodes
    assert max(figures["descriptors_growth"].values()) <= 0  # fewer as they end
    for sizes in figures["resident_mb"].values():
        assert len(sizes) == len(figures["moments_s"]) >= 6
        assert min(sizes) > 10.0
    assert "growth" in command.text
    assert nodes_of(domain) == {}


@pytest.mark.slow
def test_a_device_in_its_own_process_applies_no_force_of_a_rival(
    measured: Measured, domain: int
) -> None:
    _, found = measured("rival_bursts.py", "--bursts", str(BURSTS), "--domain", str(domain))
    assert found["sent_by_rival"] == 3 * BURSTS
    assert found["applied_of_sender"] > 0
    assert found["applied_of_rival"] == 0


@pytest.mark.slow
def test_the_graph_is_measured_without_and_with_a_scope_that_is_looked_at(
    measured: Measured, domain: int
) -> None:
    words = ("rate:=200", "--seconds", "3", "--rounds", "1")
    _, figures = measured("scope_cost.py", *words)
    (without,), (looked,) = figures["without"], figures["with"]
    for run in (without, looked):
        assert 0 < run["age_us"]["p50"] <= run["age_us"]["p99"]
    assert "scope" not in without["cpu_cores"]
    assert looked["cpu_cores"]["scope"] > 0
    # Four traces of 200 samples a second, each of 8 bytes.
    assert looked["sent"]["bytes_per_s"] > 0
    assert looked["sent"]["frames_per_s"] > 0


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium")
def test_a_tap_of_the_mouse_is_felt_sent_heard_and_seen(start: Start) -> None:
    pytest.importorskip("playwright")
    command = start(FOLDER / "motion_to_sound.py", "--taps", "1", "--json")
    assert command.end() == 0, command.text
    *stages, whole, picture = (median for median, _ in json.loads(command.lines[-1]).values())
    assert min(*stages, picture) > 0
    assert sum(stages) == pytest.approx(whole)


REFUSED = {
    "memory.py --seconds 1": "seconds",
    "memory.py --seconds 10 nothing:=1": "nothing",
    "hostile_connections.py --trials 0": "trials",
    "scope_cost.py scope:=true": "scope",
    "scope_cost.py duration:=3": "duration",
    "scope_cost.py --seconds 1": "seconds",
    "scope_cost.py --seconds nan": "seconds",
    "scope_cost.py --rounds 0": "rounds",
}
"""What is named of a wrong command line."""


@pytest.mark.quiet
def test_a_wrong_argument_is_named_in_one_line(start: Start) -> None:
    found = ended_one_by_one(start, [f"{FOLDER}/{words}".split() for words in REFUSED])
    for named, (status, lines) in zip(REFUSED.values(), found, strict=True):
        assert (status, len(lines)) == (2, 1), lines
        assert named in lines[0]

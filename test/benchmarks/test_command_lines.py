# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scripts that measure, run as a user runs them, small."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from families import families
from fidelity import fidelity
from hostile_connections import KINDS, hostile_connections
from memory import memory

from haptic_accel.cli.main import run
from running import Command, Start, nodes_of
from scope_cost import scope_cost

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"

BURSTS = 48
"""Bursts: of these, 14 to 20 had an effect while the present number of publishers decided."""

Measured = Callable[..., tuple[Command, Any]]


@pytest.fixture
def measured(start: Start, tmp_path: Path) -> Measured:
    """Run a benchmark to its end; return it and its figures."""

    def measure(script: str, *words: str) -> tuple[Command, Any]:
        command = start(FOLDER / script, *words, "--json", "figures.json")
        status = command.end()
        figures = json.loads((tmp_path / "figures.json").read_text())
        assert status == any(row["late"] for row in figures.get("rows", ())), command.text
        return command, figures

    return measure


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
    for each in (without, looked):
        assert 0 < each["age_us"]["p50"] <= each["age_us"]["p99"]
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


@pytest.mark.parametrize(
    ("command", "words", "line"),
    [
        (memory, "--seconds 1", "seconds"),
        (memory, "--seconds 10 nothing:=1", "nothing"),
        (hostile_connections, "--trials 0", "trials"),
        (scope_cost, "scope:=true", "scope"),
        (scope_cost, "duration:=3", "duration"),
        (scope_cost, "--seconds 1", "seconds"),
        (scope_cost, "--seconds nan", "seconds"),
        (scope_cost, "--rounds 0", "rounds"),
        (families, "inputs --controllers inverse", "controllers: must contain none"),
        (families, "recordings", "recordings: needs --recordings FOLDER"),
        (fidelity, "--controllers none,magic", "'magic': must be one of "),
        (fidelity, "texture", "'texture': must be one of surfaces, "),
        (fidelity, "recordings", "recordings: needs --recording"),
        (fidelity, "--rig no.yaml", "rig = 'no.yaml': must be one of ideal, "),
        (fidelity, "--rate 10", "Invalid value for '--rate': 10.0 is not in the range"),
        (fidelity, "--recording no.csv --recording-rate 10", "surface = 'no.csv': must be "),
        (fidelity, "--recording a --recording b --recording-rate 1", "surface = 'a': "),
        (fidelity, "--json no/such.json", "json = 'no/such.json': No such file or directory"),
    ],
)
def test_wrong_words_are_refused_in_one_line(
    command: click.Command, words: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="^2$"):
        run(command, "measure", words.split())
    (told,) = capsys.readouterr().err.splitlines()
    assert line in told

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import math
from pathlib import Path
from statistics import fmean

import pytest

from haptic_accel.analysis.latency import latest_text, merged
from haptic_accel.core.topics import SIGNALS
from running import Start, nodes_of

LABELS = {"p50", "p90", "p99", "p99_9", "max"}


@pytest.mark.slow
def test_latency_gives_well_formed_figures_of_graph_and_empty_loop(
    haptic_accel: Start, tmp_path: Path, domain: int
) -> None:
    words = ("--rate", "200", "--seconds", "4", "--json", "figures.json")
    command = haptic_accel("bench", "latency", *words)
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert (figures["rate_hz"], figures["seconds"], figures["pairs"]) == (200.0, 4.0, 1)
    ages = figures["age_us"]
    assert set(ages) == LABELS
    # Latency is one sample: no force takes effect before the next tick.
    assert 0.005 * 1e6 < ages["p50"] * 1.01 <= ages["p99"] * 1.01 <= ages["max"] * 1.01
    assert set(figures["deadlines"]) == {"actuator force", "master arm force", "slave arm force"}
    for counts in figures["deadlines"].values():
        assert counts["due"] > 400
        assert 0 <= counts["missed"] <= counts["due"]
    assert figures["empty_loop"]["of"] >= 800
    assert set(figures["period_error_us"]) == {"master_device", "slave_device"}
    assert set(figures["lost"]) == {topic.name for topic in SIGNALS}
    assert "one process for master_device, slave_device, coupler and compensator" in command.text
    assert figures["composed"] is True
    assert set(figures["cpu_cores"]) == {"composed", "recorder", "total"}
    assert figures["cpu_cores"]["total"] > 0
    assert nodes_of(domain) == {}


@pytest.mark.slow
def test_rates_are_compared_and_drawn(haptic_accel: Start, tmp_path: Path) -> None:
    command = haptic_accel(
        *("bench", "latency", "--rates", "100,200", "--seconds", "1", "composed:=false"),
        *("--json", "figures.json", "--plot", "rates.png"),
    )
    assert command.end() == 0, command.text
    rows = json.loads((tmp_path / "figures.json").read_text())["rows"]
    assert [(row["rate_hz"], row["pairs"]) for row in rows] == [(100, 1), (200, 1)]
    assert all("coupler" in row["cpu_cores"] for row in rows)
    assert (tmp_path / "rates.png").read_bytes().startswith(b"\x89PNG")
    assert "highest rate held" in command.text
    assert "a process for each node; composed:=true" in command.text


LONGEST = [((300.0, 5e3), 5e3), ((math.nan, 5e3), math.nan), ((5e3, math.nan), math.nan)]


@pytest.mark.parametrize(("longest", "joined"), LONGEST)
def test_of_several_runs_counts_are_added_and_the_longest_lateness_stays_if_all_are_known(
    longest: tuple[float, float], joined: float
) -> None:
    first = {"due": 10, "missed": 1, "past_tick": 0, "longest_us": longest[0], "late_s": 3e-4}
    second = {"due": 20, "missed": 4, "past_tick": 2, "longest_us": longest[1], "late_s": 0.01}
    runs = [{"deadlines": {"arm force": counts}} for counts in (first, second)]
    (found,) = merged(runs, fmean)["deadlines"].values()
    longest_us = pytest.approx(joined, nan_ok=True)
    expected = {"due": 30, "missed": 5, "past_tick": 2, "longest_us": longest_us}
    assert found == {**expected, "late_s": pytest.approx(0.0103)}
    told = "" if math.isnan(joined) else ", the latest by 5.0 ms"
    assert latest_text(found["longest_us"]) == told


@pytest.mark.quiet
def test_without_its_library_it_says_what_to_install(
    haptic_accel: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "psutil.py").write_text("raise ModuleNotFoundError(name='psutil')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    command = haptic_accel("bench", "latency")
    assert command.end() == 1
    (line,) = command.lines
    assert line.endswith("haptic-accel: needs psutil: pip install 'haptic_accel[bench]'")

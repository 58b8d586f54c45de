# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from running import Command, Start

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "fidelity.py"
Begin = Start


@pytest.fixture
def begin(start: Begin) -> Begin:
    """Start the benchmark with words, in an empty folder."""
    return lambda *words: start(SCRIPT, *words)


def text_of(command: Command) -> str:
    """Return what a command writes that is done."""
    assert command.end() == 0, command.text
    return command.text


pytestmark = pytest.mark.quiet

ROW = {
    *("rig", "rate_hz", "delay_ms", "input", "grip", "controller", "nrmse_percent"),
    *("slope_desired_on_actual", "r2", "indistinguishable_percent", "bound_percent"),
    *("limited_bound_percent", "force_rms_n", "travel_peak_mm", "nrmse_by_2_s_percent"),
}


@pytest.mark.slow
def test_the_table_is_printed_and_saved(begin: Begin, tmp_path: Path) -> None:
    time = np.arange(4000) / 2000.0
    tones = np.sin(2 * np.pi * 100 * time) + np.sin(2 * np.pi * 150.5 * time)
    np.savetxt(tmp_path / "drag.csv", tones, header="acceleration", comments="")
    text = text_of(
        begin(
            *("--hands", "0", "--controllers", "none,inverse"),
            *("--recording", "drag.csv", "--recording-rate", "2000", "--json", "figures.json"),
        )
    )
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["rows"]
    for row in figures["rows"]:
        assert set(row) >= ROW
        assert row["input"] == "drag"
        assert row["bound_percent"] <= row["limited_bound_percent"] <= row["nrmse_percent"]
        period = 1e3 / row["rate_hz"]  # ms; forces are due a sample later
        granted = 1.0 if row["controller"] == "inverse" else period
        assert row["delay_ms"] == period + granted
    for line in figures["summary"]:
        errors = [
            row["nrmse_percent"]
            for row in figures["rows"]
            if (row["condition"], row["controller"]) == (line["condition"], line["controller"])
        ]
        assert line["mean_percent"] == pytest.approx(np.mean(errors))
        assert line["worst_percent"] == pytest.approx(max(errors))
    lines = figures["summary"]
    by_name = {(line["condition"], line["controller"]): line["mean_percent"] for line in lines}
    assert by_name["ideal, 1 kHz", "none"] == pytest.approx(100.0, abs=2.0)
    assert by_name["ideal, 1 kHz", "inverse"] < 9.0
    assert "ideal, 4 kHz" in text
    assert "a hand could not tell" in " ".join(text.split())


@pytest.mark.slow
def test_chosen_conditions_give_the_same_with_any_number_of_jobs(
    begin: Begin, tmp_path: Path
) -> None:
    found = {}
    for jobs in ("1", "3"):
        words = ("--controllers", "none,dynamic", "--rig", "paper", "--rate", "500")
        text = text_of(begin("taps", *words, "--jobs", jobs, "--json", f"{jobs}.json"))
        found[jobs] = json.loads((tmp_path / f"{jobs}.json").read_text())
    assert found["1"] == found["3"]
    for row in found["1"]["rows"]:
        assert (row["condition"], row["rig"], row["rate_hz"]) == ("taps", "paper", 500.0)
        assert f"{row['input']}, Table I, {row['controller']}: " in text
        assert len(row["nrmse_by_2_s_percent"]) == 13  # from 0, 0.5, ... 6 s on
    idle, dynamic = found["1"]["summary"]
    assert idle["above_none_points"] == 0.0
    without, own = (
        np.array([row["nrmse_by_2_s_percent"] for row in found["1"]["rows"][first::2]])
        for first in (0, 1)
    )
    assert dynamic["above_none_points"] == pytest.approx((own - without).max())


@pytest.mark.slow
def test_what_is_done_is_saved_at_ctrl_c_and_the_same_command_goes_on(
    begin: Begin, tmp_path: Path
) -> None:
    words = ("hands", "--controllers", "none", "--hands", "5")
    command = begin(*words, "--json", "figures.json")
    command.wait_for("2 of 5: ")
    assert command.end(signal.SIGINT) == 130, command.text
    assert "Traceback" not in command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    done = len(figures["rows"])
    assert 2 <= done < 5
    assert f"interrupted after {done} of 5 trials; the same command goes on" in command.text
    assert figures["summary"][0]["trials"] == done
    again, whole = (begin(*words, "--json", f"{name}.json") for name in ("figures", "whole"))
    for command in (again, whole):
        assert command.end() == 0, command.text
    assert f"{done} of 5 trials are taken from figures.json.part" in again.text
    assert (tmp_path / "figures.json").read_text() == (tmp_path / "whole.json").read_text()
    assert not (tmp_path / "figures.json.part").exists()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from verbs import next_command

Ran = Callable[..., str]


@pytest.mark.parametrize("controller", ["inverse", "feedback", "adaptive"])
def test_it_prints_and_saves_what_a_design_will_do(ran: Ran, here: Path, controller: str) -> None:
    text = ran("design", f"controller:={controller}", "rig:=ideal", "--json", "figures.json")
    figures = json.loads((here / "figures.json").read_text())
    # Eq. (3) alone, one sample late: next to nothing is left, and less than the bound cannot be.
    assert figures["bound_percent"] <= figures["limited_bound_percent"]
    assert figures["bound_percent"] < figures["nrmse_percent"] < 5.0
    assert 0.0 < figures["travel_rms_mm"] < figures["landing_travel_mm"]
    assert "low frequencies are attenuated for a travel above 3.04 mm" in text
    assert next_command(text) == ["teleop", f"controller:={controller}", "rig:=ideal"]
    assert len(figures["frequency_hz"]) == len(figures["gain"]) == len(figures["phase_deg"])
    at_80 = figures["frequency_hz"].index(80.0)
    assert figures["gain"][at_80] == pytest.approx(1.0, abs=0.03)
    assert figures["phase_deg"][at_80] == pytest.approx(0.0, abs=3.0)
    assert ("margin" in text) == (controller == "feedback")


def test_what_is_felt_can_be_a_recording(ran: Ran, here: Path) -> None:
    rows = "\n".join(str((-1) ** (index // 5)) for index in range(2000))  # 100 Hz
    (here / "drag.csv").write_text(f"acceleration\n{rows}\n")
    ran("design", "surface:=drag.csv", "recording_rate:=1000", "--json", "figures.json")
    figures = json.loads((here / "figures.json").read_text())
    assert figures["bound_percent"] < figures["nrmse_percent"] < 100.0

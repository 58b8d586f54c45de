# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from running import Command

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "lockstep_speed.py"

Start = Callable[..., Command]


@pytest.mark.quiet
def test_the_speed_of_a_trial_is_that_of_its_seconds(start: Start, tmp_path: Path) -> None:
    command = start(BENCHMARK, "--seconds", "2", "--json", "speed.json")
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "speed.json").read_text())
    assert (figures["rate_hz"], figures["simulated_seconds"]) == (1000.0, 2.0)
    assert figures["wall_seconds"] > 0
    assert figures["times_real_time"] == pytest.approx(2.0 / figures["wall_seconds"])
    assert "times real time" in command.text

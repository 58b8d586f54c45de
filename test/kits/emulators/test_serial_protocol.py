# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generated frames over a disturbed line, as the documentation quotes them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from running import Start

BENCHMARK = Path(__file__).resolve().parents[3] / "benchmarks" / "serial_protocol.py"


@pytest.mark.quiet
def test_no_whole_frame_is_missed_and_no_current_flows_that_must_not(
    start: Start, tmp_path: Path
) -> None:
    command = start(BENCHMARK, "--frames", "3000", "--json", "figures.json")
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["missed"] == figures["unlawful"] == 0
    assert figures["found"] + figures["spoiled"] == 3000
    assert figures["damaged"] > 100
    refused = start(BENCHMARK, "--frames", "0")
    assert refused.end() == 2
    assert refused.lines == ["serial_protocol.py: frames = 0: must be at least 1"]

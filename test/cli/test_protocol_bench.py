"""Many frames over a bad wire, as the documentation quotes them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from running import Command


def test_no_whole_frame_is_missed_and_no_current_flows_that_must_not(
    haptic_accel: Callable[..., Command], tmp_path: Path
) -> None:
    command = haptic_accel("bench", "protocol", "--frames", "3000", "--json", "figures.json")
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["missed"] == figures["unlawful"] == 0
    assert figures["found"] + figures["spoiled"] == 3000
    assert figures["damaged"] > 100
    refused = haptic_accel("bench", "protocol", "--frames", "0")
    assert refused.end() == 2
    assert refused.lines == ["haptic-accel: frames = 0: must be at least 1"]

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from running import Command, nodes_of

Start = Callable[..., Command]
NODES = {"master_device", "slave_device", "coupler", "compensator", "recorder"}


def test_memory_stays_flat_with_recording(
    haptic_accel: Start, tmp_path: Path, domain: int
) -> None:
    command = haptic_accel("bench", "soak", "--seconds", "12", "--json", "soak.json")
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "soak.json").read_text())
    assert figures["seconds"] == 12.0
    assert set(figures["growth_mb"]) == set(figures["resident_mb"]) == NODES
    assert max(figures["growth_mb"].values()) <= 5.0
    for sizes in figures["resident_mb"].values():
        assert len(sizes) == len(figures["moments_s"]) >= 6
        assert min(sizes) > 10.0
    assert "growth" in command.text
    assert nodes_of(domain) == {}


@pytest.mark.parametrize("words", [["--seconds", "1"], ["--seconds", "10", "nothing:=1"]])
@pytest.mark.quiet
def test_a_wrong_argument_is_named_in_one_line(haptic_accel: Start, words: list[str]) -> None:
    command = haptic_accel("bench", "soak", *words)
    assert command.end() == 2
    assert len(command.lines) == 1
    assert "Traceback" not in command.text

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live graph and the same trial in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.analysis.parting import find_parting
from running import Command, MachineStoodStillError

RATE, LATENCY = 500, 8
"""Samples per second, and samples from one to its force: 16 ms, which a busy host can keep."""

LEAST = 2 * RATE
"""Least number of samples that must be compared: two seconds."""


@pytest.mark.parametrize("rig", ["ideal", "paper"])
@pytest.mark.parametrize("controller", ["dynamic", "adaptive"])
def test_the_live_graph_gives_the_signals_of_lockstep_bit_for_bit(
    haptic_accel: Callable[..., Command], tmp_path: Path, rig: str, controller: str
) -> None:
    command = haptic_accel(
        *("teleop", f"rate:={RATE}", f"latency:={LATENCY}", "duration:=4", "bag:=bag"),
        *(f"rig:={rig}", f"controller:={controller}", "surface:=text"),
    )
    assert command.end() == 0, command.text
    found = find_parting(tmp_path / "bag")
    if found.first is not None and found.first < LEAST and "deadlines missed" in found.sentence:
        raise MachineStoodStillError(found.sentence)
    assert found.samples > LEAST
    assert found.first is None or found.first >= LEAST, found.sentence

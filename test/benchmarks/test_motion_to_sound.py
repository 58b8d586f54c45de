# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time from a motion to its sound, with a graph and a real browser."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from running import Command

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "motion_to_sound.py"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium")
def test_a_tap_of_the_mouse_is_felt_sent_and_heard(start: Callable[..., Command]) -> None:
    pytest.importorskip("playwright")
    command = start(BENCHMARK, "--taps", "1", "--json")
    assert command.end() == 0, command.text
    *stages, whole = (median for median, _ in json.loads(command.lines[-1]).values())
    assert min(stages) > 0
    assert sum(stages) == pytest.approx(whole)

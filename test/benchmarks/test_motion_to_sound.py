# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Time from a motion to its sound and its picture, with a graph and a real browser."""

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
def test_a_tap_of_the_mouse_is_felt_sent_heard_and_seen(start: Callable[..., Command]) -> None:
    pytest.importorskip("playwright")
    command = start(BENCHMARK, "--taps", "1", "--json")
    assert command.end() == 0, command.text
    *stages, whole, picture = (median for median, _ in json.loads(command.lines[-1]).values())
    assert min(*stages, picture) > 0
    assert sum(stages) == pytest.approx(whole)

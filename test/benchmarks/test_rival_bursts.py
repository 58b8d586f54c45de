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

"""Bursts of a second publisher at a device in a process of its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from running import Command

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "rival_bursts.py"

BURSTS = 48
"""Bursts: of these, 14 to 20 had an effect while the present number of publishers decided."""


def test_a_device_in_its_own_process_applies_no_force_of_a_rival(
    start: Callable[..., Command], domain: int, tmp_path: Path
) -> None:
    command = start(
        BENCHMARK, "--bursts", str(BURSTS), "--domain", str(domain), "--json", "f.json"
    )
    assert command.end() == 0, command.text
    found = json.loads((tmp_path / "f.json").read_text())
    assert found["sent_by_rival"] == 3 * BURSTS
    assert found["applied_of_sender"] > 0
    assert found["applied_of_rival"] == 0

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

"""Tests of what a study asks of a participant."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_accel.kits.study.outline import describe, expected_minutes, expected_trials
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.templates import templates


@pytest.mark.parametrize(
    ("name", "trials"),
    [
        ("compensated_or_not", 4 + 40),
        ("preference", 2 + 6 * 8),
        ("real_or_virtual_texture", 4 + 4 * 6),
        ("gain_jnd", 4 + 2 * 60),
        ("network_delay", 4 + 5 * 20),
    ],
)
def test_the_trials_of_a_session_are_known_before(name: str, trials: int) -> None:
    assert expected_trials(read_protocol(templates()[name])) == trials


def test_catch_trials_count(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    text = templates()["network_delay"].read_text()
    path.write_text(text.replace("practice: 4", "practice: 4, catch_every: 20"))
    assert expected_trials(read_protocol(path)) == 4 + 100 + 4


def test_a_trial_takes_its_stimuli_and_the_answer() -> None:
    found = read_protocol(templates()["compensated_or_not"])
    stimuli = 2 * found.timing.seconds + found.timing.gap
    assert 60 * expected_minutes(found) > expected_trials(found) * stimuli


def test_a_study_is_described_by_trials_duration_and_conditions() -> None:
    found = read_protocol(templates()["gain_jnd"])
    lines = describe(found)
    assert lines[0] == f"{found.title} (version {found.digest[:12]})"
    assert lines[2].startswith("at most 124 trials, about ")
    assert "gain=1 against gain=2" in lines

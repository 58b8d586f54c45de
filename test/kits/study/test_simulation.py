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

"""Simulated studies, and the power of their tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from haptic_accel.kits.study.simulation import power, simulate_study, write_simulated
from haptic_accel.kits.study.trials import COMPLETE
from studies import TEXT, write_study


def test_a_simulated_study_is_complete_and_repeatable(tmp_path: Path) -> None:
    protocol = write_study(tmp_path).protocol
    first, again, other = (simulate_study(protocol, 4, seed) for seed in (1, 1, 2))
    assert [each.participant for each in first] == ["S01", "S02", "S03", "S04"]
    assert {(each.ended, each.digest) for each in first} == {(COMPLETE, protocol.digest)}
    assert [each.row for each in first] == [0, 1, 2, 3]
    answers = [[record.answer for record in each.records] for each in first]
    assert answers == [[record.answer for record in each.records] for each in again]
    assert answers != [[record.answer for record in each.records] for each in other]


def test_a_written_study_is_the_simulated_one(tmp_path: Path) -> None:
    study = write_study(tmp_path)
    assert len([*write_simulated(study, 3, 5)]) == 3
    simulated = simulate_study(study.protocol, 3, 5)
    for written, each in zip(study.sessions, simulated, strict=True):
        assert written.participant == each.participant
        assert [record.answer for record in written.records] == [
            record.answer for record in each.records
        ]


def test_observers_answer_by_the_strengths(tmp_path: Path) -> None:
    def correct(strength: float) -> float:
        text = TEXT.replace("adaptive: 3", f"adaptive: {strength}")
        sessions = simulate_study(write_study(tmp_path, text).protocol, 40, 1)
        return float(np.mean([bool(each.correct) for one in sessions for each in one.counted]))

    assert correct(0.0) == pytest.approx(0.5, abs=0.07)
    assert correct(3.0) > 0.75


def test_power_has_an_interval() -> None:
    found = power("told apart", [True] * 80 + [False] * 20)
    assert (found.name, found.share) == ("told apart", 0.8)
    # Wilson's interval: Brown, Cai, DasGupta, Statistical Science 16(2), 2001.
    assert (found.low, found.high) == pytest.approx((0.7112, 0.8666), abs=1e-4)

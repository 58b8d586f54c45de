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

"""Pairs of samples: when a window is due, and what stands for missing samples."""

from __future__ import annotations

import math

import pytest

from haptic_accel.core.control.paired_window import PairedWindow


def test_it_is_due_each_hop_once_it_is_full() -> None:
    window = PairedWindow(12, 4)
    due = [place for place in range(1, 25) if window.push(place, -place)]
    assert due == [12, 16, 20, 24]
    cause, effect = window.latest()
    assert cause.tolist() == [*range(24, 12, -1)]
    assert effect.tolist() == [*range(-24, -12)]


@pytest.mark.parametrize("unknown", [math.nan, math.inf, -math.inf])
def test_a_missing_sample_repeats_the_one_before(unknown: float) -> None:
    window = PairedWindow(2, 1)
    window.push(1.0, 5.0)
    window.push(2.0, unknown)
    assert window.latest()[1].tolist() == [5.0, 5.0]


def test_a_window_with_too_many_gaps_is_not_due_until_they_have_passed() -> None:
    window = PairedWindow(100, 50)
    for _ in range(97):
        assert not window.push(0.0, 0.0)
    assert [window.push(0.0, math.nan) for _ in range(3)] == [False, False, False]  # 3 %
    due = [place for place in range(1, 101) if window.push(0.0, 0.0)]
    assert due == [100]


def test_reset_forgets_all() -> None:
    window = PairedWindow(2, 1)
    window.push(1.0, 1.0)
    window.push(1.0, math.nan)
    window.reset()
    assert not window.latest()[1].any()
    assert not window.push(1.0, 1.0)
    assert window.push(1.0, 1.0)

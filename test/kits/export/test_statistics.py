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

"""Statistics of features."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.kits.export.statistics import combined, statistics

EXACT = ("min", "max", "mean", "std", "count")


@given(st.lists(st.integers(1, 9), min_size=1, max_size=5), st.integers(0, 99))
def test_those_of_all_episodes_are_those_of_all_frames(lengths: list[int], seed: int) -> None:
    random = np.random.default_rng(seed)
    episodes = [random.normal(size=(length, 4, 2)) for length in lengths]
    found = combined([{"feature": statistics(each)} for each in episodes])["feature"]
    expected = statistics(np.concatenate(episodes))
    for name in EXACT:
        assert found[name] == pytest.approx(expected[name])
    assert found["q50"].shape == (4, 2)

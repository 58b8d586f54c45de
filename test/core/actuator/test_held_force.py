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

"""A held force on the grid of another clock."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.actuator.held_force import HeldForce

forces = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.floats(-10.0, 10.0)), max_size=8, unique_by=lambda f: f[0]
)


@given(forces, st.integers(1, 40), st.integers(1, 40))
def test_the_impulse_is_that_of_the_held_forces(
    due: list[tuple[float, float]], first: int, second: int
) -> None:
    held = HeldForce()
    for each in due:
        held.put(*each)
    means = [held.means(0.0, 2.0 * first, first) * 0.5 / first]
    means.append(held.means(0.5, 2.0 * second, second) * 0.5 / second)
    steps = [*sorted(due), (1.0, 0.0)]
    expected = sum(force * (end - start) for (start, force), (end, _) in pairwise(steps))
    assert np.concatenate(means).sum() == pytest.approx(expected, abs=1e-9)


def test_a_step_within_a_sample_keeps_its_time() -> None:
    held = HeldForce()
    held.put(1.25, 4.0)
    held.put(2.0, -4.0)
    assert held.means(0.0, 1.0, 3) == pytest.approx([0.0, 3.0, -4.0])
    assert held.means(3.0, 1.0, 1) == pytest.approx([-4.0])


def test_a_late_force_acts_at_once_and_a_replacement_discards_those_to_come() -> None:
    held = HeldForce()
    held.put(0.5, 1.0)
    assert held.means(5.0, 1.0, 1) == pytest.approx([1.0])
    held.put(7.0, 2.0)
    held.replace(0.0)
    assert held.means(6.0, 1.0, 3) == pytest.approx([0.0] * 3)

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
"""Tests of the axes of a device."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.axes import ALL_AXES, NAMES, Axes
from haptic_accel.core.parameters import ParameterError


@given(st.sets(st.sampled_from(NAMES), min_size=1), st.tuples(*[st.floats(-1, 1)] * 3))
def test_a_vector_keeps_its_components_along_the_axes_and_loses_the_others(
    names: set[str], vector: tuple[float, float, float]
) -> None:
    axes = Axes(tuple(sorted(names)))
    kept = axes.vector(axes.components(vector))
    assert all(
        each == (before if name in names else 0.0)
        for name, each, before in zip(NAMES, kept, vector, strict=True)
    )


@pytest.mark.parametrize("text", ["x y z", "x,y,z", " x, y , z"])
def test_axes_are_read_with_commas_or_spaces(text: str) -> None:
    assert Axes.parsed(text) == ALL_AXES


@pytest.mark.parametrize("text", ["", "w", "z, x", "x, x", "X"])
def test_other_axes_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ParameterError, match="axes = .*must be some of x, y, z"):
        Axes.parsed(text)

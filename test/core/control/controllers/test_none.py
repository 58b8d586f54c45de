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

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.control.channel import build_controller
from haptic_accel.core.control.controllers import Loop


@given(st.lists(st.tuples(st.floats(), st.floats())))
def test_no_acceleration_makes_a_force(samples: list[tuple[float, float]]) -> None:
    controller = build_controller("none", Loop(1000.0))
    assert all(controller.force(desired, measured) == 0.0 for desired, measured in samples)
    controller.reset()
    assert controller.force(1.0, 1.0) == 0.0

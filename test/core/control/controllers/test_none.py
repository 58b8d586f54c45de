# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.control.compensation import build_controller
from haptic_accel.core.control.controllers import Loop


@given(st.lists(st.tuples(st.floats(), st.floats())))
def test_no_acceleration_makes_a_force(samples: list[tuple[float, float]]) -> None:
    controller = build_controller("none", Loop(1000.0))
    assert all(controller.force(desired, measured) == 0.0 for desired, measured in samples)
    controller.reset()
    assert controller.force(1.0, 1.0) == 0.0

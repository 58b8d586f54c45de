# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest

from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.coupling.position_position import (
    CouplingParameters,
    PositionPositionCoupling,
)
from haptic_accel.core.loop.coupling import CouplingPart
from haptic_accel.core.model import ZERO

RATE = 1000.0
PARAMETERS = CouplingParameters(k_m=100.0, k_sl=50.0, scale=1.0, damping=0.0)


def motion(tick: int, height: float) -> Motion:
    return Motion(tick * 1_000_000, (0.0, 0.0, height), ZERO)


@pytest.fixture
def part() -> CouplingPart:
    return CouplingPart(PositionPositionCoupling(PARAMETERS), RATE, longest=10)


def test_arms_are_free_until_they_engage_where_they_are_then(part: CouplingPart) -> None:
    for arm, height in enumerate((0.05, 0.2)):
        part.put(arm, motion(1, height))
    assert list(part.step()) == [None]
    part.engage()
    for arm, height in enumerate((0.05, 0.2)):
        part.put(arm, motion(2, height))
    for arm, height in enumerate((0.06, 0.2)):
        part.put(arm, motion(3, height))
    at_rest, moved = part.step()
    assert at_rest
    assert moved
    assert (at_rest.on_master, at_rest.on_slave) == (ZERO, ZERO)
    assert moved.on_master == pytest.approx((0.0, 0.0, -1.0))  # 100 N/m times 10 mm
    assert moved.on_slave == pytest.approx((0.0, 0.0, 0.5))


def test_a_sample_waits_for_that_of_the_other_arm(part: CouplingPart) -> None:
    part.put(0, motion(1, 0.0))
    assert list(part.step()) == []
    assert part.waiting
    part.put(1, motion(1, 0.0))
    assert len(list(part.step())) == 1
    assert not part.waiting


def test_arms_that_are_let_go_before_they_were_taken_stay_free(part: CouplingPart) -> None:
    part.engage()
    part.disengage()
    for arm in (0, 1):
        part.put(arm, motion(1, 0.0))
    assert list(part.step()) == [None]

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling over bursts of losses."""

from __future__ import annotations

import pytest
from loss_bursts import measure

from haptic_accel.core.coupling.passive import PassiveParameters


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_over_bursts_of_losses_arms_come_together_again_and_no_force_jumps(seed: int) -> None:
    found = measure(25.0, seed)
    assert found["engagements"] >= found["bursts"] >= 3
    assert found["distance_mm"] < 5.0
    assert found["force_step_n"] < 0.1
    assert found["energy_out_mj"] <= 2e3 * PassiveParameters().energy

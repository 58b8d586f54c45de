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

"""Coupling over bursts of losses."""

from __future__ import annotations

import pytest
from loss_bursts import measure

from haptic_accel.core.coupling.passive import PassiveParameters


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_over_bursts_of_losses_arms_come_together_again_and_no_force_jumps(seed: int) -> None:
    found = measure(25.0, seed)
    assert found["engagements"] >= found["bursts"] >= 3
    assert found["distance_mm"] < 5.0
    assert found["force_step_n"] < 0.1
    assert found["energy_out_mj"] <= 2e3 * PassiveParameters().energy

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

"""Position-position coupling of the two arms (paper, section II)."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, parameter

FADE_TIME = 0.5
"""Time in which the gains change, s. It is several times a person's reaction time to a pull (0.2
s), and the period of the tool's oscillation on the coupling (0.1 s)."""


@dataclass(frozen=True)
class CouplingParameters(Checked):
    """Gains of the coupling; defaults from the paper (0.25 N/mm each way)."""

    k_m: float = parameter(250.0, "stiffness felt at the master", "N/m", 0, 5000.0)
    k_sl: float = parameter(250.0, "stiffness driving the slave", "N/m", 0, 5000.0)
    damping: float = parameter(
        0.0, "damping of the velocity difference, both ways", "N s/m", 0, 50.0
    )
    scale: float = parameter(1.0, "slave motion per master motion", low=0.01, high=100.0)
    max_force: float = parameter(
        3.3, "limit of each arm's force (Phantom Omni: 3.3 N)", "N", 0, 100.0
    )

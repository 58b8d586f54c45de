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

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

from haptic_accel.core.model import ZERO, Vector
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


_Gains: TypeAlias = tuple[float, float, float, float, float]
"""Values of `CouplingParameters` in one sample: k_m, k_sl, damping, max_force, scale."""


def _gains(p: CouplingParameters) -> _Gains:
    return p.k_m, p.k_sl, p.damping, p.max_force, p.scale


def _between(start: _Gains, end: _Gains, share: float) -> _Gains:
    """Interpolate gains by a fraction."""
    k_m, k_sl, damping, force, _ = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
    # Interpolate geometrically, as both the scale and its inverse are factors.
    return k_m, k_sl, damping, force, start[-1] * (end[-1] / start[-1]) ** share


class PositionPositionCoupling:
    """A spring, and optionally a damper, between the motions of master and slave.

    The positions at engagement are the reference positions of both arms. Engagement therefore
    gives zero force at any position. Every force is zero until `engage` is called.
    """

    def __init__(self, parameters: CouplingParameters) -> None:
        self._gains = _gains(parameters)
        self._fade: Iterator[_Gains] = iter(())
        self._origins: tuple[Vector, Vector] | None = None

    @property
    def engaged(self) -> bool:
        """True while the arms are coupled."""
        return self._origins is not None

    @property
    def felt(self) -> tuple[float, float]:
        """Stiffness at the master, N/m, and slave motion per master motion."""
        return self._gains[0], self._gains[-1]

    def engage(self, master: Vector, slave: Vector) -> None:
        """Couple the arms at their positions, m."""
        self._origins = (master, slave)

    def disengage(self) -> None:
        """Uncouple: forces are zero until the next `engage`."""
        self._origins = None

    def change(self, parameters: CouplingParameters, samples: int) -> None:
        """Change the gains within a number of samples, without a jump of force.

        The lag of the slave, in the master's scale, does not change. A new scale applies to later
        motion only; without spring force no arm moves.

        This is not passive. A stiffness that rises by K while the spring is stretched by d adds
        the energy K d^2 / 2. This energy is at most F^2 / 2k for the force limit F and the old
        stiffness k. With the defaults this is 22 mJ; over `FADE_TIME` this is much less power than
        a hand exchanges.
        """
        start, end = self._gains, _gains(parameters)
        if not self.engaged:
            self._gains, self._fade = end, iter(())
            return
        steps = (_between(start, end, step / samples) for step in range(1, samples))
        self._fade = itertools.chain(steps, [end])

    def forces(
        self,
        master: Vector,
        slave: Vector,
        master_velocity: Vector = ZERO,
        slave_velocity: Vector = ZERO,
    ) -> tuple[Vector, Vector]:
        """Return the forces for the arms of master and slave.

        Parameters
        ----------
        master, slave : tuple of float
            Positions, m.
        master_velocity, slave_velocity : tuple of float
            Velocities, m/s; used for damping only.

        Returns
        -------
        master_force, slave_force : tuple of float
            Forces, N, each limited in magnitude.
        """
        if self._origins is None:
            return ZERO, ZERO
        k_m, k_sl, damping, max_force, scale = self._gains
        (m_x, m_y, m_z), (s_x, s_y, s_z) = master, slave
        (m0_x, m0_y, m0_z), (s0_x, s0_y, s0_z) = self._origins
        # Lag of the slave behind the master, in the master's scale. One line per axis, as a loop
        # over the axes takes four times longer.
        d_x = (m_x - m0_x) - (s_x - s0_x) / scale
        d_y = (m_y - m0_y) - (s_y - s0_y) / scale
        d_z = (m_z - m0_z) - (s_z - s0_z) / scale
        v_x = master_velocity[0] - slave_velocity[0] / scale
        v_y = master_velocity[1] - slave_velocity[1] / scale
        v_z = master_velocity[2] - slave_velocity[2] / scale
        if math.isfinite(d_x + d_y + d_z) and (gains := next(self._fade, None)):
            self._origins = ((m_x - d_x, m_y - d_y, m_z - d_z), slave)
            self._gains = gains
        return (
            _limited(
                -k_m * d_x - damping * v_x,
                -k_m * d_y - damping * v_y,
                -k_m * d_z - damping * v_z,
                max_force,
            ),
            _limited(
                scale * (k_sl * d_x + damping * v_x),
                scale * (k_sl * d_y + damping * v_y),
                scale * (k_sl * d_z + damping * v_z),
                max_force,
            ),
        )


def _limited(x: float, y: float, z: float, limit: float) -> Vector:
    """Limit the magnitude of a force, keeping its direction; zero if it is not finite."""
    magnitude = math.sqrt(x * x + y * y + z * z)
    if magnitude <= limit:
        return x, y, z
    if not math.isfinite(magnitude):
        return ZERO
    ratio = limit / magnitude
    return x * ratio, y * ratio, z * ratio

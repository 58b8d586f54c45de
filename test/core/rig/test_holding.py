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

"""Arms that are let go and taken again: both rigs under the coupling and its engagement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.coupling.engagement import Engagement, EngagementParameters
from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.model import ZERO, FloatArray, Vector
from haptic_accel.core.rig.holding import PUT_BACK_AFTER, Holding
from haptic_accel.core.rig.master_rig import MasterRig
from haptic_accel.core.rig.slave_rig import SlaveRig
from haptic_accel.core.rig.surface import SurfaceParameters
from haptic_accel.core.topics import ARMS
from haptic_accel.core.trial import RigParameters

RATE = 1000.0
PERIOD = 1 / RATE
ROUGH = SurfaceParameters(stiffness=6e6, friction=0.35, roughness=6e-6, roughness_exponent=1.5)

STROKES = slice(900, 3600)
"""Samples after engaging in which the tool is dragged: after the approach, before the lift."""


class CoupledRigs:
    """Both rigs, coupled as the graph's coupler does it: no force is sent while they are free."""

    def __init__(self, rig: RigParameters) -> None:
        self.master = MasterRig(rig.master, RATE)
        self.slave = SlaveRig(rig.slave, RATE)
        self.engagement = Engagement(EngagementParameters(listeners=0), 0.0)
        for arm in ARMS:
            self.engagement.arm_stopped(arm, False)
        self._coupling = PositionPositionCoupling(rig.coupling)
        self._tick = 0
        self.engaged_at: list[int] = []
        self.origins: list[tuple[Vector, Vector]] = []

    def run(self, seconds: float) -> FloatArray:
        """Let time pass; return the tool's acceleration."""
        return np.array([self._sample() for _ in range(round(seconds * RATE))])

    def _sample(self) -> float:
        now = self._tick * PERIOD
        for rig in (self.master, self.slave):
            rig.advance(now)
        handle, tool = self.master.measure(), self.slave.measure()
        for arm in ARMS:
            self.engagement.position_received(arm, now)
        decision = self.engagement.decide(now, 0)
        if decision.release:
            self._coupling.disengage()
            self._apply(ZERO, ZERO)
        if decision.engage:
            self._coupling.engage(handle.position, tool.position)
            self.engaged_at.append(self._tick)
            self.origins.append((handle.position, tool.position))
        if self._coupling.engaged:
            self._apply(*self._coupling.forces(handle.position, tool.position))
        self._tick += 1
        return tool.acceleration

    def _apply(self, on_master: Vector, on_slave: Vector) -> None:
        self.master.apply_arm_force(on_master)
        self.slave.apply_arm_force(on_slave)


def dragging(acceleration: FloatArray, begin: int) -> float:
    """Return the RMS of the tool's acceleration over the strokes after a sample, m/s^2."""
    return float(np.std(acceleration[begin:][STROKES]))


def rough_rigs() -> CoupledRigs:
    rig = RigParameters()
    return CoupledRigs(replace(rig, slave=replace(rig.slave, surface=ROUGH)))


@pytest.fixture(scope="module")
def before() -> float:
    """Return the RMS of the tool's acceleration without any stop, m/s^2."""
    return dragging(rough_rigs().run(4.0), 0)


# In the approach, pressed, dragged, in the lift, and at rest in the air.
@pytest.mark.parametrize("moment", [0.01, 0.4, 0.65, 2.0, 4.3, 4.7])
@pytest.mark.parametrize("stopped", [PERIOD, 3.0])
def test_after_a_stop_the_tool_is_dragged_as_before(
    before: float, moment: float, stopped: float
) -> None:
    rigs = rough_rigs()
    rigs.run(moment)
    rigs.engagement.stop.stop()
    rigs.run(stopped)
    rigs.engagement.stop.stopped = False  # by a release at once, which no rule would allow
    after = rigs.run(5.0)
    _, engaged_again = rigs.engaged_at
    assert rigs.origins[1] == rigs.origins[0], "both arms are where they began"
    assert before > 1.0
    begin = engaged_again - round((moment + stopped) * RATE)
    assert dragging(after, begin) == pytest.approx(before, rel=0.2)


def test_a_coupling_in_balance_holds_an_arm_for_ever() -> None:
    holding = Holding()
    for _ in range(100):
        holding.command(free=True)
        assert not holding.ends(0.9 * PUT_BACK_AFTER)


def test_an_arm_under_force_is_not_put_back() -> None:
    holding = Holding()
    holding.command(free=False)
    assert not holding.ends(1e3)


def test_an_arm_that_was_never_held_has_not_been_let_go() -> None:
    assert not Holding().ends(1e3)

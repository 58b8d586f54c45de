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

"""Executable `coupler`: the position-position coupling of the two arms."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from haptic_accel.core import tick
from haptic_accel.core.coupling.engagement import Engagement
from haptic_accel.core.coupling.passive import PassivePair, PassiveParameters
from haptic_accel.core.coupling.position_position import FADE_TIME, CouplingParameters
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.tick import ArmSample, CoupledForces
from haptic_accel.core.topics import ARMS
from haptic_accel.nodes.coupling_node import ARM_TOPICS, CouplingNode, MotionSynchronizer
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.timing import CATCH_UP
from haptic_accel.setup.node_parameters import PASSIVE


class Coupler(CouplingNode):
    """Computes the forces on both arms from the samples of a tick."""

    def __init__(self) -> None:
        super().__init__((*schema(CouplingParameters), *schema(PassiveParameters)))
        p, rate = self.parameters, self.parameters.rate
        self._passive = PassivePair(p, rate, p.latency) if p.coupling == PASSIVE else None
        self._coupling = self._passive or tick.PositionPositionCoupling(p)
        self._changed = False
        longest = round(CATCH_UP * rate)
        self.part: tick.CouplingPart = tick.CouplingPart(
            self._coupling, self.engagement, rate, longest
        )
        self._motions = {
            arm: MotionSynchronizer(
                self.samples(signals.position, rate),
                self.samples(signals.velocity, rate) if self._damped else None,
                self.samples(signals.work, rate) if self._passive else None,
            )
            for arm, signals in ARM_TOPICS.items()
        }

    @property
    def _damped(self) -> bool:
        return bool(self._passive or self.parameters.damping > 0)

    def build_engagement(self, now: float) -> Engagement:
        """Return the engagement of both arms."""
        return Engagement(self.parameters, now)

    def start_anew(self) -> None:
        """Discard the waiting samples."""
        self.part.clear()
        for motions in self._motions.values():
            motions.clear()

    def change(self, values: dict[str, Any]) -> None:
        """Change gains of the coupling as soon as the signals that they need are available."""
        gains = schema(PassiveParameters if self._passive else CouplingParameters)
        for name in values.keys() - gains:
            raise ParameterError(f"{name}: the coupling is {self.parameters.coupling}")
        self.parameters = replace(self.parameters, **values)
        self._changed = True
        if self.parameters.damping > 0:
            for arm, motions in self._motions.items():
                if not motions.velocity:
                    motions.join(self.samples(ARM_TOPICS[arm].velocity, self.parameters.rate))

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled, and the energy in the tanks."""
        values = {
            "engaged": str(self.part.engaged).lower(),
            "positions held": str(self.part.held),
            "positions refused": str(self.engagement.refused),
        }
        for arm, half in zip(ARMS, self._passive.halves, strict=True) if self._passive else ():
            values |= {
                f"{arm} energy (mJ)": f"{half.energy * 1e3:.3f}",
                f"{arm} limited (%)": f"{half.limited * 100:.1f}",
            }
        return self.missing(), values

    def couple(self) -> bool:
        """Send the forces of every complete tick; return True if no tick is incomplete."""
        came = False
        for index, (arm, motions) in enumerate(self._motions.items()):
            for sample in motions.drain():
                came = True
                sample.arm = index
                self.part.put(sample, time.monotonic())
            if refusal := motions.arriving.sequence.refusal:
                self.engagement.watches[arm].refusal = f": {arm}: {refusal}"
        self.part.couple()
        self.publish([], self.part.forces, offset=0)
        self.part.forces.clear()
        return came and not self.part.waiting

    def publish(self, tools: list[ArmSample], commands: list[CoupledForces], offset: int) -> None:
        """Publish forces; the slave device publishes the tool's samples."""
        on_master, on_slave = self.forces.values()
        for caused in commands:
            on_master.send(caused.m_stamp + offset, (caused.m_x, caused.m_y, caused.m_z))
            on_slave.send(caused.s_stamp + offset, (caused.s_x, caused.s_y, caused.s_z))

    def prepare(self) -> None:
        """Begin the transition to new gains; a damper waits for velocities."""
        velocities = [motions.velocity for motions in self._motions.values()]
        flowing = self.sides or all(each and each.flowing for each in velocities)
        if self._changed and (flowing or not self._damped):
            self._changed = False
            self._coupling.change(self.parameters, round(FADE_TIME * self.parameters.rate))


def main() -> None:
    """Run the node."""
    run("coupler", Coupler)


if __name__ == "__main__":
    main()

"""Executable `coupler`: the position-position coupling of the two arms."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from haptic_accel.core.coupling.engagement import ARMS, Engagement
from haptic_accel.core.coupling.pairing import Pairing
from haptic_accel.core.coupling.position_position import (
    FADE_TIME,
    CouplingParameters,
    PositionPositionCoupling,
)
from haptic_accel.core.parameters import schema
from haptic_accel.nodes.coupling_node import ARM_TOPICS, MASTER, SLAVE, CouplingNode, Motions
from haptic_accel.nodes.scheduling import CATCH_UP, run


class Coupler(CouplingNode):
    """Couples both arms: the samples that they took at a tick cause the forces on both."""

    def __init__(self) -> None:
        super().__init__(tuple(schema(CouplingParameters)))
        self._coupling = PositionPositionCoupling(self.parameters)
        self._changed = False
        rate = self.parameters.rate
        self._pairing = Pairing(rate, round(CATCH_UP * rate))
        self._engaging = False
        damped = self.parameters.damping > 0
        self._motions = {
            arm: Motions(
                self.samples(signals.position, rate),
                self.samples(signals.velocity, rate) if damped else None,
            )
            for arm, signals in ARM_TOPICS.items()
        }

    def build_engagement(self, now: float) -> Engagement:
        """Return the engagement of both arms."""
        return Engagement(self.parameters, now)

    def start_anew(self) -> None:
        """Forget the samples that wait."""
        self._pairing.clear()
        for motions in self._motions.values():
            motions.clear()

    def change(self, values: dict[str, Any]) -> None:
        """Let gains of the coupling become others, as soon as there is what they need."""
        self.parameters = replace(self.parameters, **values)
        self._changed = True
        if self.parameters.damping > 0:
            for arm, motions in self._motions.items():
                if not motions.velocity:
                    motions.join(self.samples(ARM_TOPICS[arm].velocity, self.parameters.rate))

    def status(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled."""
        return self.missing(), {
            "engaged": str(self._coupling.engaged).lower(),
            "positions held": str(self._pairing.held),
        }

    def couple(self) -> bool:
        """Send the forces of every tick whose samples are there; return if none is incomplete."""
        coupled = False
        for index, motions in enumerate(self._motions.values()):
            for motion in motions.take():
                self.engagement.position_received(ARMS[index], time.monotonic())
                self._pairing.put(index, motion)
        for master, slave in self._pairing.pairs():
            coupled = True
            if self._engaging:
                self._engaging = False
                self._coupling.engage(master.position, slave.position)
            if self._coupling.engaged:
                on_master, on_slave = self._coupling.forces(
                    master.position, slave.position, master.velocity, slave.velocity
                )
                self.forces[MASTER].send(slave.stamp, on_master)
                self.forces[SLAVE].send(master.stamp, on_slave)
        return coupled and not self._pairing.waiting

    def engage(self) -> None:
        """Couple the arms with the next samples of both."""
        self._engaging = True

    def disengage(self) -> None:
        """Uncouple the arms."""
        self._engaging = False
        self._coupling.disengage()

    def prepare(self) -> None:
        """Begin to turn the gains into new ones; a damper waits for velocities."""
        velocities = [motions.velocity for motions in self._motions.values()]
        flowing = all(each and each.flowing for each in velocities)
        if self._changed and (flowing or not self.parameters.damping > 0):
            self._changed = False
            self._coupling.change(self.parameters, round(FADE_TIME * self.parameters.rate))


def main() -> None:
    """Run the node."""
    run("coupler", Coupler)


if __name__ == "__main__":
    main()

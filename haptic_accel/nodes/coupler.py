"""Executable `coupler`: the position-position coupling of the two arms."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from std_srvs.srv import SetBool

from haptic_accel.core import topics
from haptic_accel.core.coupling.engagement import ARMS, STEP_PERIOD, Engagement
from haptic_accel.core.coupling.pairing import Motion, Pairing
from haptic_accel.core.coupling.position_position import (
    FADE_TIME,
    CouplingParameters,
    PositionPositionCoupling,
)
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import schema
from haptic_accel.nodes.interface import GraphNode, Inbox, Samples
from haptic_accel.nodes.scheduling import CATCH_UP, ArrivalKeeper, run
from haptic_accel.nodes.stopping import LOOK_PERIOD, GraphStop

MASTER, SLAVE = ARMS
ARM_TOPICS = {MASTER: topics.MASTER, SLAVE: topics.SLAVE}


class Motions:
    """Positions of an arm, each joined with the velocity of the same sample.

    Parameters
    ----------
    positions : Samples
    velocities : Samples or None
        None where velocities are not needed, and count as zero.

    Attributes
    ----------
    flowing : bool
        Velocities come, so that positions wait for theirs.
    """

    def __init__(self, positions: Samples, velocities: Samples | None) -> None:
        self._arriving = positions
        self._joined = velocities
        self.flowing = velocities is not None
        self._positions: deque[tuple[int, Vector]] = deque()
        self._velocities: deque[tuple[int, Vector]] = deque()
        self._velocity = ZERO

    def join(self, velocities: Samples) -> None:
        """Join velocities from when they come."""
        self._joined = velocities

    @property
    def joined(self) -> bool:
        """Velocities are joined as soon as they come."""
        return self._joined is not None

    def take(self) -> Iterator[Motion]:
        """Yield the samples that are complete."""
        for sample in self._arriving.take():
            self._positions.append(sample)
        if self._joined:
            for sample in self._joined.take():
                self._velocities.append(sample)
                self.flowing = True
        while self._positions:
            stamp, position = self._positions[0]
            while self._velocities and self._velocities[0][0] <= stamp:
                received, self._velocity = self._velocities.popleft()
                if received == stamp:
                    break
            else:
                # A later velocity shows that this one is lost; then the one before stands for it.
                if self.flowing and not self._velocities:
                    return
            self._positions.popleft()
            yield Motion(stamp, position, self._velocity)

    def clear(self) -> None:
        """Forget what waits."""
        self._positions.clear()
        self._velocities.clear()


class Coupler(GraphNode):
    """Couples the arms while `Engagement` allows it.

    The samples that both arms took at a tick cause the forces on both. Services release the arms
    and take them again: `estop` stops both devices too, `~/engage` frees the arms alone.
    """

    task = "coupling"

    polls = True

    def __init__(self) -> None:
        super().__init__("coupler", tuple(schema(CouplingParameters)))
        self._coupling = PositionPositionCoupling(self.parameters)
        self._changed = False
        self._engagement = Engagement(self.parameters, time.monotonic())
        rate = self.parameters.rate
        self._pairing = Pairing(rate, round(CATCH_UP * rate))
        self._engaging = False
        self._arrivals = ArrivalKeeper(rate)
        self._forces = {
            MASTER: self.sender(topics.MASTER_ARM_FORCE),
            SLAVE: self.sender(topics.SLAVE_ARM_FORCE),
        }
        self._aside = False
        damped = self.parameters.damping > 0
        self._motions = {
            arm: Motions(
                self.samples(signals.position, rate),
                self.samples(signals.velocity, rate) if damped else None,
            )
            for arm, signals in ARM_TOPICS.items()
        }
        # Until the first message only: each costs the compensator a little.
        self._first_force: Inbox | None = None
        if self.parameters.compensated:
            self._first_force = self.inbox(topics.ACTUATOR_FORCE)
        self._stop = GraphStop(self, self._engagement.stop)
        self._stop_due = 0.0
        self._arm_stops = {arm: self.inbox(each.stopped) for arm, each in ARM_TOPICS.items()}
        self.create_service(SetBool, "~/engage", self._serve_engage)
        self.create_timer(STEP_PERIOD, self._step)

    def close(self) -> None:
        """Leave both arms without force."""
        self._let_go()

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
                if not motions.joined:
                    motions.join(self.samples(ARM_TOPICS[arm].velocity, self.parameters.rate))

    def report(self) -> None:
        """Publish the diagnostics, and whether all is stopped."""
        self._stop.tell()
        super().report()

    def status(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled."""
        return self._missing(), {
            "engaged": str(self._coupling.engaged).lower(),
            "positions held": str(self._pairing.held),
        }

    def _let_go(self) -> None:
        now = time.time_ns()
        for force in () if self._aside else self._forces.values():
            force.send(now, ZERO)

    def _step_aside(self, aside: bool) -> None:
        """Leave the arms' forces to other nodes, or send them again."""
        if aside != self._aside:
            self._aside = aside
            for force in self._forces.values():
                force.withdraw() if aside else force.offer()

    def work(self) -> float:
        """Follow the emergency stop, and couple the samples that came."""
        if (now := time.monotonic()) >= self._stop_due:
            self._stop_due = now + LOOK_PERIOD
            self._follow_stop()
        return self._arrivals.looked(found=self._couple())

    def _couple(self) -> bool:
        """Send the forces of every tick whose samples are there; return if none is incomplete."""
        coupled = False
        for index, motions in enumerate(self._motions.values()):
            for motion in motions.take():
                self._engagement.position_received(ARMS[index], time.monotonic())
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
                self._forces[MASTER].send(slave.stamp, on_master)
                self._forces[SLAVE].send(master.stamp, on_slave)
        return coupled and not self._pairing.waiting

    def stop_forces(self) -> None:
        """Stop all, and let both arms go."""
        self._engagement.stop.stop()
        self._follow_stop()

    def _follow_stop(self) -> None:
        """Act at once where the emergency stop has changed, whoever asked for it."""
        for arm, inbox in self._arm_stops.items():
            for stopped in self.states(inbox):
                self._engagement.arm_stopped(arm, stopped)
        if self._stop.follow():
            self._step()
            self.report()

    def _serve_engage(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        """Take both arms as soon as all is there, or release them."""
        refusal = self._engagement.request(request.data)
        if not refusal:
            self._step()
            self.report()
        response.success = not refusal
        response.message = refusal or self._missing()
        return response

    def _fade(self) -> None:
        """Begin to turn the gains into new ones; a damper waits for velocities."""
        if self.parameters.damping > 0 and not all(m.flowing for m in self._motions.values()):
            return
        self._changed = False
        self._coupling.change(self.parameters, round(FADE_TIME * self.parameters.rate))

    def _step(self) -> None:
        """Engage, release, or end, as things are now."""
        self._couple()
        self._step_aside(self._engagement.aside(time.monotonic()))
        if self._changed:
            self._fade()
        if self._first_force and self._first_force.take_vectors():
            self.destroy_subscription(self._first_force.subscription)
            self._first_force = None
            self._engagement.force_received()
            return  # that took a while: engaging waits for the next call
        decision = self._engagement.step(time.monotonic(), self._listeners())
        if decision.warning:
            self.get_logger().warning(decision.warning)
        if decision.release:
            self._engaging = False
            self._coupling.disengage()
            self._let_go()
        if decision.engage:
            self.get_logger().info("engaged")
            self._couple()  # what came meanwhile
            self._engaging = True  # with the next samples of both arms
        if decision.finished:
            self.finish(f"duration of {self.parameters.duration:g} s is over")

    def _listeners(self) -> int:
        return 0 if self._aside else min(force.listeners for force in self._forces.values())

    def _missing(self) -> str:
        return self._engagement.missing(time.monotonic(), self._listeners())


def main() -> None:
    """Run the node."""
    run("coupler", Coupler)


if __name__ == "__main__":
    main()

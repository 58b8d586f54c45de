"""Executable `coupler`: the position-position coupling of the two arms."""

from __future__ import annotations

import time
from functools import partial

from rclpy.subscription import Subscription
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.core import topics
from haptic_accel.core.coupling.engagement import ARMS, STEP_PERIOD, Engagement
from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import run

MASTER, SLAVE = ARMS


class Coupler(GraphNode):
    """Couples the arms while `Engagement` allows it.

    Each arm's sample causes the other arm's force, so that both forces are as fresh as they
    can be. Services release the arms and take them again: `estop` stops both devices too,
    `~/engage` frees the arms alone.
    """

    def __init__(self) -> None:
        super().__init__("coupler")
        self._coupling = PositionPositionCoupling(self.parameters)
        self._engagement = Engagement(self.parameters, time.monotonic())
        self._positions = dict.fromkeys(ARMS, ZERO)
        self._velocities = dict.fromkeys(ARMS, ZERO)
        self._forces = {
            MASTER: self.sender(topics.MASTER_ARM_FORCE),
            SLAVE: self.sender(topics.SLAVE_ARM_FORCE),
        }
        for arm, signals in ((MASTER, topics.MASTER), (SLAVE, topics.SLAVE)):
            self.listen(signals.position, partial(self._on_position, arm))
            if self.parameters.damping > 0:
                self.listen(signals.velocity, partial(self._on_velocity, arm))
        # Received until the first message only: it costs a core a little at each sample.
        self._first_force: Subscription | None = None
        if self.parameters.compensated:
            self._first_force = self.listen(
                topics.ACTUATOR_FORCE, lambda *_: self._engagement.force_received()
            )
        self._publish_stop = self.publisher(topics.EMERGENCY_STOP).publish
        self.listen_state(topics.EMERGENCY_STOP, self._on_stop)
        self.create_service(SetBool, topics.EMERGENCY_STOP.name, self._serve_stop)
        self.create_service(SetBool, "~/engage", self._serve_engage)
        self.create_timer(STEP_PERIOD, self._step)

    def close(self) -> None:
        """Leave both arms without force."""
        self._let_go()
        super().close()

    def status(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled."""
        return self._missing(), {"engaged": str(self._coupling.engaged).lower()}

    def _let_go(self) -> None:
        now = time.time_ns()
        for force in self._forces.values():
            force.send(now, ZERO)

    def _on_position(self, arm: str, moment: int, position: Vector) -> None:
        """Note an arm's position, and send the force on the other arm."""
        self._positions[arm] = position
        self._engagement.position_received(arm, time.monotonic())
        if self._coupling.engaged:
            on_master, on_slave = self._coupling.forces(
                *self._positions.values(), *self._velocities.values()
            )
            other, force = (SLAVE, on_slave) if arm == MASTER else (MASTER, on_master)
            self._forces[other].send(moment, force)

    def _on_velocity(self, arm: str, moment: int, velocity: Vector) -> None:
        self._velocities[arm] = velocity

    def _on_stop(self, stop: bool) -> None:
        """Follow the emergency stop, whoever asked for it."""
        if self._engagement.stop(stop, time.monotonic()):
            self._step()
            self.report()

    def _latch(self, stop: bool) -> None:
        """Publish the emergency stop or its release, also for nodes that start later."""
        self._engagement.latch(stop)
        self._publish_stop(Bool(data=stop))

    def _serve_stop(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        """Stop everything at once, or release it."""
        self._latch(request.data)
        self._on_stop(request.data)
        response.success = True
        response.message = "stopped" if request.data else "released"
        return response

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

    def _step(self) -> None:
        """Engage, release, or end, as things are now."""
        decision = self._engagement.step(time.monotonic(), self._listeners())
        if decision.latch:
            self._latch(True)
        if decision.warning:
            self.get_logger().warning(decision.warning)
        if decision.release:
            self._coupling.disengage()
            self._let_go()
        if decision.engage:
            self._coupling.engage(*self._positions.values())
            if self._first_force:
                self.destroy_subscription(self._first_force)
                self._first_force = None
            self.get_logger().info("engaged")
        if decision.finished:
            self.finish(f"duration of {self.parameters.duration:g} s is over")

    def _listeners(self) -> int:
        return min(force.listeners for force in self._forces.values())

    def _missing(self) -> str:
        return self._engagement.missing(time.monotonic(), self._listeners())


def main() -> None:
    """Run the node."""
    run("coupler", Coupler)


if __name__ == "__main__":
    main()

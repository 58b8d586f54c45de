"""Executable `coupler`: the position-position coupling of the two arms."""

from __future__ import annotations

import math
import time

from rclpy.subscription import Subscription
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.core import topics
from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.topics import Topic
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import run

LOOK_PERIOD = 0.02
"""How often silence and the end of the duration are looked for, s."""

NAG_PERIOD = 5.0
"""How often an arm that does not come is asked for, s."""

STOPPED = "emergency stop"
"""Why the arms are free while the emergency stop is not released."""

DISENGAGED = "let go on request"
"""Why they are after `~/engage` with false."""


class Arm:
    """The latest of one arm, and the sender of its force."""

    def __init__(self, node: GraphNode, name: str, force: Topic) -> None:
        self.name = name
        self.position = self.velocity = ZERO
        self.heard = -math.inf
        self.force = node.sender(force)

    def take_position(self, position: Vector) -> None:
        """Keep a position."""
        self.position = position
        self.heard = time.monotonic()

    def take_velocity(self, moment: int, velocity: Vector) -> None:
        """Keep a velocity."""
        self.velocity = velocity


class Coupler(GraphNode):
    """Engages when both arms are heard and the others there, lets go when an arm falls silent.

    Each arm's sample causes the other arm's force, so that both forces are as fresh as they
    can be. Services let the arms go and take them again: `estop` stops both devices too,
    `~/engage` frees the arms alone.
    """

    def __init__(self) -> None:
        super().__init__("coupler")
        self._coupling = PositionPositionCoupling(self.parameters)
        self._master = Arm(self, "master", topics.MASTER_ARM_FORCE)
        self._slave = Arm(self, "slave", topics.SLAVE_ARM_FORCE)
        self._engaged_at: float | None = None
        self._asked = time.monotonic()
        self.listen(topics.MASTER_POSITION, self._on_master)
        self.listen(topics.SLAVE_POSITION, self._on_slave)
        if self.parameters.damping > 0:
            self.listen(topics.MASTER_VELOCITY, self._master.take_velocity)
            self.listen(topics.SLAVE_VELOCITY, self._slave.take_velocity)
        # Heard until the first message only: it costs a core a little at each sample.
        self._first_force: Subscription | None = None
        self._compensator_heard = not self.parameters.compensated
        if self.parameters.compensated:
            self._first_force = self.listen(topics.ACTUATOR_FORCE, self._hear_compensator)
        self._engage = True
        self._stopped_since: float | None = None
        self._latched = False
        self._publish_stop = self.publisher(topics.EMERGENCY_STOP).publish
        self.listen_state(topics.EMERGENCY_STOP, self._on_stop)
        self.create_service(SetBool, topics.EMERGENCY_STOP.name, self._serve_stop)
        self.create_service(SetBool, "~/engage", self._serve_engage)
        self.create_timer(LOOK_PERIOD, self._look)

    def close(self) -> None:
        """Let both arms go."""
        self._let_go()
        super().close()

    def _let_go(self) -> None:
        now = time.time_ns()
        self._master.force.send(now, ZERO)
        self._slave.force.send(now, ZERO)

    def status(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled."""
        return self._missing(), {"engaged": str(self._coupling.engaged).lower()}

    def _hear_compensator(self, moment: int, force: Vector) -> None:
        self._compensator_heard = True

    def _on_master(self, moment: int, position: Vector) -> None:
        self._master.take_position(position)
        self._couple(self._slave, moment)

    def _on_slave(self, moment: int, position: Vector) -> None:
        self._slave.take_position(position)
        self._couple(self._master, moment)

    def _couple(self, arm: Arm, moment: int) -> None:
        """Send an arm its force."""
        if not self._coupling.engaged:
            return
        master, slave = self._master, self._slave
        on_master, on_slave = self._coupling.forces(
            master.position, slave.position, master.velocity, slave.velocity
        )
        arm.force.send(moment, on_master if arm is master else on_slave)

    def _on_stop(self, stop: bool) -> None:
        """Follow the emergency stop, whoever asked for it."""
        if stop == self._stopped:
            return
        self._stopped_since = time.monotonic() if stop else None
        self._look()
        self.report()

    def _latch(self, stop: bool) -> None:
        """Publish the emergency stop or its release, for the devices and for who comes later."""
        self._latched = stop
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
        """Take both arms as soon as all is there, or let them go."""
        if request.data and self._stopped:
            response.message = f"{STOPPED}: release it first"
            return response
        self._engage = request.data
        self._look()
        self.report()
        response.success = True
        response.message = self._missing()
        return response

    def _look(self) -> None:
        """Engage, let go, or end, as things are now."""
        now = time.monotonic()
        self._remember_stop(now)
        missing = self._missing()
        if self._coupling.engaged and missing:
            self.get_logger().warning(f"let go: {missing}")
            self._coupling.disengage()
            self._let_go()
        elif not (self._coupling.engaged or missing):
            self._coupling.engage(self._master.position, self._slave.position)
            self._engaged_at = self._engaged_at or now
            if self._first_force:
                self.destroy_subscription(self._first_force)
                self._first_force = None
            self.get_logger().info("engaged")
        elif missing and not self._held and now - self._asked > NAG_PERIOD:
            self._asked = now
            self.get_logger().warning(missing)
        duration = self.parameters.duration
        over = duration > 0 and self._engaged_at and now - self._engaged_at >= duration
        if over and not self.finished.done():
            self.get_logger().info(f"duration of {duration:g} s is over")
            self.finished.set_result(None)

    @property
    def _stopped(self) -> bool:
        return self._stopped_since is not None

    def _remember_stop(self, now: float) -> None:
        """Latch a stop that another published, who may be gone before a device comes.

        Not at once: what this node published itself is still to be heard.
        """
        if self._latched or self._stopped_since is None:
            return
        if now - self._stopped_since > LOOK_PERIOD:
            self._latch(True)

    def _silent(self, arm: Arm) -> bool:
        return bool(time.monotonic() - arm.heard > self.parameters.timeout)

    @property
    def _held(self) -> str:
        """Say who wants the arms free; empty if nobody does."""
        if self._stopped:
            return STOPPED
        return "" if self._engage else DISENGAGED

    def _missing(self) -> str:
        """Say what engaging waits for, or what has gone; empty when all is there."""
        if self._held:
            return self._held
        silent = [arm.name for arm in (self._master, self._slave) if self._silent(arm)]
        if silent:
            return f"waiting for the position of {' and '.join(silent)}"
        if self._coupling.engaged:
            return ""
        if not self._compensator_heard:
            return "waiting for the compensator's force"
        listeners = min(self._master.force.listeners, self._slave.force.listeners)
        if listeners < self.parameters.listeners:
            return (
                "waiting for subscribers of the arms' forces: there are"
                f" {listeners} of {self.parameters.listeners}"
            )
        return ""


def main() -> None:
    """Run the node."""
    run("coupler", Coupler)


if __name__ == "__main__":
    main()

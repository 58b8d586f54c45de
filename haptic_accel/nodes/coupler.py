"""Executable `coupler`: the position-position coupling of the two arms."""

from __future__ import annotations

import math
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped

from haptic_accel.core.coupling import ZERO, PositionPositionCoupling, Vector
from haptic_accel.nodes import topics
from haptic_accel.nodes.interface import GraphNode, stamp, stamp_of
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.topics import Topic

LOOK_PERIOD = 0.02
"""How often silence and the end of the duration are looked for, s."""

NAG_PERIOD = 5.0
"""How often an arm that does not come is asked for, s."""


class Arm:
    """The latest of one arm, and the sender of its force."""

    def __init__(self, node: GraphNode, name: str, force: Topic) -> None:
        self.name = name
        self.position = self.velocity = ZERO
        self.heard = -math.inf
        self._message = WrenchStamped()
        self._message.header.frame_id = force.frame
        self._publisher = node.publisher(force)

    def take_position(self, message: Any) -> None:
        """Keep a position."""
        point = message.pose.position
        self.position = (point.x, point.y, point.z)
        self.heard = time.monotonic()

    def take_velocity(self, message: Any) -> None:
        """Keep a velocity."""
        linear = message.twist.linear
        self.velocity = (linear.x, linear.y, linear.z)

    def send(self, force: Vector, moment: int) -> None:
        """Publish a force with the stamp of the sample that caused it."""
        stamp(self._message, moment)
        vector = self._message.wrench.force
        vector.x, vector.y, vector.z = force
        self._publisher.publish(self._message)

    @property
    def listeners(self) -> int:
        """How many subscribe to its force."""
        return int(self._publisher.get_subscription_count())


class Coupler(GraphNode):
    """Engages when both arms are heard, lets go when one falls silent.

    Each arm's sample causes the other arm's force, so that both forces are as fresh as they
    can be.
    """

    def __init__(self) -> None:
        super().__init__("coupler")
        self._coupling = PositionPositionCoupling(self.parameters)
        self._master = Arm(self, "master", topics.MASTER_ARM_FORCE)
        self._slave = Arm(self, "slave", topics.SLAVE_ARM_FORCE)
        self._engaged_at: float | None = None
        self._asked = time.monotonic()
        self.subscribe(topics.MASTER_POSITION, self._on_master)
        self.subscribe(topics.SLAVE_POSITION, self._on_slave)
        if self.parameters.damping > 0:
            self.subscribe(topics.MASTER_VELOCITY, self._master.take_velocity)
            self.subscribe(topics.SLAVE_VELOCITY, self._slave.take_velocity)
        self.create_timer(LOOK_PERIOD, self._look)

    def close(self) -> None:
        """Let both arms go."""
        now = time.time_ns()
        self._master.send(ZERO, now)
        self._slave.send(ZERO, now)

    def status(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled."""
        engaged = self._coupling.engaged
        return "" if engaged else self._missing(), {"engaged": str(engaged).lower()}

    def _on_master(self, message: Any) -> None:
        self._master.take_position(message)
        self._couple(self._slave, stamp_of(message))

    def _on_slave(self, message: Any) -> None:
        self._slave.take_position(message)
        self._couple(self._master, stamp_of(message))

    def _couple(self, arm: Arm, moment: int) -> None:
        """Send an arm its force."""
        master, slave = self._master, self._slave
        if not self._coupling.engaged and not self._engage():
            return
        on_master, on_slave = self._coupling.forces(
            master.position, slave.position, master.velocity, slave.velocity
        )
        arm.send(on_master if arm is master else on_slave, moment)

    def _engage(self) -> bool:
        master, slave = self._master, self._slave
        if self._silent(master) or self._silent(slave):
            return False
        if min(master.listeners, slave.listeners) < self.parameters.listeners:
            return False
        self._coupling.engage(master.position, slave.position)
        self._engaged_at = self._engaged_at or time.monotonic()
        self.get_logger().info("engaged")
        return True

    def _look(self) -> None:
        now = time.monotonic()
        if self._coupling.engaged and (self._silent(self._master) or self._silent(self._slave)):
            self.get_logger().warning(f"let go: {self._missing()}")
            self._coupling.disengage()
            self.close()
        if not self._coupling.engaged and now - self._asked > NAG_PERIOD:
            self._asked = now
            self.get_logger().warning(self._missing())
        duration = self.parameters.duration
        if self.finished.done():
            return
        if duration > 0 and self._engaged_at and now - self._engaged_at >= duration:
            self.get_logger().info(f"duration of {duration:g} s is over")
            self.finished.set_result(None)

    def _silent(self, arm: Arm) -> bool:
        return bool(time.monotonic() - arm.heard > self.parameters.timeout)

    def _missing(self) -> str:
        arms = (self._master, self._slave)
        silent = [arm.name for arm in arms if self._silent(arm)]
        if silent:
            return f"waiting for the position of {' and '.join(silent)}"
        return (
            f"waiting for subscribers of the arms' forces: {min(arm.listeners for arm in arms)}"
            f" of {self.parameters.listeners}"
        )


def main() -> None:
    """Run the node."""
    run(Coupler, "coupler")


if __name__ == "__main__":
    main()

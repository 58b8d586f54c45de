"""Executable `restamper`: in the slave device's place, what `ros2 bag play` publishes.

A bag's stamps are those of the day it was recorded. Here they are moved to now, all by the same
time, so that every node takes the samples for fresh ones; the forces on the slave do nothing.
"""

from __future__ import annotations

import time
from dataclasses import replace

from std_msgs.msg import Bool

from haptic_accel.core import topics
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.model import Vector
from haptic_accel.core.restamping import StampShift
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import PLAYED, SLAVE_SIGNALS, Topic
from haptic_accel.nodes.device_node import quantiles
from haptic_accel.nodes.interface import GraphNode, Sender
from haptic_accel.nodes.scheduling import run, system_time

LOOK_PERIOD = 0.1
"""How often the others are looked for until they are there, s."""


class Restamper(GraphNode):
    """Passes the slave's played signals on, with their stamps moved to now."""

    def __init__(self) -> None:
        super().__init__("restamper")
        self._period = NANOSECONDS / self.parameters.rate
        self._shift = StampShift(
            self._grid_point, round(self._period), round(self.parameters.drift * NANOSECONDS)
        )
        self._age = DurationHistogram()
        self._told = self._forces = 0
        self._senders = [self._pass_on(topic) for topic in SLAVE_SIGNALS]
        # The coupler waits for whoever takes the arm's force, and an emergency stop for whoever
        # obeys it.
        self.listen(topics.SLAVE_ARM_FORCE, self._ignore)
        self._publish_stopped = self.publisher(topics.SLAVE_STOPPED).publish
        self.listen_state(topics.EMERGENCY_STOP, self._stop)
        self._looking = self.create_timer(LOOK_PERIOD, self._look)

    def status(self) -> tuple[str, dict[str, str]]:
        """Return how old samples were when passed on, and how often they drifted away."""
        anew = max(0, self._shift.anchored - 1)
        new, self._told = anew - self._told, anew
        warning = (
            f"played stamps drifted {new} times by more than {self.parameters.drift:g} s:"
            " they must be played at their original rate"
        )
        return warning if new else "", {
            "samples": str(self._age.count),
            **quantiles(self._age, "age of samples"),
            "stamps moved anew": str(anew),
            "arm forces ignored": str(self._forces),
        }

    def _pass_on(self, topic: Topic) -> Sender:
        """Take a played signal and publish it as the slave's own; return what publishes it."""
        sender = self.sender(topic)
        counted = topic is topics.TOOL_ACCELERATION

        def take(stamp: int, vector: Vector) -> None:
            now = time.time_ns()
            moved = self._shift.moved(stamp, now)
            if moved is None:
                return
            sender.send(moved, vector)
            if counted:
                self._age.add((now - moved) / NANOSECONDS)

        self.listen(replace(topic, name=f"{PLAYED}/{topic.name}"), take)
        return sender

    def _grid_point(self, moment: int) -> int:
        """Return the last point of the machine's sampling grid up to a moment, system time."""
        steady = moment - system_time(0)
        return system_time(round(steady // self._period * self._period))

    def _look(self) -> None:
        """Say once that all others are there."""
        acceleration, position, _ = self._senders
        if min(acceleration.listeners, position.listeners) >= self.parameters.listeners:
            self._looking.cancel()
            self.get_logger().info(f"ready: play the slave's topics below /{PLAYED}")

    def _ignore(self, moment: int, force: Vector) -> None:
        self._forces += 1

    def _stop(self, stop: bool) -> None:
        self._publish_stopped(Bool(data=stop))


def main() -> None:
    """Run the node."""
    run("restamper", Restamper)


if __name__ == "__main__":
    main()

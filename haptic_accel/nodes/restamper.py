# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `restamper`: replaces the slave device by the topics of `ros2 bag play`.

A bag's stamps are those of the day it was recorded. Here they are moved to now, all by the same
time, so that every node accepts the samples as fresh; the forces on the slave do nothing.
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
"""Interval between looks for the other nodes until they are there, s."""


class Restamper(GraphNode):
    """Publishes the slave's played signals again, with their stamps moved to now."""

    task = "restamping"

    def __init__(self) -> None:
        super().__init__("restamper")
        self._period = NANOSECONDS / self.parameters.rate
        self._shift = StampShift(
            self._grid_point, round(self._period), round(self.parameters.drift * NANOSECONDS)
        )
        self._age = DurationHistogram()
        self._reported = self._forces = 0
        self._senders = [self._pass_on(topic) for topic in SLAVE_SIGNALS]
        # The coupler waits for a subscriber of the arm's force, and for the device's word that it
        # is not stopped; `haptic-accel estop` waits for its answer to an emergency stop.
        self.listen(topics.SLAVE_ARM_FORCE, self._ignore)
        self._stopped = False
        self._publish_stopped = self.publisher(topics.SLAVE_STOPPED).publish
        self.listen_state(topics.COUPLER_STOPPED, self._follow)
        self._looking = self.create_timer(LOOK_PERIOD, self._look)

    def status(self) -> tuple[str, dict[str, str]]:
        """Return the samples' ages, and how often their stamps drifted away."""
        anew = max(0, self._shift.anchored - 1)
        new, self._reported = anew - self._reported, anew
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

    def report(self) -> None:
        """Publish the diagnostics, and whether there is an emergency stop."""
        super().report()
        self._publish_stopped(Bool(data=self._stopped))

    def _follow(self, stopped: bool) -> None:
        """Answer as a device does, which has no forces here and no reason to stay stopped."""
        self._stopped = stopped
        self.report()

    def _pass_on(self, topic: Topic) -> Sender:
        """Publish a played signal as the slave's own; return its sender."""
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
        """Log once that all other nodes are there."""
        acceleration, position, _ = self._senders
        if min(acceleration.listeners, position.listeners) >= self.parameters.listeners:
            self._looking.cancel()
            played = self.resolve_topic_name(PLAYED)
            self.get_logger().info(f"ready: play the slave's topics below {played}")

    def _ignore(self, moment: int, force: Vector) -> None:
        self._forces += 1


def main() -> None:
    """Run the node."""
    run("restamper", Restamper)


if __name__ == "__main__":
    main()

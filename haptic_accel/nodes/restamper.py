# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `restamper`: replaces the slave device by the topics of `ros2 bag play`.

The stamps in a bag are past times. This node shifts them, all by the same offset, to ticks after
the samples' arrivals, and publishes the samples at these ticks as a device would; forces on the
slave have no effect.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from std_msgs.msg import Bool

from haptic_accel.core import topics
from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick.watching import DurationHistogram
from haptic_accel.core.topics import PLAYED, SLAVE_SIGNALS, Topic
from haptic_accel.devices.interface import DeviceError
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.signals import Publishers, Sender
from haptic_accel.nodes.timing import system_time

DISCOVERY_PERIOD = 0.1
"""Interval between checks for the other nodes until all are found, s."""


class Restamper(GraphNode):
    """Node that publishes the played signals of the slave at ticks, with the ticks' stamps."""

    task = "restamping"

    def __init__(self) -> None:
        super().__init__("restamper")
        self._period = NANOSECONDS / self.parameters.rate
        self._shift = StampShift(
            self._grid_point, round(self._period), round(self.parameters.drift * NANOSECONDS)
        )
        self._lead = DurationHistogram()
        self._reported = self._forces = self._past_tick = 0
        self._failure = ""
        self._waiting: list[tuple[Sender, deque[tuple[int, Vector]]]] = []
        self._senders = [self._pass_on(topic) for topic in SLAVE_SIGNALS]
        # The coupler waits for a subscriber of the arm's force and for the device's state "not
        # stopped"; `haptic-accel estop` waits for the device's answer to a stop.
        self.listen(topics.SLAVE_ARM_FORCE, self._ignore)
        self._stopped = False
        self._publish_stopped = self.publisher(topics.SLAVE_STOPPED).publish
        self.listen_state(topics.COUPLER_STOPPED, self._follow)
        self._looking = self.create_timer(DISCOVERY_PERIOD, self._check_listeners)

    def work(self) -> float:
        """Publish the due samples; return the steady time at which the next are due, s."""
        now, due = time.time_ns(), math.inf
        for sender, waiting in self._waiting:
            while waiting and waiting[0][0] <= now:
                sender.send(*waiting.popleft())
            if waiting:
                due = min(due, time.monotonic() + (waiting[0][0] - now) / NANOSECONDS)
        return due

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return the waiting time of samples, and the number of repeated shift measurements."""
        moves = max(0, self._shift.anchored - 1)
        new, self._reported = moves - self._reported, moves
        warning = (
            f"played stamps were moved again {new} times: they must be played at their original"
            " rate, by a player that keeps it"
        )
        return warning if new else "", {
            "samples": str(self._lead.count),
            "samples after their tick": str(self._past_tick),
            **self._lead.diagnostics("time to their tick"),
            "stamps moved again": str(moves),
            "arm forces ignored": str(self._forces),
        }

    def repeat_states(self) -> None:
        """Publish the state of the emergency stop."""
        self._publish_stopped(Bool(data=self._stopped))

    def _follow(self, stopped: bool) -> None:
        """Acknowledge the emergency stop as a device would; this node outputs no forces."""
        self._stopped = stopped
        self.report()

    def _pass_on(self, topic: Topic) -> Sender:
        """Publish a played signal as the slave's; return its sender."""
        sender = self.sender(topic)
        waiting = deque[tuple[int, Vector]]()
        self._waiting.append((sender, waiting))
        is_counted = topic is topics.TOOL_ACCELERATION

        def receive(stamp: int, vector: Vector) -> None:
            if publishers.senders > 1:
                return
            now = time.time_ns()
            said = self._shift.anchored
            try:
                moved = self._shift.moved(stamp, now)
            except PaceError as error:
                self._failure = f"{self.resolve_topic_name(PLAYED)}: {error}"
                self.finish()
                return
            if moved is None or self._failure:
                return
            waiting.append((moved, vector))
            if is_counted:
                self._lead.add(max(0, moved - now) / NANOSECONDS)
                self._past_tick += moved < now
            if not said:
                self.get_logger().info(
                    f"played samples are used {LEAD / 1e6:g} ms after their arrival, at a tick;"
                    " the latency of their forces counts from this tick"
                )

        played = replace(topic, name=f"{PLAYED}/{topic.name}")
        publishers = Publishers(self.listen(played, receive))
        self.watch_senders(played, publishers)
        return sender

    def close(self) -> None:
        """Raise an error if played samples were refused, with the reason."""
        if self._failure:
            raise DeviceError(self._failure)

    def _grid_point(self, moment: int) -> int:
        """Return the first point of the sampling grid at or after a system time, ns."""
        steady = moment - system_time(0)
        return system_time(round(math.ceil(steady / self._period) * self._period))

    def _check_listeners(self) -> None:
        """Log once that all other nodes exist."""
        acceleration, position, _ = self._senders
        if min(acceleration.listeners, position.listeners) >= self.parameters.listeners:
            self._looking.cancel()
            played = self.resolve_topic_name(PLAYED)
            self.get_logger().info(f"ready: play the slave's topics below {played}")

    def _ignore(self, moment: int, force: Vector) -> None:
        self._forces += 1


LISTENING = 100_000_000
"""Duration of a comparison of arrivals, ns: at the start, as the first arrival may be delayed, and
while all samples arrive after their ticks."""

LEAD = 20_000_000
"""Time from the arrival of an undelayed sample until it is used, ns. A player pauses for longer
only on a busy machine. Nobody feels it, as no force acts on replayed arms."""


PACE_TIME = 1_000_000_000
"""Time after which stamps that advance at another pace than arrivals are refused, ns."""

FASTEST = 20.0
"""Largest plausible playback speed, or its inverse; implausible stamps are compared again."""

PACE = 0.2
"""Maximum difference of the stamps' pace from 1: a busy machine delays arrivals by 0.1 s."""


class PaceError(Exception):
    """Error: stamps advance at another rate than their arrivals; the message is one line."""


class StampShift:
    """Constant offset for all recorded stamps that moves each to a future tick.

    The spacing of stamps remains as recorded, however unevenly samples arrive. The fastest
    early arrival determines the offset, which is determined again if stamps and arrivals drift
    apart: a bag is played in a loop, or its player is slow. A bag played at another speed from
    the start is refused.

    Parameters
    ----------
    grid : callable
        Function from a time to the next point of the sampling grid, both system times in ns.
        Shifted stamps lie on the grid of the other arm's samples.
    period : int
        Period of the grid, ns.
    limit : int
        Maximum delay of an arrival relative to its shifted stamp, ns, and maximum time by which
        it may be earlier than the fastest.

    Attributes
    ----------
    anchored : int
        Number of times the offset was determined; one for a playback at original speed.
    """

    def __init__(self, grid: Callable[[int], int], period: int, limit: int) -> None:
        self._grid = grid
        # The next point of the grid may be a period later. Early samples wait for their tick: an
        # earlier stamp would look like a clock that was set back.
        self._ahead = LEAD + 2 * period + limit
        self._behind = limit
        self._until: int | None = None
        self._quickest = 0
        self._begin: tuple[int, int] | None = None
        self._last = 0
        self._offset: int | None = None
        self.anchored = 0

    def moved(self, stamp: int, now: int) -> int | None:
        """Return the shifted stamp of a sample; None during the comparison.

        Parameters
        ----------
        stamp : int
            Recorded stamp, ns.
        now : int
            Arrival time, system time, ns.

        Raises
        ------
        PaceError
            The samples are played at another speed.
        """
        if self._offset is None:
            if self._begin is None or self._until is None or stamp < self._last:
                self._until, self._quickest = now + LISTENING, now - stamp
                self._begin = stamp, now
            self._last = stamp
            self._quickest = min(self._quickest, now - stamp)
            if now < self._until or not self._keeps_pace(
                stamp - self._begin[0], now - self._begin[1]
            ):
                return None
            self._anchor(stamp, self._quickest)
        elif not -self._ahead <= now - stamp - self._offset <= self._behind:
            self._anchor(stamp, now - stamp)
        elif now <= stamp + self._offset:
            self._until = None
        elif self._until is None:  # first arrival after its tick
            self._until, self._quickest = now + LISTENING, now - stamp
        else:
            self._quickest = min(self._quickest, now - stamp)
            if now >= self._until:
                self._anchor(stamp, self._quickest)
        assert self._offset is not None
        return stamp + self._offset

    def _keeps_pace(self, advance: int, elapsed: int) -> bool:
        """Return whether stamps advance at the pace of their arrivals, as far as is known."""
        pace = advance / elapsed
        if abs(pace - 1) <= PACE:
            return True
        if elapsed < PACE_TIME:
            return False
        if not 1 / FASTEST <= pace <= FASTEST:
            self._begin = None
            return False
        raise PaceError(
            f"stamps advance by {pace:.2g} s per second: must be played at their original rate,"
            " as by ros2 bag play without --rate; replay with rate:= plays a bag at another speed"
        )

    def _anchor(self, stamp: int, distance: int) -> None:
        self._offset = self._grid(stamp + distance + LEAD) - stamp
        self._until = None
        self.anchored += 1


def main() -> None:
    """Run the node."""
    run_nodes("restamper", Restamper)


if __name__ == "__main__":
    main()

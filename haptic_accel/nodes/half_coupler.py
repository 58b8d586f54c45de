# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `half_coupler`: the half of the coupling at this host's arm.

Its datagrams go to and come from the link of this host, which carries them to the peer's.
"""

from __future__ import annotations

import math
import secrets
import time

from haptic_accel.core import topics
from haptic_accel.core.arm_end import ArmEnd
from haptic_accel.core.coupling.half_engagement import HalfEngagement
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.model import ZERO
from haptic_accel.core.network import endpoint
from haptic_accel.core.network.endpoint import State
from haptic_accel.core.network.playout import KINDS, WAITING
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, along_actuator
from haptic_accel.links.local import COUPLER, LocalEnd
from haptic_accel.nodes.coupling_node import ARM_TOPICS, SLAVE, CouplingNode, Motions
from haptic_accel.nodes.interface import Samples
from haptic_accel.nodes.scheduling import RateKeeper, run, system_time, wake_time


class HalfCoupler(CouplingNode):
    """Couples the arm of this host to that of the peer.

    On the master's host the tool's acceleration is played, one sample at each tick of the
    grid on which devices sample, and with its stamp, as if the slave's device were here.
    """

    def __init__(self) -> None:
        super().__init__()
        p = self.parameters
        topics_here = ARM_TOPICS[p.side]
        self._end = ArmEnd(p.side, p, p.rate, p.latency, self._session)
        self._half, self._endpoint = self._end.half, self._end.endpoint
        self._local = LocalEnd(
            COUPLER, self.context.get_domain_id(), self.get_namespace().rstrip("/")
        )
        self._motions = Motions(
            *(
                self.samples(topic, p.rate)
                for topic in (topics_here.position, topics_here.velocity, topics_here.work)
            )
        )
        self._motion: Motion | None = None
        self._ready = False
        self._told: set[str] = set()
        self._look_due = 0.0
        (there,) = set(ARM_TOPICS) - {p.side}
        self._send_peer_position = self.sender(ARM_TOPICS[there].position).send
        self._tools: Samples | None = None
        self._ticks: RateKeeper | None = None
        if p.side == SLAVE:
            self._tools = self.samples(topics.TOOL_ACCELERATION, p.rate)
        else:
            self._send_tool = self.sender(topics.TOOL_ACCELERATION).send
            self._ticks = RateKeeper(p.rate, lead=wake_time())

    def build_engagement(self, now: float) -> HalfEngagement:
        """Return the engagement of this host's arm."""
        self._session = secrets.randbits(64) or 1
        self._here = HalfEngagement(self.parameters, now, self.parameters.side, self._session)
        return self._here

    def start_anew(self) -> None:
        """Forget the samples that wait."""
        self._motions.clear()

    def close(self) -> None:
        """Leave the arm without force, and the path to the link to others."""
        super().close()
        self._local.close()

    def status(self) -> tuple[str, dict[str, str]]:
        """Return what is wrong with the peer or missing, and the values of network and law."""
        now, system = time.monotonic(), time.time_ns()
        half, playout = self._half, self._endpoint.playout
        values = {
            "engaged": str(half.engaged).lower(),
            **self._endpoint.status(system, now),
            "packets not taken by the link": str(self._local.dropped),
            "stiffness (N/m)": f"{half.stiffness:.1f}",
            "damping (N s/m)": f"{half.damping:.2f}",
            "energy account (mJ)": f"{half.energy * 1e3:.3f}",
            "force limited by the account (%)": f"{100 * half.limited:.1f}",
        }
        if self._ticks:
            played = sum(playout.counts[kind] for kind in KINDS if kind != WAITING)
            values["playout delay (ms)"] = f"{playout.delay * 1e3:.2f}"
            values["samples played"] = str(played)
            for kind in (*(kind for kind in KINDS if kind != WAITING), "late"):
                share = 100 * playout.counts[kind] / played if played else 0.0
                values[f"samples {kind} (%)"] = f"{share:.3f}"
        problems = self._endpoint.problems(system, now).values()
        return "; ".join(filter(None, (self.missing(), *problems))), values

    def work(self) -> float:
        """Exchange packets, play what is due, and couple the samples that came."""
        self._exchange(time.monotonic())
        if self._here.is_left(time.monotonic()):
            self.step()
        following = self._play()
        if time.monotonic() >= self._look_due:
            self._look_due = super().work()
        self._send()
        return min(self._look_due, following)

    def step(self) -> None:
        """Engage, release, or end, as things are now; say what is wrong with the peer."""
        super().step()
        now = time.monotonic()
        self._ready = self._here.ready(now, self.listeners)
        for kind, line in self._endpoint.problems(time.time_ns(), now).items():
            if kind not in self._told:
                self._told.add(kind)
                self.get_logger().warning(line)

    def couple(self) -> bool:
        """Send the force of every sample that is complete; return if none waits."""
        if self._tools:
            for stamp, acceleration in self._tools.take():
                self._endpoint.sampled(stamp, acceleration[ACTUATOR_AXIS])
        coupled = False
        for motion in self._motions.take():
            if not math.isfinite(sum(motion.position) + sum(motion.velocity)):
                continue  # a sample that says nothing of the arm counts as missing
            coupled = True
            now = time.monotonic()
            self._here.position_received(self._here.arms[0], now)
            self._motion = motion
            if self._half.engaged:
                self._send_force(motion, now)
        return coupled and not self._motions.waiting

    def engage(self) -> None:
        """Couple the arm where it is."""
        self._end.engage(self._motion.position if self._motion else ZERO)

    def disengage(self) -> None:
        """Uncouple the arm."""
        self._half.disengage()

    def _exchange(self, now: float) -> None:
        """Take the packets that came."""
        for data in self._local.take():
            if packet := self._end.incoming(data, now, time.time_ns()):
                self._here.peer_heard(packet, now)

    def _send(self) -> None:
        """Send the packet that is due, if one is."""
        here = self._here
        state = State(self._ready, here.engaged, here.stop.stopped, here.stop.began, here.count)
        motion = endpoint.Motion(*self._motion[:3]) if self._motion else endpoint.Motion()
        data = self._end.outgoing(state, motion, time.monotonic(), time.time_ns())
        if data:
            self._local.send(data)

    def _send_force(self, motion: Motion, now: float) -> None:
        """Send the force that a sample of the arm causes, and show where the peer is."""
        stamp, position, velocity, work = motion
        force = self._end.force(position, velocity, now, work)
        self.forces[self._here.arms[0]].send(stamp, force)
        self._send_peer_position(stamp, self._end.set_point[0])

    def _play(self) -> float:
        """Play the tool's sample of each tick that has come; return the time of the next, s."""
        if self._ticks is None:
            return math.inf
        playout = self._endpoint.playout
        while (tick := self._ticks.due()) is not None:
            # Its own time: ticks that are served late, several in a row, keep the pace.
            now = self._ticks.time(tick) / NANOSECONDS
            if not self._endpoint.fresh(now, self.parameters.timeout):
                playout.clear()
                continue
            played = playout.take(now)
            if played.kind != WAITING:
                stamp = system_time(self._ticks.time(tick))
                self._send_tool(stamp, along_actuator(played.value))
        return self._ticks.next


def main() -> None:
    """Run the node."""
    run("half_coupler", HalfCoupler)


if __name__ == "__main__":
    main()

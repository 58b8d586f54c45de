# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `half_coupler`: this host's side of the coupling between two hosts.

It exchanges datagrams with this host's link, which exchanges them with the peer's link.
"""

from __future__ import annotations

import math
import time

from haptic_accel import Axes
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import SLAVE, ArmSample, CoupledForces
from haptic_accel.core.topics import TOOL_ACCELERATION
from haptic_accel.kits.link.datagrams import COUPLER, LocalEnd
from haptic_accel.kits.link.endpoint import random_session
from haptic_accel.kits.link.playout import PLAYED_KINDS
from haptic_accel.kits.link.two_hosts import ArmEndpoint, HalfCouplingPart, HalfEngagement
from haptic_accel.nodes import ARM_TOPICS, CouplingNode, MotionSynchronizer, Samples, run_nodes
from haptic_accel.nodes.timing import RateKeeper, system_time, wake_time

MOST_TOLD = 20
"""Maximum number of log lines about the peer, because other senders can cause such lines."""


class HalfCoupler(CouplingNode):
    """Node that couples this host's arm to the peer's arm.

    On the master's host the node publishes the tool's acceleration, one sample per tick of the
    sampling grid with the tick's stamp, as if the slave device were on this host.
    """

    def __init__(self) -> None:
        super().__init__()
        p = self.parameters
        axes = Axes.parsed(p.axes)
        end = ArmEndpoint(p.side, p, p.rate, p.latency, random_session(), axes)
        self.part: HalfCouplingPart = HalfCouplingPart(end, self._here, p.timeout)
        self._end, self._endpoint = end, end.endpoint
        self._local = LocalEnd(
            COUPLER, self.context.get_domain_id(), self.get_namespace().rstrip("/")
        )
        here = ARM_TOPICS[p.side]
        motion = here.position, here.velocity, here.work
        self._motions = MotionSynchronizer(*(self.samples(each, p.rate) for each in motion))
        self._told: set[str] = set()
        self._look_due = 0.0
        (there,) = set(ARM_TOPICS) - {p.side}
        self._send_peer_position = self.sender(ARM_TOPICS[there].position).send
        self._tools: Samples | None = None
        self._ticks: RateKeeper | None = None
        if p.side == SLAVE:
            self._tools = self.samples(TOOL_ACCELERATION, p.rate)
        else:
            self._send_tool = self.sender(TOOL_ACCELERATION).send
            self._ticks = RateKeeper(p.rate, lead=wake_time())

    def build_engagement(self, now: float) -> HalfEngagement:
        """Return the engagement of this host's arm."""
        self._here = HalfEngagement(self.parameters, now, self.parameters.side)
        return self._here

    def start_again(self) -> None:
        """Discard waiting samples."""
        self._motions.clear()

    def close(self) -> None:
        """Leave the arm without force, and release the path to the link."""
        super().close()
        self._local.close()

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return the peer's faults, missing inputs, and values of network and coupling law."""
        now, system = time.monotonic(), time.time_ns()
        half, playout = self._end.half, self._endpoint.playout
        values = {
            "engaged": str(half.engaged).lower(),
            **self._endpoint.diagnostics(system, now),
            "packets not taken by the link": str(self._local.dropped),
            "stiffness (N/m)": f"{half.stiffness:.1f}",
            "damping (N s/m)": f"{half.damping:.2f}",
            "energy tank (mJ)": f"{half.energy * 1e3:.3f}",
            "force limited by the energy tank (%)": f"{100 * half.limited:.1f}",
        }
        if self._ticks:
            played = sum(playout.counts[kind] for kind in PLAYED_KINDS)
            values["playout delay (ms)"] = f"{playout.delay * 1e3:.2f}"
            values["samples played"] = str(played)
            for kind in (*PLAYED_KINDS, "late"):
                share = 100 * playout.counts[kind] / played if played else 0.0
                values[f"samples {kind} (%)"] = f"{share:.3f}"
        problems = *self._endpoint.problems(system, now).values(), self._local.note
        return "; ".join(filter(None, (self.missing(), *problems))), values

    def work(self) -> float:
        """Exchange packets, publish due samples, and couple received samples."""
        self.receive(offset=0)
        if self._here.due(time.monotonic()):
            self.step()
        following = self._play()
        if time.monotonic() >= self._look_due:
            self._look_due = super().work()
        self.reply()
        return min(self._look_due, following)

    def receive(self, offset: int) -> None:
        """Receive the peer's packets."""
        self.part.offset = offset
        self.part.receive(self._local.drain(), time.monotonic(), time.time_ns())

    def reply(self) -> None:
        """Send any due packet to the peer."""
        if data := self.part.packet(time.monotonic(), time.time_ns()):
            self._local.send(data)

    def publish(self, tools: list[ArmSample], commands: list[CoupledForces], offset: int) -> None:
        """Publish played samples, and forces with the peer's position."""
        for tool in tools:
            self._send_tool(tool.stamp + offset, tool.acceleration)
        (force,) = self.forces.values()
        for caused in commands:  # equal for both arms, only one of which is on this host
            force.send(caused.m_stamp + offset, (caused.m_x, caused.m_y, caused.m_z))
            self._send_peer_position(caused.m_stamp + offset, self._end.set_point[0])

    def step(self) -> None:
        """Engage, release or end according to the state; log faults of the peer."""
        super().step()
        problems = self._endpoint.problems(time.time_ns(), time.monotonic())
        for kind, line in problems.items():
            if kind not in self._told and len(self._told) < MOST_TOLD:
                self._told.add(kind)
                self.get_logger().warning(line)

    def couple(self) -> bool:
        """Send forces for all complete samples; return True if no sample waits."""
        if self._tools:
            for stamp, acceleration in self._tools.drain():
                self.part.put_tool(ArmSample(stamp, acceleration=acceleration))
        came = False
        for motion in self._motions.drain():
            came = True
            self.part.put(motion, time.monotonic())
        self.publish([], self.part.forces, offset=0)
        self.part.forces.clear()
        return came and not self._motions.waiting

    def _play(self) -> float:
        """Publish the tool's sample of each due tick; return the time of the next tick, s."""
        if self._ticks is None:
            return math.inf
        while (tick := self._ticks.due()) is not None:
            # Use the nominal time of the tick, even if several ticks are served late.
            moment = self._ticks.time(tick)
            if played := self.part.begin(moment / NANOSECONDS, system_time(moment)):
                self.publish([played], [], offset=0)
        return self._ticks.next


def main() -> None:
    """Run the node."""
    run_nodes("half_coupler", HalfCoupler)


if __name__ == "__main__":
    main()

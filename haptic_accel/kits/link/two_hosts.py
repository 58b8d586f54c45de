# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling of two hosts: engagement, half and loop part of an arm; both hosts in lockstep.

The caller of a half exchanges datagrams with the peer's half. The order in a tick is: `receive`,
`begin`, `put` for each sample, `poll` if the engagement is due, `packet`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from haptic_accel import Axes, ChannelParameters, FloatArray, PassiveParameters, Vector
from haptic_accel.core import (
    ACTUATOR_AXES,
    MANUAL,
    NONSENSE,
    STOPPED,
    ZERO,
    Channel,
    Crossing,
    Decision,
    Engagement,
    EngagementParameters,
    PassiveHalf,
    of_slave,
    scaled,
    tick,
)
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ARMS
from haptic_accel.kits.link.endpoint import Endpoint, Motion, Packet, State
from haptic_accel.kits.link.playout import WAITING, Played

STOPPED_THERE = f"{STOPPED} at the peer"
"""Reason for a free arm while the peer is stopped and this host is not."""

SILENT = "waiting for the peer's packets"
"""Reason for a free arm while no packets arrive."""

RESTARTED = "the peer has restarted"
"""Reason for a release after the peer has restarted."""

LEFT = "the peer disengaged"
"""Reason for a release after the peer has disengaged."""

DIFFERENT = "the peer engaged at other reference positions"
"""Reason for a release after one host resumed the engagement and the other did not."""

RESUME_TIME = 2.0
"""Time after a loss of packets in which an engagement may be resumed, s. It includes `FREE_TIME`;
nobody expects an arm to return after a longer pause."""

LOST = "the peer was lost: engage again by coupler/engage"
"""Reason for a free arm that engages again only on request after the loss of the peer."""


class HalfEngagement(Engagement):
    """State machine of one arm that is coupled to a peer's arm: free or engaged.

    An arm is ready when its own conditions hold. It engages when the peer is ready or engaged. It
    is released when the peer sends no packets, restarts, or has another session or engagement. It
    engages again only after the peer has released its arm too, so that both start from the same
    state. After a short loss of packets both resume the engagement: they keep their reference
    positions, if both can. A stop that begins at the peer also stops this host, until released
    here. While the peer is stopped, the arm stays free.

    Parameters
    ----------
    parameters : EngagementParameters
    now : float
        Start time, s.
    arm : str
        Arm of this host.

    Attributes
    ----------
    count : int
        Number of engagements of the arm.
    resumes : bool
        True if the arm keeps its reference position: in this engagement or, if free, in the next
        one.
    unusable : str
        Reason why received packets are unusable; empty if none are received. Set by the caller.
    """

    def __init__(self, parameters: EngagementParameters, now: float, arm: str) -> None:
        super().__init__(parameters, now, (arm,))
        self.count = 0
        self.resumes = False
        self.unusable = ""
        self._peer: Packet | None = None
        self._heard = -math.inf
        self._session = 0
        self._partner: tuple[int, int] | None = None  # session and engagement of the peer
        self._former: tuple[int, int] | None = None
        self._resume_until = -math.inf

    def peer_heard(self, packet: Packet, now: float) -> None:
        """Handle the state in the peer's newest packet, which answers this host's session."""
        before, self._peer, self._heard = self._peer, packet, now
        known = before is not None and before.session == packet.session
        # A decreasing number is an error: an unnecessary stop is better than a missed one.
        if packet.stops != before.stops if before and known else packet.stopped:
            self.stop.follow()
        if self.engaged and self._partner is None and packet.engaged:
            self._partner = packet.session, packet.engagement

    def ready(self, now: float, listeners: int) -> bool:
        """Return True if this host receives the peer's packets and is ready to engage.

        See `missing` for the arguments.
        """
        return not (super().missing(now, listeners) or self._lost(now))

    def missing(self, now: float, listeners: int) -> str:
        """Return the reason that prevents engagement, or ends it; empty if there is none."""
        return super().missing(now, listeners) or self._missing_there(now)

    def decide(self, now: float, listeners: int) -> Decision:
        """Return the actions that are due; see `missing` for the arguments."""
        lost = self._lost(now)
        by_network = not super().missing(now, listeners) and self._resumable_after(now)
        decision = super().decide(now, listeners)
        if not self.engaged or decision.engage:
            known = self._peer is not None and self._peer.session == self._session
            self.resumes = known and now <= self._resume_until
        if decision.engage and self._peer:
            self.resumes = self.resumes and self._peer.resumes
            decision = replace(decision, resume=self.resumes)
            self.count += 1
            self._session = self._peer.session
            engaged = self._peer.engaged
            self._partner = (self._peer.session, self._peer.engagement) if engaged else None
        if decision.release:
            self._former = self._partner
            self.resumes = by_network and not self.stop.stopped
            self._resume_until = now + RESUME_TIME if self.resumes else -math.inf
            if lost and self._parameters.recovery == MANUAL:
                self._freed = LOST
        return decision

    def due(self, now: float) -> bool:
        """Return True if `decide` is due; immediately after the loss of the peer."""
        if super().due(now):
            return True
        return self.engaged and (self.stop.stopped or bool(self._missing_there(now)))

    def _lost(self, now: float) -> str:
        """Return the reason for the loss of the peer; empty if not lost."""
        if self._peer is None or now - self._heard > self._parameters.timeout:
            return self.unusable or SILENT
        return RESTARTED if self.engaged and self._peer.session != self._session else ""

    def _resumable_after(self, now: float) -> bool:
        """Return True if the reason at the peer is a loss of packets after both were engaged."""
        missing = self._missing_there(now)
        return (
            self._parameters.recovery != MANUAL
            and (self._partner is not None or self.resumes)
            and bool(missing)
            and missing not in (RESTARTED, STOPPED_THERE, DIFFERENT)
        )

    def _missing_there(self, now: float) -> str:
        """Return the reason why the peer is not ready."""
        lost, peer = self._lost(now), self._peer
        if lost or peer is None:
            return lost
        if peer.stopped:
            return STOPPED_THERE
        partner = (peer.session, peer.engagement)
        if self.engaged:
            there = peer.engaged and self._partner == partner
            if there and peer.resumes != self.resumes:
                return DIFFERENT
            return "" if there or (self._partner is None and peer.ready) else LEFT
        if peer.engaged and partner == self._former:
            return "waiting for the peer to disengage"
        return "" if peer.ready or peer.engaged else "waiting for the peer to be ready"


CATCH_UP = 0.05
"""Speed at which the arms approach each other after engagement, m/s: half that of a stroke. It is
reduced if the tank has little spare energy, so that following takes precedence."""

RISE_TIME = 0.1
"""Time in which stiffness and damping rise from zero after engagement, s: the force on an arm that
moves at 0.5 m/s increases by at most 15 mN per millisecond."""


class ArmEndpoint:
    """Half of the coupling at an arm, and the packets exchanged with the peer's half.

    All lengths in packets and in the half are relative to the reference position, in the master's
    scale. It is the position at engagement, or if the engagement is resumed, that of the previous
    one. A force is zero at engagement: from the arm's own position, the set-point approaches the
    peer's at `CATCH_UP`. Forces use this scale too, and energies are divided by its square.
    See `Endpoint` for the times.

    Parameters
    ----------
    side : str
        Arm of this host, one of `ARMS`.
    parameters : PassiveParameters
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples.
    session : int
        Random number of this run, not 0.
    axes : Axes
        Axes of the local tool.

    Attributes
    ----------
    half : PassiveHalf
    endpoint : Endpoint
    """

    def __init__(
        self,
        side: str,
        parameters: PassiveParameters,
        rate: float,
        latency: int,
        session: int,
        axes: Axes = ACTUATOR_AXES,
    ) -> None:
        leads = side == ARMS[1]
        self._scale = parameters.scale if leads else 1.0
        own = of_slave(parameters) if leads else parameters
        self.half = PassiveHalf(own, rate, latency, leads=leads)
        self.endpoint = Endpoint(side, rate, session, axes)
        self._origin = ZERO
        self._approach = CATCH_UP / rate  # m in a sample
        self._goal = ZERO
        self._ahead: Vector | None = None  # of the peer's position; None until it is engaged
        self._pair = 0, 0

    @property
    def engaged(self) -> bool:
        """True while the arm is coupled."""
        return self.half.engaged

    @property
    def set_point(self) -> tuple[Vector, Vector]:
        """Position, m, and velocity, m/s, of the peer's arm; zero while uncoupled."""
        peer = self.endpoint.peer
        return (peer.position, peer.velocity) if peer and peer.engaged else (ZERO, ZERO)

    def engage(self, position: Vector, *, resume: bool = False) -> None:
        """Couple the arm at a position, m, which is its reference position unless it resumes."""
        if not resume:
            self._origin = position
        self._goal, self._ahead = self._own(position, self._origin), None
        self.half.engage(RISE_TIME)

    def outgoing(self, state: State, motion: Motion, now: float, system: int) -> bytes | None:
        """Return the due packet, or None; a free arm is reported at rest.

        See `Endpoint.outgoing` for the parameters; the motion is the measured one.
        """
        stamp, position, velocity = motion
        crossing = Motion(stamp)
        if self.engaged:
            crossing = Motion(stamp, self._own(position, self._origin), self._own(velocity))
        return self.endpoint.outgoing(state, crossing, self.half.shipped, now, system)

    def incoming(self, data: bytes, now: float, system: int) -> Packet | None:
        """Process a datagram; return its packet if sent by the peer and newer than all before."""
        packet = self.endpoint.incoming(data, now, system)
        if packet is None:
            return None
        if self._pair != (pair := self.endpoint.session.pair):
            self._pair = pair
            self.half.new_session()
        self.half.receive(self.endpoint.shipped)
        return packet

    def force(
        self, position: Vector, velocity: Vector, now: float, work: float | None = None
    ) -> Vector:
        """Return the force for the arm, N; see `PassiveHalf.force`. Arguments are measurements."""
        own = self._own(position, self._origin)
        force = self.half.force(
            own,
            self._own(velocity),
            *self._follow(),
            self.endpoint.round_trip_age(now),
            None if work is None else work / self._scale**2,
        )
        if self._ahead is not None and self._ahead != ZERO and self.half.share < 1.0:
            # Keep the set-point where the energy suffices, so that the force does not jump when
            # more arrives.
            d_x, d_y, d_z = scaled(own, 1.0 - self.half.share, self._goal)
            a_x, a_y, a_z = self._ahead
            self._ahead = a_x + d_x, a_y + d_y, a_z + d_z
        return scaled(force, self._scale)

    def _follow(self) -> tuple[Vector, Vector]:
        """Return set-point, m, and its velocity, m/s, which approaches the peer's position."""
        peer = self.endpoint.peer
        if not (peer and peer.engaged and math.hypot(*peer.position) < NONSENSE):
            return self._goal, ZERO
        x, y, z = peer.position
        if self._ahead is None:
            self._ahead = scaled(self._goal, 1.0, peer.position)
        elif gap := math.hypot(*self._ahead):
            step = self.half.supply * self._approach
            self._ahead = scaled(self._ahead, max(0.0, 1.0 - step / gap))
        d_x, d_y, d_z = self._ahead
        self._goal = x + d_x, y + d_y, z + d_z
        return self._goal, peer.velocity

    def _own(self, vector: Vector, origin: Vector = ZERO) -> Vector:
        """Return a vector relative to an origin in the master's scale."""
        return scaled(vector, 1.0 / self._scale, origin)


class HalfCouplingPart(tick.ArmCoupling):
    """Engage an arm with its peer, compute its forces, and play the peer's samples.

    See `Endpoint` for the times.

    Parameters
    ----------
    end : ArmEndpoint
    engagement : HalfEngagement
        Engagement of the same arm.
    timeout : float
        Time without packets of the peer after which its last packet is ignored, s.

    Attributes
    ----------
    end : ArmEndpoint
    engagement : HalfEngagement
    offset : int
        System time minus the clock of the stamps, ns.
    played : Played
        Last played sample of the peer's tool.
    """

    engagement: HalfEngagement

    def __init__(self, end: ArmEndpoint, engagement: HalfEngagement, timeout: float) -> None:
        super().__init__(engagement)
        self.end = end
        self.passes_tools = False
        self.offset = 0
        self.played = Played(ZERO, WAITING)
        self._timeout = timeout
        self._newest: tick.ArmSample | None = None
        self._ready = False

    def receive(self, datagrams: Iterable[bytes], now: float, system: int) -> None:
        """Process received datagrams."""
        for data in datagrams:
            if packet := self.end.incoming(data, now, system):
                self.engagement.peer_heard(packet, now)
        self.engagement.unusable = self.end.endpoint.session.unusable(now, self._timeout)

    def begin(self, now: float, stamp: int) -> tick.ArmSample | None:
        """At the master, play the peer's sample of a tick; restart the playout after a silence."""
        if self.engagement.arms[0] != tick.MASTER:
            return None
        playout = self.end.endpoint.playout
        if not self.end.endpoint.fresh(now, self._timeout):
            playout.clear()
        self.played = playout.play(now)
        if self.played.kind == WAITING:
            return None
        return tick.ArmSample(stamp, acceleration=self.played.value)

    def put_tool(self, sample: tick.ArmSample) -> None:
        """Add a sample of the tool for the peer."""
        self.end.endpoint.sampled(sample.stamp + self.offset, sample.acceleration)

    def put(self, sample: tick.ArmSample, now: float) -> None:
        """Add a sample of the arm; a non-finite sample counts as missing."""
        arm = self.engagement.arms[0]
        usable = self.engagement.watches[arm].take(now, sample)
        if not (usable and math.isfinite(sum(sample.velocity))):
            return
        self._newest = sample
        if self.end.engaged and not self.engagement.interrupted:
            work = sum(sample.work) if sample.has_work else None
            x, y, z = self.end.force(sample.position, sample.velocity, now, work)
            forces = tick.CoupledForces()
            self.forces.append(forces)
            forces.on_master, forces.on_slave = arm == tick.MASTER, arm == tick.SLAVE
            forces.m_stamp = forces.s_stamp = sample.stamp
            forces.m_x, forces.m_y, forces.m_z = x, y, z
            forces.s_x, forces.s_y, forces.s_z = x, y, z

    def poll(self, now: float, listeners: int) -> Decision:
        """Engage or release the arm if this is due; see `Engagement.missing` for the arguments."""
        decision = self.engagement.decide(now, listeners)
        if decision.release:
            del self.forces[self.passed :]
            self.end.half.disengage()
        if decision.engage and self._newest:
            self.end.engage(self._newest.position, resume=decision.resume)
        self._ready = self.engagement.ready(now, listeners)
        return decision

    def packet(self, now: float, system: int) -> bytes | None:
        """Return the datagram that is due for the peer, or None."""
        here = self.engagement
        stop = here.stop
        state = State(
            self._ready, here.engaged, stop.stopped, here.resumes, stop.began, here.count
        )
        motion = Motion()
        if newest := self._newest:
            motion = Motion(newest.stamp + self.offset, newest.position, newest.velocity)
        return self.end.outgoing(state, motion, now, system)


BEGIN = 1_800_000_000
"""System time of both hosts at the first sample, s."""

ROUNDING = 1e-9
"""Time by which a packet may arrive early, s, as sums of times are not exact."""


PlayedSample = tuple[Played, float, tuple[float, float]]
"""Sample played at the master, its time in samples, and the energy in both tanks, J."""


class TwoHosts:
    """Loops of both hosts, and their packets over a simulated network.

    The order within a sample is that of the live hosts: a packet is sent after the sample's force
    is known, and arrives with the next sample at the earliest.

    Parameters
    ----------
    parameters : PassiveParameters
    network : ChannelParameters
        Channels of both directions.
    sides : mapping of str to DeviceSide
        Devices of both arms.
    compensation : CompensationPart, optional
        Compensation on the master's host.
    seed : int
        Seed of the network.
    blackouts : sequence of (float, float)
        Start and end of each blackout, s; packets sent during it are lost.
    axes : Axes
        Axes of the tool.

    Attributes
    ----------
    loops : dict of HostLoop
        Loops of master and slave.
    couplings : dict of HalfCouplingPart
    channels : list of Channel
        Channels from the master, and from the slave.
    record : list of PlayedSample
        Sample played at the master in each tick.
    """

    def __init__(
        self,
        parameters: PassiveParameters,
        network: ChannelParameters,
        sides: Mapping[str, tick.DeviceSide],
        compensation: tick.CompensationPart | None = None,
        seed: int = 0,
        blackouts: Sequence[tuple[float, float]] = (),
        axes: Axes = ACTUATOR_AXES,
    ) -> None:
        self._axes = axes
        self._parameters, self._sides, self._compensation = parameters, sides, compensation
        self._rate = sides[tick.MASTER].rate
        self._first = round(BEGIN * self._rate)
        self._sessions = itertools.count(1)
        self.record: list[PlayedSample] = []
        self.couplings: dict[str, HalfCouplingPart] = {}
        self.loops: dict[str, tick.HostLoop] = {}
        for arm in ARMS:
            self.restart(arm, 0.0)
        self.channels = [
            Channel[bytes](network, number, blackouts)
            for number in np.random.SeedSequence(seed).generate_state(2).tolist()
        ]

    def restart(self, arm: str, now: float) -> None:
        """Start or restart the host of an arm at a time in s."""
        side, conditions = self._sides[arm], EngagementParameters()
        session = next(self._sessions)
        end = ArmEndpoint(arm, self._parameters, side.rate, side.latency, session, self._axes)
        half = HalfCouplingPart(end, HalfEngagement(conditions, now, arm), conditions.timeout)
        half.offset = BEGIN * NANOSECONDS
        self.couplings[arm] = half
        compensation = self._compensation if arm == tick.MASTER else None
        self.loops[arm] = tick.HostLoop({arm: side}, half, compensation)

    def step(self, number: int) -> None:
        """Process a tick on both hosts."""
        time = number / self._rate
        system = BEGIN * NANOSECONDS + round(time * NANOSECONDS)
        for half, channel in zip(self.couplings.values(), reversed(self.channels), strict=True):
            half.receive(channel.arrived(time + ROUNDING), time, system)
        for arm, loop in self.loops.items():
            # A device stops together with its coupler.
            stopped = self.couplings[arm].engagement.stop.stopped
            self.couplings[arm].engagement.arm_stopped(arm, stopped)
            loop.step(number)
        for half, channel in zip(self.couplings.values(), self.channels, strict=True):
            if packet := half.packet(time, system):
                channel.send(packet, time)
        master, slave = self.couplings.values()
        # NaN while waiting.
        position = master.end.endpoint.playout.position - self._first
        energy = master.end.half.energy, slave.end.half.energy
        self.record.append((master.played, position, energy))

    def crossing(self, tool: FloatArray, axes: Axes) -> tuple[Crossing, FloatArray]:
        """Return the network's signals, and the tool's acceleration at the played times.

        Parameters
        ----------
        tool : ndarray, shape (n,) or (n, axes)
            Acceleration measured by the tool in each tick, m/s^2.
        axes : Axes
            Axes of the handle.
        """
        samples, positions, energies = zip(*self.record, strict=True)
        ticks, count = np.array(positions), np.arange(len(tool))
        played = axes.signals(np.array([each.value for each in samples]))
        kinds = tuple(each.kind for each in samples)
        followed = np.apply_along_axis(
            lambda component: np.interp(np.nan_to_num(ticks), count, component), 0, tool
        )
        # While waiting, the played and the desired acceleration are zero.
        desired = np.where(np.isnan(ticks), played.T, followed.T).T
        return Crossing(played, (count - ticks) / self._rate, kinds, np.array(energies)), desired

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Two hosts in lockstep: their loops, and a simulated network between them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from haptic_accel.core.arm_endpoint import ArmEndpoint
from haptic_accel.core.axes import ACTUATOR_AXES, Axes
from haptic_accel.core.coupling.engagement import EngagementParameters
from haptic_accel.core.coupling.half_engagement import HalfEngagement
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.loop.compensation import CompensationPart
from haptic_accel.core.loop.device_side import DeviceSide
from haptic_accel.core.loop.half_coupling import HalfCouplingPart
from haptic_accel.core.loop.wiring import MASTER, HostLoop
from haptic_accel.core.network.channel import Channel, ChannelParameters
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ARMS

BEGIN = 1_800_000_000
"""System time of both hosts at the first sample, s."""

ROUNDING = 1e-9
"""Time by which a packet may be early, s, as sums of times are not exact."""


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
        Start and end of each blackout, s, in which no packet arrives.
    axes : Axes
        Axes of the tool.

    Attributes
    ----------
    loops : dict of HostLoop
        Loops of master and slave.
    halves : dict of HalfCouplingPart
    channels : list of Channel
        Channels from the master, and from the slave.
    """

    def __init__(
        self,
        parameters: PassiveParameters,
        network: ChannelParameters,
        sides: Mapping[str, DeviceSide],
        compensation: CompensationPart | None = None,
        seed: int = 0,
        blackouts: Sequence[tuple[float, float]] = (),
        axes: Axes = ACTUATOR_AXES,
    ) -> None:
        self._axes = axes
        self._parameters, self._sides, self._compensation = parameters, sides, compensation
        self._rate = sides[MASTER].rate
        self._first = round(BEGIN * self._rate)
        self._sessions = itertools.count(1)
        self.halves: dict[str, HalfCouplingPart] = {}
        self.loops: dict[str, HostLoop] = {}
        for arm in ARMS:
            self.restart(arm, 0.0)
        self.channels = [
            Channel[bytes](network, number, blackouts)
            for number in np.random.SeedSequence(seed).generate_state(2).tolist()
        ]

    @property
    def position(self) -> float:
        """Time of the played sample, in samples since the first; NaN while waiting."""
        return self.halves[MASTER].end.endpoint.playout.position - self._first

    @property
    def energy(self) -> tuple[float, float]:
        """Energy in the tanks of master and slave, J."""
        master, slave = (half.end.half.energy for half in self.halves.values())
        return master, slave

    def restart(self, arm: str, now: float) -> None:
        """Start or restart the host of an arm at a time in s."""
        side, conditions = self._sides[arm], EngagementParameters()
        session = next(self._sessions)
        end = ArmEndpoint(arm, self._parameters, side.rate, side.latency, session, self._axes)
        half = HalfCouplingPart(end, HalfEngagement(conditions, now, arm), conditions.timeout)
        half.offset = BEGIN * NANOSECONDS
        self.halves[arm] = half
        compensation = self._compensation if arm == MASTER else None
        self.loops[arm] = HostLoop({arm: side}, half, compensation)

    def step(self, tick: int) -> None:
        """Process a tick on both hosts."""
        time = tick / self._rate
        system = BEGIN * NANOSECONDS + round(time * NANOSECONDS)
        for half, channel in zip(self.halves.values(), reversed(self.channels), strict=True):
            half.receive(channel.arrived(time + ROUNDING), time, system)
        for arm, loop in self.loops.items():
            # A device stops with its coupler.
            stopped = self.halves[arm].engagement.stop.stopped
            self.halves[arm].engagement.arm_stopped(arm, stopped)
            loop.step(tick)
        for half, channel in zip(self.halves.values(), self.channels, strict=True):
            if packet := half.packet(time, system):
                channel.send(packet, time)

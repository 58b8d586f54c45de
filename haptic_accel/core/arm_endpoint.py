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

"""Endpoint of a network coupling at one arm: a half of the coupling, and packets."""

from __future__ import annotations

import math

from haptic_accel.core.axes import ACTUATOR_AXES, Axes
from haptic_accel.core.coupling.passive import (
    NONSENSE,
    PassiveHalf,
    PassiveParameters,
    of_slave,
    scaled,
)
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network.endpoint import Endpoint, Motion, State
from haptic_accel.core.network.packet import Packet
from haptic_accel.core.topics import ARMS

CATCH_UP = 0.05
"""Speed at which the arms approach each other after engagement, m/s: half that of a stroke. It
falls with the energy that the tank has to spare, so that following takes precedence."""

RISE_TIME = 0.1
"""Time in which stiffness and damping rise from zero after engagement, s: an arm that moves at 0.5
m/s feels at most 15 mN more in each millisecond."""


class ArmEndpoint:
    """Half of the coupling at an arm, and the packets exchanged with the peer's half.

    All lengths in packets and in the half are relative to the reference position, in the master's
    scale. It is the position at engagement, or if the engagement is resumed, that of the previous
    one. A force is zero at engagement: from the arm's own position, the set-point approaches the
    peer's at `CATCH_UP`. Forces use this scale too, and energies are divided by its square.
    Times as for `Endpoint`.

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

        Parameters as for `Endpoint.outgoing`, with the measured motion.
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
            # Wait where the energy suffices, so that the force does not jump when more arrives.
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

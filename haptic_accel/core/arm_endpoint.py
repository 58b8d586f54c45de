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

from haptic_accel.core.coupling.passive import PassiveHalf, PassiveParameters, of_slave, scaled
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network.endpoint import Endpoint, Motion, State
from haptic_accel.core.network.packet import Packet
from haptic_accel.core.topics import ARMS


class ArmEndpoint:
    """Half of the coupling at an arm, and the packets exchanged with the peer's half.

    All lengths in packets and in the half are relative to the position at engagement, in the
    master's scale. Forces use this scale too, and energies are divided by its square. Times as for
    `Endpoint`.

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

    Attributes
    ----------
    half : PassiveHalf
    endpoint : Endpoint
    """

    def __init__(
        self, side: str, parameters: PassiveParameters, rate: float, latency: int, session: int
    ) -> None:
        leads = side == ARMS[1]
        self._scale = parameters.scale if leads else 1.0
        own = of_slave(parameters) if leads else parameters
        self.half = PassiveHalf(own, rate, latency, leads=leads)
        self.endpoint = Endpoint(side, rate, session)
        self._origin = ZERO
        self._pair = 0, 0

    @property
    def engaged(self) -> bool:
        """True while the arm is coupled."""
        return self.half.engaged

    @property
    def set_point(self) -> tuple[Vector, Vector]:
        """Position, m, and velocity, m/s, of the peer's arm; zero while free."""
        peer = self.endpoint.peer
        return (peer.position, peer.velocity) if peer and peer.engaged else (ZERO, ZERO)

    def engage(self, position: Vector) -> None:
        """Couple the arm at a position, m."""
        self._origin = position
        self.half.engage()

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
        force = self.half.force(
            self._own(position, self._origin),
            self._own(velocity),
            *self.set_point,
            self.endpoint.round_trip_age(now),
            None if work is None else work / self._scale**2,
        )
        return scaled(force, self._scale)

    def _own(self, vector: Vector, origin: Vector = ZERO) -> Vector:
        """Return a vector relative to an origin in the master's scale."""
        return scaled(vector, 1.0 / self._scale, origin)

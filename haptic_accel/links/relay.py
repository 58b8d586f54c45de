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
"""Relay of datagrams between two hosts, with the delay, jitter and loss of a simulated network."""

from __future__ import annotations

import math
import socket
from contextlib import suppress
from dataclasses import replace

from haptic_accel.core.network.channel import Channel, ChannelParameters
from haptic_accel.links.addresses import Route, bound

RISE = 1.0
"""Pace at which a longer delay is reached, s/s. At once, it would be a silence of the same length,
in which arms let go from 0.08 s on; at this pace datagrams come at half their rate."""

LONGEST_DATAGRAM = 65535
"""Maximum length of a datagram, bytes: the relay does not read what it carries."""


class Relay:
    """Two UDP ports, one toward each host, with a simulated network between them.

    The relay takes the place of the peer for both hosts, and passes on datagrams as they are: it
    needs no keys. It has no clock: the caller passes times in s, which never decrease.

    Parameters
    ----------
    routes : tuple of Route
        Routes from the relay to the master's and to the slave's host.
    network : ChannelParameters
        Behaviour of each direction.
    seed : int
        Seed of jitter and loss.

    Attributes
    ----------
    sockets : tuple of socket
        Sockets to wait for.

    Raises
    ------
    ParameterError
        A port is in use.
    """

    def __init__(
        self, routes: tuple[Route, Route], network: ChannelParameters, seed: int = 0
    ) -> None:
        self.sockets = tuple(_connected(each) for each in routes)
        self._channels = tuple(Channel[bytes](network, 2 * seed + end) for end in range(2))
        self._network, self._stepped = network, math.inf

    @property
    def network(self) -> ChannelParameters:
        """Behaviour of each direction; the delay increases at the rate `RISE`.

        Datagrams already in transit keep their delay.
        """
        return self._network

    @network.setter
    def network(self, network: ChannelParameters) -> None:
        self._network = network
        self._approach(0.0)

    @property
    def due(self) -> float:
        """Time of the next arrival, s; infinite if no datagram is in transit."""
        return min(channel.next_arrival for channel in self._channels)

    def step(self, now: float) -> None:
        """Take in the datagrams of both hosts, and deliver those that have arrived."""
        if self._channels[0].parameters is not self._network:
            self._approach(now - self._stepped)
        self._stepped = now
        for end, channel in enumerate(self._channels):
            for datagram in _received(self.sockets[end]):
                channel.send(datagram, now)
            for datagram in channel.arrived(now):
                with suppress(OSError):  # no room, or the host does not receive yet
                    self.sockets[1 - end].send(datagram)

    def _approach(self, seconds: float) -> None:
        """Give both directions the network, with a delay that has grown for a time in s."""
        network = self._network
        longest = self._channels[0].parameters.delay + RISE * max(0.0, seconds)
        if network.delay > longest:
            network = replace(network, delay=longest)
        for channel in self._channels:
            channel.parameters = network

    def close(self) -> None:
        """Release the ports; datagrams in transit are lost."""
        for each in self.sockets:
            each.close()


def _connected(route: Route) -> socket.socket:
    """Return a socket on the route's own port that receives from its peer only."""
    opened = bound(route.own, route.own_port)
    opened.setblocking(False)
    found = socket.getaddrinfo(route.peer, route.peer_port, opened.family, socket.SOCK_DGRAM)
    opened.connect(found[0][4])
    return opened


def _received(connected: socket.socket) -> list[bytes]:
    """Return the datagrams that wait in a socket."""
    found: list[bytes] = []
    while True:
        try:
            found.append(connected.recv(LONGEST_DATAGRAM))
        except BlockingIOError:
            return found
        except ConnectionError:  # an earlier datagram found no receiver
            continue

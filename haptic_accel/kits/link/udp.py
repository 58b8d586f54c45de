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

"""UDP datagrams between two hosts, each with a tag that is checked first."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from haptic_accel.kits.link.authentication import TAG_LENGTH, Authenticator
from haptic_accel.kits.link.local import LONGEST_DATAGRAM
from haptic_accel.links.addresses import Route, bound

END_CHECK_PERIOD = 0.25
"""Interval of checks for the end while nothing is received, s."""

BURST, BURST_TIME, BREAK = 500, 0.1, 1e-3
"""Number of datagrams and time, s, that exceed any traffic between two hosts, and the pause that
follows, s. A flooded port must not use up the processor."""


class UdpCarrier:
    """Transport of datagrams on one UDP port of this host; unknown senders get no answer.

    Parameters
    ----------
    route : Route
    authenticator : Authenticator
    refused : callable
        Called with the sender's address of a datagram with an invalid tag.

    Raises
    ------
    ParameterError
        The port is in use.
    """

    def __init__(
        self, route: Route, authenticator: Authenticator, refused: Callable[[str], None]
    ) -> None:
        self._authenticator, self._refused = authenticator, refused
        self._socket = bound(route.own, route.own_port)
        # Closing a socket does not wake threads that wait for it.
        pause = struct.pack("ll", 0, round(END_CHECK_PERIOD * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, pause)
        family = self._socket.family
        found = socket.getaddrinfo(route.peer, route.peer_port, family, socket.SOCK_DGRAM)
        self._peer = found[0][4]
        self._over = threading.Event()

    def send(self, datagram: bytes) -> None:
        """Send a datagram; discard it without a route or room."""
        with suppress(OSError):
            self._socket.sendto(
                self._authenticator.tagged(datagram), socket.MSG_DONTWAIT, self._peer
            )

    def run(self, deliver: Callable[[bytes], object]) -> None:
        """Pass the peer's datagrams on until `close` is called."""
        receive, verified = self._socket.recvfrom, self._authenticator.verified
        count, since = 0, time.monotonic()
        while not self._over.is_set():
            try:
                data, sender = receive(LONGEST_DATAGRAM + TAG_LENGTH + 1)
            except BlockingIOError:
                continue
            datagram = verified(data)
            if datagram is None:
                self._refused(sender[0])
            elif len(datagram) <= LONGEST_DATAGRAM:
                deliver(datagram)
            count += 1
            if count % BURST == 0:
                if time.monotonic() - since < BURST_TIME:
                    time.sleep(BREAK)
                since = time.monotonic()
        self._socket.close()

    def close(self) -> None:
        """End receiving."""
        self._over.set()

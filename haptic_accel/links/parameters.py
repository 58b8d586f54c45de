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

"""Parameters of the link to the peer host."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.topics import ARMS
from haptic_accel.links.addresses import host_and_port, is_loopback

UDP, ZENOH = TRANSPORTS = ("udp", "zenoh")
"""Transports of datagrams between hosts."""

AUTHORITY, CERTIFICATE, KEY = "ca.pem", "cert.pem", "key.pem"
"""Files of a host: certificate of the authority, own certificate, and private key."""


@dataclass(frozen=True)
class LinkNodeParameters(Checked):
    """Parameters of the node `link`."""

    side: str = parameter("master", "arm of this host", choices=ARMS)
    peer: str = parameter("", "peer host as HOST or HOST:PORT; empty for no link")
    transport: str = parameter(UDP, "transport of datagrams to the peer host", choices=TRANSPORTS)
    keys: str = parameter("", "folder with this host's keys, made by 'haptic-accel keys'")
    insecure: bool = parameter(
        False, "link hosts without keys: anybody with access to the port can then move the arm"
    )

    def __post_init__(self) -> None:
        """Check all fields, the form of the peer's address, and authentication."""
        super().__post_init__()
        if self.peer:
            check_peer(self.peer, self.transport, self.keys, insecure=self.insecure)


def check_peer(peer: str, transport: str, keys: str, *, insecure: bool) -> None:
    """Reject a peer with an invalid address, or without authentication.

    Raises
    ------
    ParameterError
        The message names the parameter and the allowed values.
    """
    host, _ = host_and_port(peer)
    if insecure and (keys or transport != UDP):
        given = f"keys:={keys}" if keys else f"transport:={transport}"
        raise ParameterError(f"insecure = True: must not come with {given}")
    if not (keys or insecure or (transport == UDP and is_loopback(host))):
        raise ParameterError(
            f"keys = '': must be the folder of this host's keys, as peer {host} is another host;"
            " run haptic-accel keys to make it"
        )

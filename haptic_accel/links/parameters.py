# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the link to the peer host."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.topics import ARMS
from haptic_accel.links.addresses import host_and_port

TRANSPORTS = ("dds", "zenoh")
"""Transports of datagrams between hosts."""

AUTHORITY, CERTIFICATE, KEY = "ca.pem", "cert.pem", "key.pem"
"""Files of a host: certificate of the authority, its own certificate, and its private key."""


@dataclass(frozen=True)
class LinkNodeParameters(Checked):
    """Parameters of the node `link`."""

    side: str = parameter("master", "arm that this host has", choices=ARMS)
    peer: str = parameter("", "peer host as HOST or HOST:PORT; empty for no link")
    transport: str = parameter(
        "dds", "transport of datagrams to the peer host", choices=TRANSPORTS
    )
    keys: str = parameter("", "folder with this host's certificates, for transport zenoh")

    def __post_init__(self) -> None:
        """Check all fields, and the form of the peer's address."""
        super().__post_init__()
        if self.peer:
            host_and_port(self.peer)

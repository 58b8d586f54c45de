# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Addresses and ports of the link between two hosts."""

from __future__ import annotations

import errno
import hashlib
import os
import socket
from dataclasses import dataclass
from typing import Any

from haptic_accel import ParameterError
from haptic_accel.core import host_and_port

DATAGRAMS = socket.SOCK_DGRAM

FIRST_PORTS = {"udp": 7300, "zenoh": 7447}
"""First port of the root namespace by transport: for udp below 7400, where the ports of ROS domain
0 begin; for zenoh Zenoh's default."""

SLOTS = 50
"""Number of namespaces with separate ports, including the root; more may collide."""

PORTS_EACH = {"udp": 2, "zenoh": 1}
"""Number of ports for a pair of hosts. udp: one per host, the master's first; zenoh: the slave's
only."""


@dataclass(frozen=True)
class Route:
    """Addresses and ports of the two hosts.

    Attributes
    ----------
    host : str
        Peer as specified.
    own, peer : str
        Numeric addresses of this host, on the path to the peer, and of the peer.
    own_port, peer_port : int
        UDP ports on which this host and the peer receive; for zenoh both are the slave's.
    """

    host: str
    own: str
    peer: str
    own_port: int
    peer_port: int


def route(peer: str, side: str, transport: str, namespace: str) -> Route:
    """Find the route to the peer; ports depend on transport, side and namespace only.

    Parameters
    ----------
    peer : str
        As for `host_and_port`; its port replaces the pair's first port.
    side, transport : str
        Side of this host, from `ARMS` and `TRANSPORTS`.
    namespace : str
        Namespace, starting with a slash; empty for the root.

    Raises
    ------
    ParameterError
        The peer has another form.
    OSError
        The host does not exist or is unreachable; the message is one line.
    """
    host, port = host_and_port(peer)
    each = PORTS_EACH[transport]
    first = port or FIRST_PORTS[transport] + each * _slot(namespace)
    ports = (first, first + each - 1)
    own, other = ports if side == "master" else ports[::-1]
    return Route(host, *_addresses(host, other, sort=transport == "udp"), own, other)


def bound(address: str, port: int) -> socket.socket:
    """Return a UDP socket bound to a port of this host.

    Raises
    ------
    ParameterError
        The port is used by another program, or not permitted for this user.
    """
    opened = socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET, DATAGRAMS)
    try:
        opened.bind(socket.getaddrinfo(address, port, opened.family, DATAGRAMS)[0][4])
    except OSError as error:
        opened.close()
        if error.errno not in (errno.EADDRINUSE, errno.EACCES):
            raise
        raise ParameterError(
            f"port {port}/udp of {address}: {os.strerror(error.errno).lower()}; is it another"
            " graph's link? give both hosts another, peer:=HOST:PORT"
        ) from None
    return opened


def _slot(namespace: str) -> int:
    """Return the index of a namespace's ports: 0 for the root."""
    digest = hashlib.sha256(namespace.encode()).digest()
    return 1 + int.from_bytes(digest[:8], "big") % (SLOTS - 1) if namespace else 0


def _addresses(host: str, port: int, *, sort: bool) -> tuple[str, str]:
    """Return this host's numeric address, on the path to the peer, and the peer's.

    With `sort`, an IPv4 address comes first if one exists: both hosts must choose the same.
    """
    try:
        found = socket.getaddrinfo(host, port, type=DATAGRAMS)
        if sort:
            found.sort(key=lambda each: each[0] != socket.AF_INET)
        kind, _, _, _, there = found[0]
        with socket.socket(kind, DATAGRAMS) as asking:
            asking.connect(there)  # determines the route; sends nothing
            return _numeric(asking.getsockname()), _numeric(there)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ConnectionError(f"peer {host}: cannot be reached: {reason}") from None


def _numeric(address: Any) -> str:
    """Return a socket's address, with the interface if link-local."""
    return socket.getnameinfo(address, socket.NI_NUMERICHOST | socket.NI_NUMERICSERV)[0]

"""Parameters of the link to the peer host."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, ParameterError, parameter, shown

HIGHEST_PORT = 65535
"""Highest port of UDP."""

SIDES = ("master", "slave")
"""The two hosts of a pair, by the arm that each has."""

TRANSPORTS = ("dds", "zenoh")
"""What carries datagrams between hosts."""


def host_and_port(peer: str) -> tuple[str, int]:
    """Return host and port of a peer; port 0 where it names none.

    Parameters
    ----------
    peer : str
        HOST, HOST:PORT, or with an address of IPv6 [HOST]:PORT.

    Raises
    ------
    ParameterError
        It has another form.
    """
    host, colon, port = peer.rpartition(":")
    if not colon or (":" in host and not host.endswith("]")):
        host, colon, port = peer, "", "0"
    number = int(port) if port.isascii() and port.isdigit() else -1
    host = host.removeprefix("[").removesuffix("]")
    allowed = host and host.isascii() and host.isprintable() and not set(host) & set(" /[]?#,;")
    if not allowed or number not in range(HIGHEST_PORT + 1) or (colon and not number):
        raise ParameterError(
            f"peer = {shown(repr(peer))}: must be HOST or HOST:PORT, with a port from 1 to"
            f" {HIGHEST_PORT}"
        )
    return host, number


@dataclass(frozen=True)
class LinkNodeParameters(Checked):
    """Parameters of the node `link`."""

    side: str = parameter("master", "arm that this host has", choices=SIDES)
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

"""Who may look, and who may act: host names, origins and the token."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from urllib.parse import urlsplit

TOKEN_BYTES = 18
"""Of randomness in a token that is made: 24 letters."""

TOKEN_VARIABLE = "HAPTIC_ACCEL_SCOPE_TOKEN"
"""Environment variable with a token to use. Not an argument, nor a parameter: those are seen by
every user of the machine and of the graph, and are kept in bags."""

LOCALHOST = "localhost"


class Access:
    """Decides by what a request says of itself; what it does not decide is refused.

    Parameters
    ----------
    host : str
        Address that the server listens on.
    token : str
        To be known by everyone who asks; empty for one that is made where the address can be
        reached from other machines, and none where it cannot.
    """

    def __init__(self, host: str, token: str = "") -> None:
        self.local = is_loopback(host)
        self.token = token or ("" if self.local else secrets.token_urlsafe(TOKEN_BYTES))

    def admits_host(self, header: str | None) -> bool:
        """Whether a Host header names this machine.

        A page of elsewhere can have its own name point here (DNS rebinding), and its requests
        then come from the user's browser; but they still carry its name. Any port is right: the
        way here may be a tunnel.
        """
        name = _name(header)
        if name is None:
            return False
        if name == LOCALHOST or is_loopback(name):
            return True
        return not self.local and (_is_address(name) or name in _own_names())

    def admits_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a request comes from our own page: its origin is where it was sent to.

        Browsers say the origin of every WebSocket and of every POST; who says none is refused.
        """
        return bool(host) and origin in (f"http://{host}", f"https://{host}")

    def admits_token(self, token: str | None) -> bool:
        """Whether a token is ours, taking the same time for any wrong one."""
        if not self.token:
            return True
        return hmac.compare_digest((token or "").encode(), self.token.encode())


def is_loopback(host: str) -> bool:
    """Whether an address can be reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == LOCALHOST


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _own_names() -> set[str]:
    name = socket.gethostname().lower()
    return {name, f"{name}.local", socket.getfqdn().lower()}


def _name(header: str | None) -> str | None:
    """Return the name in a Host header, without its port."""
    try:
        found = urlsplit(f"//{header or ''}")
        port_is_one = found.port is None or found.port > 0
    except ValueError:
        return None
    plain = found.path == found.query == found.fragment == "" and "@" not in found.netloc
    return found.hostname if plain and port_is_one else None

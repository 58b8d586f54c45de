# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Access control of the scope's page: host names, origins and the token."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
from urllib.parse import urlsplit

from haptic_accel.core.parameters import ParameterError

TOKEN_BYTES = 18
"""Number of random bytes of a generated token, which has 24 letters."""

TOKEN_VARIABLE = "HAPTIC_ACCEL_SCOPE_TOKEN"
"""Environment variable with the token to use. Other users could see an argument or a parameter,
and bags would store it."""

TOKEN_LETTERS = "ASCII letters, digits and - . _ ~"
"""Letters of a token, unchanged in addresses, cookies and headers (RFC 3986)."""

LOCALHOST = "localhost"

LOCAL_HOST = "127.0.0.1"
"""Address of a page that is reachable from this machine only."""


class Access:
    """Rules for requests; all other requests are refused.

    Parameters
    ----------
    host : str
        Address that the server listens on.
    token : str
        Token that every request must carry. If empty, a token is generated if other machines can
        reach the address; otherwise none is needed.

    Raises
    ------
    ParameterError
        The token has letters not allowed in a URL.
    """

    def __init__(self, host: str, token: str = "") -> None:
        if token and not is_token(token):
            # The message must not contain the value, which is a secret.
            raise ParameterError(f"{TOKEN_VARIABLE}: must consist of {TOKEN_LETTERS}")
        self.local = is_loopback(host)
        self.token = token or ("" if self.local else secrets.token_urlsafe(TOKEN_BYTES))

    def admits_host(self, header: str | None) -> bool:
        """Return true if a Host header names this machine.

        By DNS rebinding, a foreign page's host name can lead to this machine, but requests from
        the user's browser still carry that name. Any port is allowed, as requests may come through
        a tunnel.
        """
        name = _name(header)
        if name is None:
            return False
        if name == LOCALHOST or is_loopback(name):
            return True
        return not self.local and (_address(name) is not None or name in _own_names())

    def admits_origin(self, origin: str | None, host: str | None) -> bool:
        """Return true if a request comes from the scope's page: origin and host agree.

        Browsers send the origin of every WebSocket and POST; a request without origin is refused.
        """
        return bool(host) and origin in (f"http://{host}", f"https://{host}")

    def admits_token(self, token: str | None) -> bool:
        """Return true for the right token; any wrong token takes the same time."""
        if not self.token:
            return True
        return hmac.compare_digest((token or "").encode(errors="replace"), self.token.encode())


def is_token(text: str) -> bool:
    """Return true if a text can be a token."""
    return re.fullmatch(r"[\w.~-]+", text, re.ASCII) is not None


def is_loopback(host: str) -> bool:
    """Return true if an address can be reached from this machine only."""
    address = _address(host)
    return address.is_loopback if address else host.lower() == LOCALHOST


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return a name as an IP address, or None."""
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


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

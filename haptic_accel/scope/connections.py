# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Connections of a page's server, separated into strangers' and those with access to the page.

Access depends on host names, origins and the token.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import math
import os
import re
import secrets
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from aiohttp import web

from haptic_accel.core.network import is_loopback
from haptic_accel.core.parameters import ParameterError

TOKEN_BYTES = 18
"""Number of random bytes of a generated token, which has 24 letters."""

TOKEN_VARIABLE = "HAPTIC_ACCEL_SCOPE_TOKEN"
"""Environment variable with the token to use. Other users could see an argument or a parameter,
and bags would store it."""

TOKEN_LETTERS = "ASCII letters, digits and - . _ ~"
"""Letters of a token, unchanged in addresses, cookies and headers (RFC 3986)."""

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
        if is_loopback(name):
            return True
        return not self.local and (_is_address(name) or name in _own_names())

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


def _is_address(name: str) -> bool:
    """Return true if a name is an IP address."""
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


MOST_CONNECTIONS = 256
"""Maximum number of simultaneous connections of strangers, and likewise of those with access but
without an open page. Both are far below a process's usual limit of 1024 open files, and far above
the 64 of `server.MOST_CLIENTS` browsers, which open up to seven each."""

STRANGER_TIME, TURNS = 1.0, 50
"""Longest time that a connection may lack a complete request, s: a browser's request has one or
two packets, and a packet that is lost once comes 0.2 s later. Number of parts in which the time is
counted: all received data are read between two parts, and a stall of the server, however long,
counts as one part."""

BUSY, BREAK = 0.6, 0.01
"""Fraction of a core above which a thread rests, and length of the rest, s. The kernel suspends
real-time processes that use a whole core, together with those that compute forces on that core
(sched(7), sched_rt_runtime_us)."""

LONGEST_HEADER = 2**14
"""Maximum number of bytes stored of a stranger's request: twice aiohttp's limit for a header
field."""

QUEUE = 4096
"""Number of connections that the system queues until they are accepted, its default limit. With a
shorter queue, a flood of connections would delay others by a second, until their next attempt."""

ACCEPTED_AT_ONCE = 32
"""Number of connections accepted before all others are served again. A request with access is read
four turns later, thus before `MOST_CONNECTIONS` others arrive."""


OTHERS_AT_ONCE = 2
"""Number of first requests, other than stops, passed on per turn: each costs as much as ten
accepted connections."""

COMMAND = b"POST /command "
"""Start of a request whose body is awaited."""

STOP = {"action": "estop", "value": True}
"""Command that is passed on before all other requests."""

LENGTH_OF_BODY = re.compile(rb"\r\ncontent-length: *(\d{1,5}) *(?:\r\n|$)", re.IGNORECASE)
"""Pattern of the length field of a header (RFC 9110, 8.6)."""

Pass = Callable[[], None]


class Connections:
    """Connections of a server, in which strangers cannot use up the resources of others.

    A connection is a stranger's until `admit` is called for it. If there are too many, the oldest
    is closed; none is refused, because its owner is not known yet. If a token is needed, headers
    without it are answered here, at a small part of the cost of a request.

    Parameters
    ----------
    server : web.Server
        Serves the requests.
    token : str
        Token without which a header is refused; empty if none is needed.
    refusal : bytes
        Answer to a refused header: status, fields and body.

    Attributes
    ----------
    strangers : dict
        Open connections of strangers, with the parts of `STRANGER_TIME` that have passed.
    """

    def __init__(self, server: web.Server, token: str, refusal: bytes) -> None:
        self.server, self.refusal, self.token = server, refusal, token.encode()
        self.strangers: dict[asyncio.Transport, float] = {}
        self._admitted: dict[asyncio.Transport, float] = {}
        # Any more would belong to connections that are already closed.
        self._waiting = deque[Pass](maxlen=MOST_CONNECTIONS)

    async def listen(self, host: str, port: int) -> asyncio.Server:
        """Accept connections at an address.

        Raises
        ------
        OSError
            The address is not available.
        """
        loop = asyncio.get_running_loop()
        # asyncio accepts as many connections at once as the system's queue holds.
        listener = await loop.create_server(
            lambda: _Stranger(self), host, port, backlog=ACCEPTED_AT_ONCE
        )
        for each in listener.sockets:
            with socket.fromfd(each.fileno(), each.family, each.type) as same:
                same.listen(QUEUE)
        self._counting = asyncio.create_task(self._count_time())
        return listener

    def admit(self, transport: asyncio.Transport | None) -> None:
        """Count an open connection as the newest of those with access."""
        if transport:
            self.strangers.pop(transport, None)
            self._admitted.pop(transport, None)
            _add(self._admitted, transport)

    def keep(self, transport: asyncio.Transport | None) -> None:
        """Keep a connection with access open, however many others arrive."""
        if transport:
            self._admitted.pop(transport, None)

    def close(self) -> None:
        """Close the connections of strangers."""
        self._counting.cancel()
        for transport in list(self.strangers):
            transport.abort()

    def enter(self, transport: asyncio.Transport, command: bytes, passes: Pass) -> None:
        """Pass a stop to the server at once, and other requests in turns.

        The latest request is first, because its sender is most likely still waiting.
        """
        if transport in self.strangers:
            self.strangers[transport] = -math.inf
        if parsed(command) == STOP:
            passes()
            return
        if not self._waiting:
            asyncio.get_running_loop().call_soon(self._pass_others)
        self._waiting.append(passes)

    def _pass_others(self) -> None:
        for _ in range(min(OTHERS_AT_ONCE, len(self._waiting))):
            self._waiting.pop()()
        if self._waiting:
            asyncio.get_running_loop().call_soon(self._pass_others)

    def awaits(self, header: bytes, body: bytes) -> bool:
        """Return true for a stranger's command whose body is incomplete.

        Waiting here costs much less than in the server. A client that has sent the token is no
        stranger.
        """
        if self.token or not header.startswith(COMMAND):
            return False
        length = LENGTH_OF_BODY.search(header)
        return length is not None and len(body) < int(length[1])

    async def _count_time(self) -> None:
        """Close the connections of strangers whose time is over; rest in between if busy."""
        rest = Rest()
        while True:
            await asyncio.sleep(STRANGER_TIME / TURNS)
            for transport, parts in list(self.strangers.items()):
                self.strangers[transport] = parts + 1
                if parts >= TURNS:
                    transport.abort()
            rest()


class Rest:
    """Pause of the calling thread if it is real-time and its process uses too much of a core."""

    def __init__(self) -> None:
        self._start, self._used = time.monotonic(), time.process_time()

    def __call__(self) -> None:
        """Sleep if the process was busy since the last call; call it regularly."""
        passed, used = time.monotonic() - self._start, time.process_time() - self._used
        if passed >= BREAK:
            urgent = hasattr(os, "sched_getscheduler") and os.sched_getscheduler(0)
            time.sleep(BREAK if urgent and used > BUSY * passed else 0.0)
            self._start, self._used = time.monotonic(), time.process_time()


class _Stranger(asyncio.Protocol):
    """Protocol of a new connection, until its first header is complete."""

    def __init__(self, connections: Connections) -> None:
        self._connections = connections
        self._header = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count as a stranger for `STRANGER_TIME`, and wait for the header."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        _add(self._connections.strangers, transport)

    def data_received(self, data: bytes) -> None:
        """Pass a complete header, with the data after it, to the server, or refuse it."""
        self._header += data
        header, end, body = self._header.partition(b"\r\n\r\n")
        if not end and len(self._header) <= LONGEST_HEADER:
            return
        if self._connections.token not in header:
            answer, _, text = self._connections.refusal.partition(b"\r\n\r\n")
            self._transport.write(answer + b"\r\n\r\n" + (b"" if header[:5] == b"HEAD " else text))
            self._transport.close()
            return
        if len(self._header) <= LONGEST_HEADER and self._connections.awaits(header, body):
            return
        self._transport.pause_reading()
        command = body if header.startswith(COMMAND) else b""
        self._connections.enter(self._transport, command, self._pass)

    def _pass(self) -> None:
        """Pass the connection to the server, unless it was closed meanwhile."""
        if self._transport.is_closing():
            return
        handler = self._connections.server()
        self._transport.set_protocol(handler)
        handler.connection_made(self._transport)
        handler.data_received(self._header)
        self._transport.resume_reading()

    def connection_lost(self, reason: Exception | None) -> None:
        """Remove this connection from the count."""
        self._connections.strangers.pop(self._transport, None)


def parsed(text: Any) -> Any:
    """Return the value of a JSON text or UTF-8 bytes; None if invalid."""
    try:
        return json.loads(text)
    except (TypeError, ValueError, RecursionError):
        return None


def _add(kept: dict[asyncio.Transport, float], transport: asyncio.Transport) -> None:
    """Add the newest connection, and close the oldest if there are too many."""
    kept[transport] = 0.0
    if len(kept) > MOST_CONNECTIONS:
        oldest = next(iter(kept))
        del kept[oldest]
        oldest.abort()

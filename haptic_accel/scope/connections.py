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

"""Connections of a page's server: strangers' apart from those with access to the page."""

from __future__ import annotations

import asyncio
import re
import socket
from collections import deque
from collections.abc import Callable

from aiohttp import web

MOST_CONNECTIONS = 256
"""Connections of strangers, and again of others without a page open at the same time. Both are
far below a process' usual limit of 1024 open files, and far above the 64 of `server.MOST_CLIENTS`
browsers, which open up to seven each."""

STRANGER_TIME = 1.0
"""Time that a connection may stay without access to the page, s: a request that a browser sends is
complete in one or two packets, and a packet that is lost once comes 0.2 s later."""

LONGEST_HEADER = 2**14
"""Most bytes of a stranger's request that are kept: twice aiohttp's limit for a header's field."""

QUEUE = 4096
"""Connections that the system holds until they are accepted, its default limit; in a shorter queue
a connection is lost beside a flood of others, and comes again a second later."""

ACCEPTED_AT_ONCE = 32
"""Connections accepted before all others are served again. A request with access is read four
turns later, thus before `MOST_CONNECTIONS` others have come."""


OTHERS_AT_ONCE = 2
"""First requests, other than commands, that are passed on in a turn: each costs as much as ten
accepted connections."""

COMMAND = b"POST /command "
"""Start of a request that is passed on before all others, once it is complete."""

LENGTH_OF_BODY = re.compile(rb"\r\ncontent-length: *(\d{1,5}) *(?:\r\n|$)", re.IGNORECASE)
"""Field of a header: a body longer than `LONGEST_HEADER` is not waited for (RFC 9110, 8.6)."""


class Connections:
    """Connections of a server, of which strangers can take no resource from others.

    A connection is a stranger's until `admit` is called for it. Of too many, the oldest is closed;
    none is refused, because nobody knows yet whose it is. With a token, a header without it is
    answered here, which costs a small part of what a request costs.

    Parameters
    ----------
    server : web.Server
        Serves the requests.
    token : str
        Token without which a header is refused; empty if none is needed.
    refusal : bytes
        Answer to such a header: status, fields and body.
    """

    def __init__(self, server: web.Server, token: str, refusal: bytes) -> None:
        self.server, self.refusal = server, refusal
        self._token = token.encode()
        self._strangers: dict[asyncio.BaseTransport, None] = {}
        self._admitted: dict[asyncio.BaseTransport, None] = {}
        # More than strangers have connections would be of connections closed already.
        self._waiting = deque[Callable[[], None]](maxlen=MOST_CONNECTIONS)

    async def listen(self, host: str, port: int) -> asyncio.Server:
        """Accept connections at an address.

        Raises
        ------
        OSError
            The address is not available.
        """
        loop = asyncio.get_running_loop()
        # asyncio accepts as many connections at once as the system holds.
        listener = await loop.create_server(
            lambda: _Stranger(self), host, port, backlog=ACCEPTED_AT_ONCE
        )
        for each in listener.sockets:
            with socket.fromfd(each.fileno(), each.family, each.type) as same:
                same.listen(QUEUE)
        return listener

    def meet(self, transport: asyncio.Transport) -> None:
        """Count a new connection as a stranger's for `STRANGER_TIME`."""
        _add(self._strangers, transport)
        asyncio.get_running_loop().call_later(STRANGER_TIME, self._expire, transport)

    def forget(self, transport: asyncio.BaseTransport) -> None:
        """Remove a closed connection of a stranger from the count."""
        self._strangers.pop(transport, None)

    def admit(self, transport: asyncio.BaseTransport | None) -> None:
        """Count an open connection as the newest of those with access."""
        if transport:
            self._strangers.pop(transport, None)
            self._admitted.pop(transport, None)
            _add(self._admitted, transport)

    def keep(self, transport: asyncio.BaseTransport | None) -> None:
        """Keep a connection with access however many others come."""
        if transport:
            self._admitted.pop(transport, None)

    def close(self) -> None:
        """Close the connections of strangers."""
        for transport in list(self._strangers):
            self._expire(transport)

    def enter(self, header: bytes, passes: Callable[[], None]) -> None:
        """Pass a command on at once, and other requests by turns.

        The latest is first, whose sender is the most likely to wait still.
        """
        if header.startswith(COMMAND):
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

    def may_enter(self, header: bytes) -> bool:
        """Return true unless a header lacks the token."""
        return self._token in header

    def awaits(self, header: bytes, body: bytes) -> bool:
        """Return true for a stranger's command of which a part of the body is still to come.

        Here it costs a small part of what it costs in the server. Who has shown the token is no
        stranger.
        """
        if self._token or not header.startswith(COMMAND):
            return False
        length = LENGTH_OF_BODY.search(header)
        return length is not None and len(body) < int(length[1])

    def _expire(self, transport: asyncio.BaseTransport) -> None:
        if transport in self._strangers:
            del self._strangers[transport]
            _abort(transport)


class _Stranger(asyncio.Protocol):
    """New connection, until its first header is complete."""

    def __init__(self, connections: Connections) -> None:
        self._connections = connections
        self._header = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Wait for the header."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._connections.meet(transport)

    def data_received(self, data: bytes) -> None:
        """Pass a complete header, and what follows it, to the server, or refuse it."""
        self._header += data
        header, end, body = self._header.partition(b"\r\n\r\n")
        if not end and len(self._header) <= LONGEST_HEADER:
            return
        if not self._connections.may_enter(header):
            answer, _, text = self._connections.refusal.partition(b"\r\n\r\n")
            self._transport.write(answer + b"\r\n\r\n" + (b"" if header[:5] == b"HEAD " else text))
            self._transport.close()
            return
        if len(self._header) <= LONGEST_HEADER and self._connections.awaits(header, body):
            return
        self._transport.pause_reading()
        self._connections.enter(header, self._pass)

    def _pass(self) -> None:
        """Let the server have the connection, unless it was closed meanwhile."""
        if self._transport.is_closing():
            return
        handler = self._connections.server()
        self._transport.set_protocol(handler)
        handler.connection_made(self._transport)
        handler.data_received(self._header)
        self._transport.resume_reading()

    def connection_lost(self, reason: Exception | None) -> None:
        """Remove this connection from the count."""
        self._connections.forget(self._transport)


def _add(kept: dict[asyncio.BaseTransport, None], transport: asyncio.BaseTransport) -> None:
    """Add the newest connection, and close the oldest if there are too many."""
    kept[transport] = None
    if len(kept) > MOST_CONNECTIONS:
        oldest = next(iter(kept))
        del kept[oldest]
        _abort(oldest)


def _abort(transport: asyncio.BaseTransport) -> None:
    assert isinstance(transport, asyncio.Transport)
    transport.abort()

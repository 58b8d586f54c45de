# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Server of the live page and its data, on a separate thread."""

from __future__ import annotations

import asyncio
import base64
import gc
import hashlib
import json
import logging
import os
import re
import socket
import threading
import traceback
from collections.abc import Awaitable, Callable, Collection, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from aiohttp import WSCloseCode, http, web
from aiohttp.typedefs import Handler

from haptic_accel.core.parameters import ParameterError, defined, shown
from haptic_accel.pages import template
from haptic_accel.scope.connections import (
    STOP,
    TOKEN_LETTERS,
    Access,
    Connections,
    is_token,
    parsed,
)
from haptic_accel.scope.state import EVERYTHING, ON_DEMAND, SCENE, SOUND, Cursor, plots_frame
from haptic_accel.scope.windows import Windows, live_rate

FRAME_RATE = 60.0
"""Highest rate of frames of samples, Hz: the refresh rate of most screens."""

SOUND_RATE = 120.0
"""Highest rate of frames to a page with sound, Hz."""

METRICS_PERIOD = 0.2
"""Interval between updates of metrics and states, s: as fast as numbers can be read."""

MOST_CLIENTS = 8
"""Maximum number of pages served simultaneously; each costs some percent of a core."""

HEARTBEAT = 10.0
"""Interval of pings to a page, s; a page that does not answer in half that time is dropped."""

LONGEST_COMMAND = 4096
"""Maximum size of a command and of a WebSocket message, bytes."""

REQUEST_TIME = 10.0
"""Time-out of a connection with access for the headers of its next request, and likewise for the
body, s: enough for a slow network, and short for an idle connection."""

GARBAGE_PERIOD = 10.0
"""Interval between garbage collections, s. Nodes disable collection because pauses disturb forces;
in this server requests leave reference cycles, and pauses are harmless."""

STOPPING_TIME = 2.0
"""Time-out for pages to close their connections, s."""

STARTING_TIME = 10.0
"""Time-out for binding the address, s."""

POLICY = (
    "default-src 'none'; script-src 'self'{script}; style-src 'self'{style}; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy: no content from other servers, no embedding in other pages, and no
inline scripts or styles except those that the page is served with."""

HEADERS = {
    "Content-Security-Policy": POLICY.format(script="", style=""),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

_HALF_ESCAPE = re.compile("%(?![0-9A-Fa-f]{2})")
"""Pattern of a percent sign in an address that encodes nothing."""

_LOG = logging.getLogger(__name__)

LEAD_TIME = 1.0
"""Time without a point after which another page may lead the hand, s; a leading page sends one
point per display frame."""

FARTHEST = 10.0
"""Largest coordinate of a point, m: beyond any arm's reach."""

FAILURE = "the scope failed to serve this page; its log says why"
"""Reason shown when a page is disconnected or a request is not answered."""

NO_TOKEN = "token: open the address that the scope printed when it started"

READ_ONLY = "this scope is read-only: it was started without control"


@dataclass(frozen=True)
class PageKind:
    """Kind of a page: data that it receives, and their rate.

    Attributes
    ----------
    admitted : frozenset of str
        Part of `frames.EVERYTHING` that the page may receive.
    metrics : bool
        False for a page that receives, of the metrics, only the sampling rate.
    period : float
        Interval between states, s.
    """

    admitted: frozenset[str] = EVERYTHING
    metrics: bool = True
    period: float = METRICS_PERIOD


PAGES = {
    "scope": PageKind(),
    "bring_up": PageKind(),
    # A participant must not see what is compared: no tool, desired acceleration or error.
    "study": PageKind(
        frozenset({"actual", "handle", SOUND, SCENE}),
        metrics=False,
        period=0.05,  # so that a stimulus and its screen appear together
    ),
}
"""Kinds of pages by the names of their templates and scripts."""


class CommandError(Exception):
    """Error: a command failed; the message is one line for the page.

    Attributes
    ----------
    status : int
        HTTP status: 400 for a wrong command, 503 if the graph does not answer or refuses.
    """

    def __init__(self, message: str, status: int = 503) -> None:
        super().__init__(message)
        self.status = status


def check_choice(name: str, value: object, known: Collection[str]) -> None:
    """Refuse a value of a command that is not one of the known ones.

    Raises
    ------
    CommandError
    """
    if not isinstance(value, str) or value not in known:
        raise CommandError(f"{name} = {value!r}: must be one of {', '.join(known)}", 400)


class Touched(Protocol):
    """Provider of signals, and of a scene in which a page may lead the hand."""

    windows: Windows

    def scene(self) -> dict[str, Any]:
        """Return the touchable scene, ready for JSON, or raise ParameterError."""

    def lead(self, x: float, z: float) -> str:
        """Lead the simulated hand to a point, m; return the reason if refused."""


class Source(Touched, Protocol):
    """Provider of everything that a page shows."""

    def choices(self) -> dict[str, list[str]]:
        """Return the choices on the page, by action."""

    def state(self) -> dict[str, Any]:
        """Return the state of the graph, ready for JSON."""


Page = web.WebSocketResponse

Act = Callable[[str, Any], Awaitable[str]]
"""Function that executes an action with a value; returns a line, or raises CommandError."""


@dataclass
class Traffic:
    """Counts of data sent to all pages, and of failures to send."""

    frames: int = 0
    bytes: int = 0
    failures: int = 0


def _is_own(record: logging.LogRecord) -> bool:
    """Return true unless a message is about a malformed request, or a client that has left."""
    fault = (record.exc_info or (None, None))[1]
    return not isinstance(fault, http.HttpProcessingError | ConnectionError)


_LOG.addFilter(_is_own)


class ScopeServer:
    """HTTP and WebSocket server of one page.

    Parameters
    ----------
    source : Source
    access : Access
    host : str
        Address to listen on.
    port : int
        Port to listen on; 0 for any free port.
    act : callable, optional
        Executes commands; without it the page is read-only, and cannot lead the hand.
    page : str
        One of `PAGES`.
    texts : mapping, optional
        Texts of a page, by name, for pages in several languages.

    Attributes
    ----------
    traffic : Traffic
    """

    def __init__(
        self,
        source: Source,
        access: Access,
        host: str,
        port: int,
        act: Act | None = None,
        page: str = "scope",
        texts: Mapping[str, str] | None = None,
    ) -> None:
        self._source = source
        self._access = access
        self._host, self._port = host, port
        self._act = act
        self._kind = PAGES[page]
        content = {"choices": source.choices(), "control": act is not None, "texts": texts or {}}
        self._pages = _pages(page, content)
        self._version = hashlib.sha256(b"".join(b for b, _ in self._pages.values())).hexdigest()
        self._clients: dict[Page, Cursor] = {}
        self._leader: tuple[Page | None, float] = None, 0.0
        self._updates: dict[Windows, tuple[str | bytes, ...]] = {}
        self._updated = float("-inf")
        self._logged: set[str] = set()
        self._thread: threading.Thread | None = None
        self._stop: Callable[[], object] | None = None
        self.traffic = Traffic()

    @property
    def clients(self) -> int:
        """Number of connected pages."""
        return len(self._clients)

    @property
    def shown(self) -> set[str]:
        """Names of the signals that any page receives."""
        return {name for cursor in list(self._clients.values()) for name in cursor.shown}

    def start(self) -> str:
        """Listen; return the address of the page.

        Raises
        ------
        OSError
            The address is not available; the message names it.
        """
        bound: Future[int] = Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(bound)), name="scope server", daemon=True
        )
        self._thread.start()
        try:
            port = bound.result(STARTING_TIME)
        except OSError as error:
            raise OSError(
                f"host = {self._host!r}, port = {self._port}: must be an address of this machine"
                f" that is free (port 0: any): {_reason(error)}"
            ) from None
        name = f"[{self._host}]" if ":" in self._host else self._host
        query = f"?token={self._access.token}" if self._access.token else ""
        return f"http://{name}:{port}/{query}"

    def stop(self) -> None:
        """Disconnect all pages and release the address; a second call does nothing."""
        stop, self._stop = self._stop, None
        if stop and self._thread:
            stop()
            self._thread.join(2 * STOPPING_TIME)

    async def _serve(self, bound: Future[int]) -> None:
        application = web.Application(middlewares=[self._guard], client_max_size=LONGEST_COMMAND)
        for path in self._pages:
            application.router.add_get(path, self._page)
        application.router.add_get("/scene", self._scene)
        application.router.add_get("/live", self._live)
        application.router.add_post("/command", self._command)
        # The node handles signals; requests are few and not logged.
        runner = web.AppRunner(
            application,
            handle_signals=False,
            access_log=None,
            logger=_LOG,
            keepalive_timeout=REQUEST_TIME,
            auto_decompress=False,  # a short compressed command may be long
            shutdown_timeout=STOPPING_TIME,
        )
        await runner.setup()
        assert runner.server is not None
        loop, stopped = asyncio.get_running_loop(), asyncio.Event()
        self._connections = Connections(runner.server, self._access.token, _plain(403, NO_TOKEN))
        try:
            listener = await self._connections.listen(self._host, self._port)
        except OSError as error:
            bound.set_exception(error)
        else:
            self._stop = partial(loop.call_soon_threadsafe, stopped.set)
            collecting = asyncio.create_task(_collect_garbage())
            bound.set_result(int(listener.sockets[0].getsockname()[1]))
            await stopped.wait()
            listener.close()
            self._connections.close()
            collecting.cancel()
            closing = [client.close(code=WSCloseCode.GOING_AWAY) for client in self._clients]
            await asyncio.gather(*closing, return_exceptions=True)
        await runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse requests without access, and add the headers to every answer."""
        try:
            response = self._refusal(request)
            if response is None:  # explicit: up to aiohttp 3.9, a response is false
                self._connections.admit(request.transport)
                response = await handler(request)
            elif response.status != 303:
                response.force_close()
        except web.HTTPException as error:
            error.headers.update(HEADERS)
            raise
        except ConnectionError:
            raise  # the client has left
        except Exception as error:
            self._note_failure(request.path, error)
            response = _message(500, FAILURE)
        if not response.prepared:
            response.headers.update({**HEADERS, **response.headers})
            if not self._access.token:  # the client's next connection counts as a stranger's
                response.force_close()
        return response

    def _refusal(self, request: web.Request) -> web.StreamResponse | None:
        """Return a refusal, or a redirection that moves the token from the address to a cookie."""
        if _HALF_ESCAPE.search(request.raw_path):
            return _text(400, "address: each % must be followed by two hexadecimal digits")
        host = request.headers.get("Host")
        if not self._access.admits_host(host):
            return _text(403, "Host: must be a name of this machine")
        ours = self._access.admits_origin(request.headers.get("Origin"), host)
        if request.path in ("/live", "/command") and not ours:
            return _text(403, "Origin: must be this page's own")
        if not self._access.token:
            return None
        # The name has the port, as browsers keep one set of cookies for all ports of a host.
        cookie = f"haptic_accel_scope_{urlsplit(f'//{host}').port or 80}"
        query = request.query.get("token")
        bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
        if not all(map(is_token, filter(None, (query, bearer)))):
            return _text(400, f"token: must consist of {TOKEN_LETTERS}")
        if request.path == "/" and query is not None and self._access.admits_token(query):
            # Remove the token from the address, which is visible and stays in the browser's
            # history.
            response = web.Response(status=303, headers={"Location": "/"})
            response.set_cookie(cookie, query, httponly=True, samesite="Lax", path="/")
            return response
        if not self._access.admits_token(bearer or request.cookies.get(cookie)):
            return _text(403, NO_TOKEN)
        return None

    async def _page(self, request: web.Request) -> web.Response:
        content, headers = self._pages[request.path]
        return web.Response(body=content, headers=headers)

    async def _scene(self, request: web.Request) -> web.Response:
        try:
            scene = await asyncio.to_thread(self._source.scene)
            return web.json_response(text=as_json(scene))
        except ParameterError as error:
            return _message(503, str(error))

    async def _command(self, request: web.Request) -> web.Response:
        """Execute a command: a JSON object with an action and, if needed, a value."""
        if self._act is None:
            return _message(403, READ_ONLY)
        # A foreign page's form cannot send this type without a preflight request.
        if request.content_type != "application/json":
            return _message(415, "Content-Type: must be application/json")
        command = parsed(await _body(request))
        if not isinstance(command, dict) or not isinstance(command.get("action"), str):
            return _message(400, "command: must be a JSON object with an action")
        if command == STOP:  # complete the stop even while other connections arrive
            self._connections.keep(request.transport)
        value = command.get("value")
        if not isinstance(value, str | bool | None):
            return _message(400, "value: must be a text, true or false")
        try:
            return _message(200, await self._act(command["action"], value))
        except CommandError as error:
            return _message(error.status, str(error))

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Send frames until the page disconnects."""
        if len(self._clients) >= MOST_CLIENTS:
            return _text(503, f"{MOST_CLIENTS} pages are open already, no more are served")
        # No compression: float32 noise hardly shrinks, and compression costs processor time.
        page = Page(heartbeat=HEARTBEAT, compress=False, max_msg_size=LONGEST_COMMAND)
        # Register before any await, because other pages may connect meanwhile.
        self._clients[page] = Cursor(self._source.windows, self._kind.admitted)
        try:
            return await self._show(page, request)
        finally:
            del self._clients[page]

    async def _show(self, page: Page, request: web.Request) -> web.StreamResponse:
        cursor = self._clients[page]
        try:
            await page.prepare(request)
        except ValueError:
            return _text(400, "Sec-WebSocket-Key, Sec-WebSocket-Protocol: must be ASCII")
        self._connections.keep(request.transport)
        acts = self._send(page, cursor), self._receive(page, cursor)
        tasks = [asyncio.create_task(act) for act in acts]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            self._lead(page, None)
        for error in await asyncio.gather(*tasks, return_exceptions=True):
            # A ConnectionError, or no error, means that the page has disconnected.
            if isinstance(error, Exception) and not isinstance(error, ConnectionError):
                self._note_failure("page", error)
                # The page shows the failure, and reconnects.
                await page.close(code=WSCloseCode.INTERNAL_ERROR, message=FAILURE.encode())
        return page

    async def _receive(self, page: Page, cursor: Cursor) -> None:
        """Serve a page's requests until it disconnects."""
        async for message in page:
            content = parsed(message.data)
            if isinstance(content, list) and all(name in ON_DEMAND for name in content):
                cursor.choose(content)
            elif isinstance(content, dict) and _is_point(content.get("point", ())):
                if refusal := self._lead(page, content["point"]):
                    await page.send_json({"refused": refusal})
            else:
                await page.close(code=WSCloseCode.UNSUPPORTED_DATA)
                return

    def _lead(self, page: Page, point: list[float] | None) -> str:
        """Lead the hand for a page, or release the hand; return the reason if refused."""
        now = asyncio.get_running_loop().time()
        leader, until = self._leader
        if leader not in (None, page) and now < until:
            return "hand: another page leads it" if point else ""
        if not point:
            self._leader = None, now
            return ""
        refusal = self._source.lead(*point) if self._act else READ_ONLY
        if not refusal:
            self._leader = page, now + LEAD_TIME
        return refusal

    async def _send(self, page: Page, cursor: Cursor) -> None:
        """Send new data at most at the rate that screen or sound needs.

        Only this task waits for a slow page. Meanwhile no frames are made, so that none queue up,
        and the next frame has the newest samples.
        """
        loop = asyncio.get_running_loop()
        sent = float("-inf")
        while True:
            due = loop.time() + 1 / (SOUND_RATE if SOUND in cursor.shown else FRAME_RATE)
            if (frame := cursor.frame()) is not None:
                await self._give(page, frame)
            if (vectors := cursor.vectors()) is not None:
                await self._give(page, vectors)
            self._refresh(loop.time())
            if self._updated > sent:
                sent = self._updated
                for part in self._updates.get(cursor.windows, ()):
                    await self._give(page, part)
            await asyncio.sleep(max(0.0, due - loop.time()))

    def _note_failure(self, what: str, error: Exception) -> None:
        """Count a failure of this server; log the first of its kind."""
        self.traffic.failures += 1
        *_, (frame, line) = traceback.walk_tb(error.__traceback__)
        location = f"{Path(frame.f_code.co_filename).name}:{line}"
        kind = f"{what}: {type(error).__name__} at {location}"
        if kind not in self._logged:
            self._logged.add(kind)
            _LOG.error("%s: %s", kind, shown(str(error)))

    async def _give(self, page: Page, data: str | bytes) -> None:
        if isinstance(data, str):
            await page.send_str(data)
        else:
            await page.send_bytes(data)
            self.traffic.frames += 1
        self.traffic.bytes += len(data)

    def _refresh(self, now: float) -> None:
        """Update metrics and states for all pages if due."""
        if now - self._updated < self._kind.period:
            return
        axes = list(self._source.windows.by_axis)
        state = {"version": self._version, "axes": axes} | self._source.state()
        if self._act is None:
            state["led"] = False
        shown = {cursor.windows for cursor in self._clients.values()}
        self._updates = {windows: self._update(windows, state) for windows in shown}
        self._updated = now  # set last: a failed update must not count as done

    def _update(self, windows: Windows, state: dict[str, Any]) -> tuple[str | bytes, ...]:
        """Return the message with state and metrics, ready to send to pages."""
        if not self._kind.metrics:
            return (as_json(state | {"metrics": {"rate": live_rate(windows.handle)}}),)
        metrics = windows.metrics()
        return as_json(state | {"metrics": metrics.values}), plots_frame(metrics)


async def _body(request: web.Request) -> bytes:
    """Return the body of a request; empty if incomplete or late."""
    try:
        return await asyncio.wait_for(request.read(), REQUEST_TIME)
    except (web.RequestPayloadError, OSError, asyncio.TimeoutError):
        return b""


def as_json(value: Any) -> str:
    """Return a value as JSON, with null for numbers that are not finite."""
    return json.dumps(defined(value), allow_nan=False)


def _is_point(value: Any) -> bool:
    """Return true for x and z of a point, or for None (release)."""
    return value is None or (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(each, int | float) and abs(each) <= FARTHEST for each in value)
    )


def _pages(name: str, content: Mapping[str, Any]) -> dict[str, tuple[bytes, dict[str, str]]]:
    """Return content and headers of a page and its script by their paths."""
    page = template(f"{name}.html.j2").render(content)
    bundle = template("bundle.js.j2").render(name=f"{name}.js")
    policy = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": _policy(page)}
    return {
        "/": (page.encode(), policy),
        f"/{name}.js": (bundle.encode(), {"Content-Type": "text/javascript; charset=utf-8"}),
    }


def _policy(page: str) -> str:
    """Return the policy of a page, with digests of its inline scripts and styles (CSP 3, 2.3)."""
    allowed = {"script": "", "style": ""}
    for kind, text in re.findall(r"<(script|style)[^>]*>(.*?)</", page, re.DOTALL):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest())
        allowed[kind] += f" 'sha256-{digest.decode()}'"
    return POLICY.format(**allowed)


def _reason(error: OSError) -> str:
    """Return the system's text for an error, without asyncio's additions."""
    if isinstance(error, socket.gaierror) or error.errno is None:
        return error.strerror or str(error)
    return os.strerror(error.errno).lower()


def _text(status: int, text: str) -> web.Response:
    return web.Response(status=status, text=text + "\n")


def _plain(status: int, text: str) -> bytes:
    """Return the bytes of a complete answer with a text; the connection is closed afterwards."""
    body = f"{text}\n".encode()
    fields = {
        "Content-Type": "text/plain; charset=utf-8",
        "Content-Length": str(len(body)),
        "Connection": "close",
        **HEADERS,
    }
    head = [f"HTTP/1.1 {status} {HTTPStatus(status).phrase}", *map(": ".join, fields.items())]
    return "\r\n".join((*head, "", "")).encode() + body


def _message(status: int, message: str) -> web.Response:
    return web.json_response({"message": message}, status=status)


async def _collect_garbage() -> None:
    while True:
        await asyncio.sleep(GARBAGE_PERIOD)
        gc.collect()

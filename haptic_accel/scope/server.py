"""Serves the page of the live scope, and what it shows, on a thread of its own."""

from __future__ import annotations

import asyncio
import gc
import hashlib
import json
import math
import os
import socket
import threading
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol

from aiohttp import WSCloseCode, web

from haptic_accel.pages import asset, template
from haptic_accel.scope.access import Access
from haptic_accel.scope.frames import Cursor, figures_frame
from haptic_accel.scope.windows import Figures, Windows

FRAME_RATE = 60.0
"""Frames of samples a second, at most: that of most screens, Hz."""

FIGURES_PERIOD = 0.2
"""Between two looks at figures and states, s: as fast as numbers can be read."""

MOST_CLIENTS = 8
"""Pages served at the same time; each costs some percent of a core."""

HEARTBEAT = 10.0
"""How often a page is asked whether it is there, s; one that is silent half as long is not."""

LONGEST_COMMAND = 4096
"""Bytes of a command."""

GARBAGE_PERIOD = 10.0
"""How often garbage is collected, s. A node has switched that off for the sake of its forces;
requests leave cycles, and nobody feels a pause here."""

STOPPING_TIME = 2.0
"""How long pages may take to say goodbye, s."""

STARTING_TIME = 10.0
"""How long binding the address may take, s."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy: nothing from elsewhere, nothing inside another's page."""

HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

READ_ONLY = "this scope is read-only: it was started without control"


class CommandError(Exception):
    """A command that could not be carried out; one line for the page.

    Attributes
    ----------
    status : int
        Of HTTP: 400 for a wrong command, 503 where the graph does not answer or refuses.
    """

    def __init__(self, message: str, status: int = 503) -> None:
        super().__init__(message)
        self.status = status


class Source(Protocol):
    """What a page shows besides signals."""

    windows: Windows

    def choices(self) -> dict[str, list[str]]:
        """Return what the page can choose from: controllers, surfaces, grips."""

    def state(self) -> dict[str, Any]:
        """Return states of the graph that JSON can say."""


Act = Callable[[str, Any], Awaitable[str]]
"""Carries out a command, by its action and value; returns one line, or raises CommandError."""


@dataclass
class Traffic:
    """What was sent so far."""

    frames: int = 0
    bytes: int = 0


class ScopeServer:
    """A server of one page.

    Parameters
    ----------
    source : Source
    access : Access
    host : str
        Address to listen on.
    port : int
        0 for any that is free.
    act : callable, optional
        Carries out commands; without it the scope is read-only.
    """

    def __init__(
        self, source: Source, access: Access, host: str, port: int, act: Act | None = None
    ) -> None:
        self._source = source
        self._access = access
        self._host, self._port = host, port
        self._act = act
        self._pages = _pages(source.choices(), control=act is not None)
        self._version = hashlib.sha256(b"".join(b for b, _ in self._pages.values())).hexdigest()
        self._clients: set[web.WebSocketResponse] = set()
        self._figures = Figures()
        self._texts: tuple[str, bytes] = ("", b"")
        self._looked = float("-inf")
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over: asyncio.Event | None = None
        self.traffic = Traffic()

    @property
    def clients(self) -> int:
        """How many pages look now."""
        return len(self._clients)

    @property
    def figures(self) -> Figures:
        """Those last sent."""
        return self._figures

    def start(self) -> str:
        """Listen; return the address of the page.

        Raises
        ------
        OSError
            The address cannot be had; the message says which.
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
        """Say goodbye to all pages and let go of the address; the second time do nothing."""
        loop, self._loop = self._loop, None
        if loop is None or self._thread is None or self._over is None:
            return
        loop.call_soon_threadsafe(self._over.set)
        self._thread.join(2 * STOPPING_TIME)

    async def _serve(self, bound: Future[int]) -> None:
        application = web.Application(middlewares=[self._guard], client_max_size=LONGEST_COMMAND)
        for path in self._pages:
            application.router.add_get(path, self._page)
        application.router.add_get("/live", self._live)
        application.router.add_post("/command", self._command)
        # The node decides about signals; requests are not logged: pages ask for little.
        runner = web.AppRunner(
            application, handle_signals=False, access_log=None, shutdown_timeout=STOPPING_TIME
        )
        await runner.setup()
        site = web.TCPSite(runner, self._host, self._port)
        try:
            await site.start()
        except OSError as error:
            await runner.cleanup()
            bound.set_exception(error)
            return
        self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
        tidy = asyncio.create_task(_collect_garbage())
        bound.set_result(int(runner.addresses[0][1]))
        await self._over.wait()
        tidy.cancel()
        await asyncio.gather(
            *(client.close(code=WSCloseCode.GOING_AWAY) for client in self._clients),
            return_exceptions=True,
        )
        await runner.cleanup()

    @web.middleware
    async def _guard(
        self,
        request: web.Request,
        handler: Callable[[web.Request], Awaitable[web.StreamResponse]],
    ) -> web.StreamResponse:
        """Refuse who may not, and give every answer its headers."""
        try:
            response = self._refusal(request) or await handler(request)
        except web.HTTPException as error:
            error.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _refusal(self, request: web.Request) -> web.Response | None:
        """Say no, or take a token from the address of the page into a cookie."""
        host = request.headers.get("Host")
        if not self._access.admits_host(host):
            return _said(403, "Host: must be a name of this machine")
        ours = self._access.admits_origin(request.headers.get("Origin"), host)
        if request.path in ("/live", "/command") and not ours:
            return _said(403, "Origin: must be this page's own")
        if not self._access.token:
            return None
        cookie = f"haptic_accel_scope_{request.url.port}"
        query = request.query.get("token")
        if request.path == "/" and query is not None and self._access.admits_token(query):
            # Out of the address, where it would be seen and kept.
            response = web.Response(status=303, headers={"Location": "/"})
            response.set_cookie(cookie, query, httponly=True, samesite="Lax", path="/")
            return response
        bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
        if not self._access.admits_token(bearer or request.cookies.get(cookie)):
            return _said(403, "token: open the address that the scope printed when it started")
        return None

    async def _page(self, request: web.Request) -> web.Response:
        content, kind = self._pages[request.path]
        return web.Response(body=content, content_type=kind, charset="utf-8")

    async def _command(self, request: web.Request) -> web.Response:
        """Carry out one command: a JSON object with an action, and a value where it has one."""
        if self._act is None:
            return _answered(403, READ_ONLY)
        # A form of another's page cannot send this type without asking first.
        if request.content_type != "application/json":
            return _answered(415, "Content-Type: must be application/json")
        try:
            command = await request.json()
        except ValueError:
            command = None
        if not isinstance(command, dict) or not isinstance(command.get("action"), str):
            return _answered(400, "command: must be a JSON object with an action")
        try:
            return _answered(200, await self._act(command["action"], command.get("value")))
        except CommandError as error:
            return _answered(error.status, str(error))

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Send frames until the page has gone."""
        if len(self._clients) >= MOST_CLIENTS:
            return _said(503, f"{MOST_CLIENTS} pages are open already, no more are served")
        # Not compressed: noise in float32 hardly gets smaller, and it would cost the graph.
        page = web.WebSocketResponse(
            heartbeat=HEARTBEAT, compress=False, max_msg_size=LONGEST_COMMAND
        )
        await page.prepare(request)
        self._clients.add(page)
        sending = asyncio.create_task(self._send(page))
        try:
            async for _ in page:  # pages say nothing; this hears them leave
                pass
        finally:
            sending.cancel()
            self._clients.discard(page)
        return page

    async def _send(self, page: web.WebSocketResponse) -> None:
        """Send what is new, no more often than is seen.

        A page that is slow is waited for, by this task alone: its frames are then not made, so
        that nothing piles up, and it goes on with the newest.
        """
        cursor = Cursor(self._source.windows)
        loop = asyncio.get_running_loop()
        seen = float("-inf")
        try:
            while not page.closed:
                due = loop.time() + 1 / FRAME_RATE
                frame = cursor.frame()
                if frame is not None:
                    await self._give(page, frame)
                self._look(loop.time())
                if self._looked > seen:
                    seen = self._looked
                    for part in self._texts:
                        await self._give(page, part)
                await asyncio.sleep(max(0.0, due - loop.time()))
        except ConnectionError:
            pass  # who listens for its end hears of it

    async def _give(self, page: web.WebSocketResponse, data: str | bytes) -> None:
        if isinstance(data, str):
            await page.send_str(data)
        else:
            await page.send_bytes(data)
            self.traffic.frames += 1
        self.traffic.bytes += len(data)

    def _look(self, now: float) -> None:
        """Take figures and states for all pages, when it is time."""
        if now - self._looked < FIGURES_PERIOD:
            return
        self._looked = now
        self._figures = self._source.windows.figures()
        state = {
            "version": self._version,
            "figures": _numbers(self._figures),
            **self._source.state(),
        }
        self._texts = (json.dumps(state, allow_nan=False), figures_frame(self._figures))


def _pages(choices: Mapping[str, list[str]], *, control: bool) -> dict[str, tuple[bytes, str]]:
    """Return content and type of everything there is to get, by its path."""
    page = template("scope.html.j2").render(control=control, **choices)
    style = "\n".join(
        [asset("uPlot.min.css"), template("page.css.j2").render(), asset("scope.css")]
    )
    return {
        "/": (page.encode(), "text/html"),
        "/scope.css": (style.encode(), "text/css"),
        "/scope.js": (asset("scope.js").encode(), "text/javascript"),
        "/uPlot.js": (asset("uPlot.iife.min.js").encode(), "text/javascript"),
    }


def _reason(error: OSError) -> str:
    """Return the system's words for an error, without what asyncio puts around them."""
    if isinstance(error, socket.gaierror) or error.errno is None:
        return error.strerror or str(error)
    return os.strerror(error.errno).lower()


def _numbers(figures: Figures) -> dict[str, float | None]:
    """Return the figures that are single numbers, in SI units and percent."""
    evaluation = figures.evaluation
    numbers: dict[str, float | None] = {
        "rate": figures.rate,
        "nrmse_percent": evaluation.nrmse_percent if evaluation else None,
        "slope": evaluation.slope_desired_on_actual if evaluation else None,
        "r2": evaluation.r2 if evaluation else None,
        "rms_desired": figures.rms_desired,
        "rms_actual": figures.rms_actual,
        "age_p50": figures.age_p50,
        "age_p99": figures.age_p99,
        "peak_force": figures.peak_force,
        "peak_travel": figures.peak_travel,
    }
    # JSON has no NaN, and a page nothing to show for it.
    return {
        name: value if value is not None and math.isfinite(value) else None
        for name, value in numbers.items()
    }


def _said(status: int, text: str) -> web.Response:
    return web.Response(status=status, text=text + "\n")


def _answered(status: int, message: str) -> web.Response:
    return web.json_response({"message": message}, status=status)


async def _collect_garbage() -> None:
    while True:
        await asyncio.sleep(GARBAGE_PERIOD)
        gc.collect()

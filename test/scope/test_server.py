# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The server as pages and others meet it: real sockets, without a graph."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import struct
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from typing import Any

import aiohttp
import numpy as np
import pytest
from aiohttp import web
from hypothesis import given
from hypothesis import strategies as st
from yarl import URL

from fuzzing import fuzz, mutated
from haptic_accel.core.axes import Axes
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.scope import connections
from haptic_accel.scope import server as served
from haptic_accel.scope.connections import Access
from haptic_accel.scope.server import MOST_CLIENTS, READ_ONLY, CommandError, ScopeServer
from haptic_accel.scope.windows import Windows
from running import PATIENCE, wait_until

START = 1_800_000_000 * NANOSECONDS
TOKEN = "a-token_of.a~test"
OURS = ("Host: {host}", "Origin: http://{host}", f"Authorization: Bearer {TOKEN}")
LIVE = (
    *OURS,
    "Connection: Upgrade",
    "Upgrade: websocket",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
)
JSON = "Content-Type: application/json"


class Source:
    """Signals without a graph."""

    def __init__(self) -> None:
        self.windows = Windows()
        self.count = 0
        self.led: list[tuple[float, float]] = []
        self.refusal = ""

    def choices(self) -> dict[str, list[str]]:
        return {
            "controller": ["none", "dynamic"],
            "surface": ["text"],
            "grip": ["hook"],
            "record": ["start"],
        }

    def state(self) -> dict[str, Any]:
        return {"nodes": []}

    def scene(self) -> dict[str, Any]:
        return {"outlines": {"wood": [[[-0.1, 0.0], [0.1, 0.0]]]}}

    def lead(self, x: float, z: float) -> str:
        self.led.append((x, z))
        return self.refusal

    def feed(self, samples: int) -> None:
        for _ in range(samples):
            stamp = START + self.count * NANOSECONDS // 1000
            self.windows.desired.put(stamp, np.sin(self.count))
            self.windows.handle.put(stamp, np.sin(self.count))
            self.windows.force.put(stamp, 0.0)
            self.count += 1


class Acting:
    """Notes the commands that came through."""

    def __init__(self) -> None:
        self.done: list[tuple[str, Any]] = []

    async def __call__(self, action: str, value: Any) -> str:
        if action == "absent":
            raise CommandError("absent: no such service")
        self.done.append((action, value))
        return f"{action}: done"


Started = Callable[..., tuple[ScopeServer, URL]]


@pytest.fixture
def source() -> Source:
    return Source()


@pytest.fixture
def acting() -> Acting:
    return Acting()


@pytest.fixture
def started(source: Source) -> Iterator[Started]:
    """Start servers on any port; returned with the address that they print."""
    servers: list[ScopeServer] = []

    def start(act: Any = None, host: str = "127.0.0.1", token: str = "") -> tuple[Any, URL]:
        servers.append(ScopeServer(source, Access(host, token), host, 0, act))
        return servers[-1], URL(servers[-1].start())

    yield start
    for one in servers:
        one.stop()


def visit(use: Callable[[aiohttp.ClientSession], Awaitable[Any]]) -> Any:
    async def run() -> Any:
        timeout = aiohttp.ClientTimeout(total=PATIENCE)
        async with aiohttp.ClientSession(timeout=timeout) as session:
            return await use(session)

    return asyncio.run(run())


def look(session: aiohttp.ClientSession, url: URL, **options: Any) -> Any:
    """Return the connection of one more page."""
    return session.ws_connect(url.with_path("/live"), headers=origin(url), **options)


def visit_live(url: URL, use: Callable[[aiohttp.ClientWebSocketResponse], Awaitable[Any]]) -> Any:
    async def opened(session: aiohttp.ClientSession) -> Any:
        async with look(session, url) as live:
            return await use(live)

    return visit(opened)


def origin(url: URL) -> dict[str, str]:
    return {"Origin": str(url.origin())}


def post(url: URL, command: Any, **headers: str) -> tuple[int, str]:
    async def use(session: aiohttp.ClientSession) -> tuple[int, str]:
        async with session.post(
            url.with_path("/command"), json=command, headers={**origin(url), **headers}
        ) as answer:
            return answer.status, await answer.text()

    return visit(use)  # type: ignore[no-any-return]


def get(url: URL, **headers: str) -> tuple[aiohttp.ClientResponse, str]:
    async def use(session: aiohttp.ClientSession) -> tuple[aiohttp.ClientResponse, str]:
        async with session.get(url, headers=headers, allow_redirects=False) as answer:
            return answer, await answer.text()

    return visit(use)  # type: ignore[no-any-return]


async def frames(live: aiohttp.ClientWebSocketResponse, wanted: int) -> list[Any]:
    """Return the next messages that are samples."""
    found: list[Any] = []
    while len(found) < wanted:
        message = await live.receive(PATIENCE)
        assert message.type in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT), message
        if message.type is aiohttp.WSMsgType.BINARY and message.data[0] == 1:
            found.append(message.data)
    return found


def samples_of(frame: bytes) -> tuple[bytes, bytes]:
    """Return counts and samples of a frame, without age and time."""
    return frame[:32], frame[44:]


def test_everything_the_page_needs_comes_from_here(started: Started) -> None:
    _, url = started()
    page, html = get(url)
    assert page.status == 200
    policy = page.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert "unsafe" not in policy
    answer, script = get(url.with_path("/scope.js"))
    assert (answer.status, answer.content_type) == (200, "text/javascript")
    assert re.findall(r"(?:src|href)=.?([^\"'> ]+)", html) == ["data:,"]
    assert not re.search(r"@import|url\(", html + script)


def test_read_only_has_no_controls_and_refuses_commands(started: Started, source: Source) -> None:
    _, url = started()
    _, page = get(url)
    assert "Read-only" in page
    assert "data-action" not in page
    assert 'id="stop"' not in page
    status, text = post(url, {"action": "estop", "value": True})
    assert status == 403
    assert READ_ONLY in text

    async def lead(live: aiohttp.ClientWebSocketResponse) -> str:
        await live.send_json({"point": [0.0, 0.0]})
        return await refused(live)

    assert visit_live(url, lead) == READ_ONLY
    assert source.led == []


def test_commands_come_through_where_control_is_allowed(started: Started, acting: Acting) -> None:
    _, url = started(acting)
    assert post(url, {"action": "controller", "value": "none"})[0] == 200
    assert acting.done == [("controller", "none")]
    status, text = post(url, {"action": "absent"})
    assert (status, json.loads(text)) == (503, {"message": "absent: no such service"})


def test_a_token_is_asked_for_everywhere_and_moves_into_a_cookie(
    started: Started, acting: Acting
) -> None:
    _, printed = started(acting, host="0.0.0.0", token=TOKEN)
    assert printed.query["token"] == TOKEN
    bare = URL.build(scheme="http", host="127.0.0.1", port=printed.port or 0, path="/")
    for path in ("/", "/scope.js", "/scene"):
        assert get(bare.with_path(path))[0].status == 403
    assert get(bare.with_query(token="wrong"))[0].status == 403
    assert get(bare, Cookie=f"haptic_accel_scope_{bare.port}=wrong")[0].status == 403
    assert post(bare, {"action": "estop", "value": True})[0] == 403
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    assert post(bare, {"action": "estop", "value": True}, **bearer)[0] == 200

    async def use(session: aiohttp.ClientSession) -> None:
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await session.ws_connect(bare.with_path("/live"), headers=origin(bare))
        # A page on an address of numbers: aiohttp keeps such cookies only when set to.
        async with session.get(bare.with_query(token=TOKEN), allow_redirects=False) as answer:
            assert answer.status == 303
            assert answer.headers["Location"] == "/"
            cookie = answer.cookies[f"haptic_accel_scope_{bare.port}"]
            assert cookie["httponly"]
            assert cookie["samesite"] == "Lax"
        headers = {**origin(bare), "Cookie": cookie.OutputString(attrs=[])}
        async with session.get(bare, headers=headers) as answer:
            assert answer.status == 200
        async with session.ws_connect(bare.with_path("/live"), headers=headers) as live:
            assert (await live.receive(PATIENCE)).type is aiohttp.WSMsgType.TEXT

    visit(use)
    assert acting.done == [("estop", True)]


def test_two_pages_see_the_same_and_one_that_leaves_is_forgotten(
    started: Started, source: Source
) -> None:
    server, url = started()
    source.feed(200)
    assert get(url)[0].status == 200
    assert (server.traffic.frames, server.traffic.bytes) == (0, 0), "where nobody looks"

    async def use(session: aiohttp.ClientSession) -> None:
        async with look(session, url) as first:
            async with look(session, url) as second:
                # But for the time at which the frame was made.
                one, other = await frames(first, 1), await frames(second, 1)
                assert samples_of(*one) == samples_of(*other)
                assert server.clients == 2
            source.feed(50)
            assert len(await frames(first, 1)) == 1

    visit(use)
    wait_until(lambda: server.clients == 0, "all pages forgotten")


def test_states_are_json_and_samples_only_what_is_new(started: Started, source: Source) -> None:
    _, url = started()
    source.feed(100)

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        (frame,) = await frames(live, 1)
        assert int.from_bytes(frame[8:12], "little") == 100
        state = json.loads((await live.receive(PATIENCE)).data)
        assert state["metrics"]["rate"] == 1000.0
        source.feed(7)
        (frame,) = await frames(live, 1)
        assert int.from_bytes(frame[8:12], "little") == 7

    visit_live(url, use)


def test_a_frame_tells_how_old_its_newest_sample_was(started: Started, source: Source) -> None:
    _, url = started()

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        source.windows.desired.put(time.time_ns() - 2 * NANOSECONDS, 1.0)
        begun = time.monotonic()
        (frame,) = await frames(live, 1)
        age, made = *struct.unpack_from("<f", frame, 32), *struct.unpack_from("<d", frame, 36)
        assert age == pytest.approx(2.0 + made - begun, abs=0.05)

    visit_live(url, use)


def test_a_state_that_cannot_be_made_disconnects_the_page_and_is_logged_once(
    started: Started, source: Source, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    server, url = started()
    monkeypatch.setattr(source, "state", lambda: {"nodes": {1, 2}})

    async def use(session: aiohttp.ClientSession) -> None:
        for _ in range(3):
            async with look(session, url) as live:
                message = await live.receive(PATIENCE)
                assert message.type is aiohttp.WSMsgType.CLOSE, message
                assert message.data == aiohttp.WSCloseCode.INTERNAL_ERROR
                assert message.extra == served.FAILURE

    visit(use)
    assert server.traffic.failures == 3
    (record,) = caplog.records
    assert "set is not JSON serializable" in record.message


def test_a_failing_request_is_answered_and_logged_once(
    started: Started, source: Source, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    _, url = started()

    def fail() -> dict[str, Any]:
        raise OverflowError("a scene too large")

    monkeypatch.setattr(source, "scene", fail)
    assert [get(url.with_path("/scene"))[0].status for _ in range(3)] == [500] * 3
    (record,) = caplog.records
    assert "OverflowError" in record.message


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_a_number_that_is_not_finite_is_null_in_json(value: Any) -> None:
    read = json.loads(served.as_json(value), parse_constant=pytest.fail)
    if value == value and "inf" not in repr(value) and "nan" not in repr(value):
        assert read == value


def test_more_pages_than_are_served_are_told_also_if_they_come_at_once(
    started: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, url = started()
    shake_hands = web.WebSocketResponse.prepare

    async def wait(page: web.WebSocketResponse, request: web.BaseRequest) -> Any:
        await asyncio.sleep(0.05)  # for a client that has not read what came before
        return await shake_hands(page, request)

    monkeypatch.setattr(web.WebSocketResponse, "prepare", wait)

    async def use(session: aiohttp.ClientSession) -> None:
        asked = (look(session, url) for _ in range(20))
        found = await asyncio.gather(*asked, return_exceptions=True)
        refused = [each for each in found if isinstance(each, aiohttp.WSServerHandshakeError)]
        assert {each.status for each in refused} == {503}
        assert len(found) - len(refused) == MOST_CLIENTS

    visit(use)


def test_a_page_that_does_not_read_gets_no_queue_and_holds_nobody_up(
    started: Started, source: Source, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served, "FRAME_RATE", 1000.0)
    server, url = started()
    slow = connected(url)
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    slow.sendall(request(url, "GET /live", *LIVE))
    wait_until(lambda: server.clients == 1, "the slow page is there")
    over = threading.Event()

    def pour() -> None:
        while not over.wait(0.002):
            source.feed(2000)

    pouring = threading.Thread(target=pour)
    pouring.start()
    try:

        def full() -> bool:
            before = server.traffic.frames
            threading.Event().wait(0.5)
            return server.traffic.frames == before > 0

        wait_until(full, "the slow page is sent nothing more")

        async def use(session: aiohttp.ClientSession) -> None:
            async with look(session, url, max_msg_size=2**26) as quick:
                assert len(await frames(quick, 20)) == 20

        visit(use)
    finally:
        over.set()
        pouring.join()
        slow.close()


def connected(url: URL, sent: bytes = b"") -> socket.socket:
    opened = socket.create_connection(("127.0.0.1", url.port or 0), timeout=PATIENCE)
    opened.sendall(sent)
    return opened


def status(url: URL, sent: bytes) -> int:
    """Return the status of the answer to bytes."""
    with connected(url, sent) as opened, opened.makefile("rb") as answer:
        return int(answer.readline().split()[1])


def request(url: URL, line: str, *fields: str, body: bytes = b"") -> bytes:
    """Return a request whose fields may name the {host}; with a body, of its length if untold."""
    told = any(each.startswith("Content-Length") for each in fields)
    length = [] if told or not body else [f"Content-Length: {len(body)}"]
    head = "\r\n".join((f"{line} HTTP/1.1", *fields, *length, "", ""))
    return head.replace("{host}", url.authority).encode("latin-1") + body


def test_who_has_access_and_does_not_finish_a_request_is_disconnected(
    started: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served, "REQUEST_TIME", 0.1)
    _, url = started(token=TOKEN)
    with connected(url, request(url, "GET /scope.js", *OURS)) as opened:
        opened.sendall(b"GET / HTTP/1.1\r\nHost: local")
        while opened.recv(2**16):
            pass


@pytest.mark.parametrize("token", [TOKEN, ""])
def test_a_command_that_never_ends_is_refused_or_dropped(
    started: Started, acting: Acting, monkeypatch: pytest.MonkeyPatch, token: str
) -> None:
    monkeypatch.setattr(served, "REQUEST_TIME", 0.1)
    monkeypatch.setattr(connections, "STRANGER_TIME", 0.1)
    _, url = started(acting, token=token)
    asked = request(url, "POST /command", *OURS, JSON, "Content-Length: 100", body=b'{"action"')
    with connected(url, asked) as opened:
        assert opened.recv(12) == (b"HTTP/1.1 400" if token else b"")
    assert not acting.done


def test_a_command_in_pieces_arrives(started: Started, acting: Acting) -> None:
    _, url = started(acting)
    asked = request(url, "POST /command", *OURS, JSON, body=b'{"action": "estop", "value": true}')
    with connected(url, asked[:-20]) as opened, opened.makefile("rb") as answer:
        time.sleep(0.05)  # in a packet of its own
        opened.sendall(asked[-20:])
        assert answer.readline().split()[1] == b"200"
    assert acting.done == [("estop", True)]


def test_a_page_outlives_the_time_for_its_request(
    started: Started, source: Source, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served, "REQUEST_TIME", 0.01)
    _, url = started()

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        for _ in range(10):
            source.feed(50)
            assert len(await frames(live, 1)) == 1

    visit_live(url, use)


def test_a_page_asks_for_further_signals(started: Started) -> None:
    server, url = started()

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        await live.send_json(["position"])
        await asyncio.to_thread(wait_until, lambda: "position" in server.shown, "asked for")
        assert "arm_force" not in server.shown

    visit_live(url, use)
    wait_until(lambda: server.shown == set(), "nothing is shown to nobody")


def test_a_page_chooses_among_the_axes_of_the_rig(started: Started, source: Source) -> None:
    _, url = started()
    source.windows.show_axes(Axes(("y", "z")))
    source.windows.by_axis["y"].force.put(START, 0.5)

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        await live.send_json(["axis_y"])
        peaks: list[float | None] = []
        while not peaks or peaks[-1] != 0.5:
            message = await live.receive(PATIENCE)
            if message.type is aiohttp.WSMsgType.TEXT:
                state = json.loads(message.data)
                assert state["axes"] == ["y", "z"]
                peaks.append(state["metrics"].get("peak_force"))

    visit_live(url, use)


async def refused(live: aiohttp.ClientWebSocketResponse) -> str:
    """Return the reason that a page is given next."""
    while True:
        message = await live.receive(PATIENCE)
        if message.type is aiohttp.WSMsgType.TEXT and "refused" in message.data:
            return str(json.loads(message.data)["refused"])


def test_one_page_at_a_time_leads_the_hand(started: Started, source: Source) -> None:
    _, url = started(Acting())

    async def use(session: aiohttp.ClientSession) -> None:
        async with look(session, url) as other:
            async with look(session, url) as first:
                await first.send_json({"point": [0.01, -0.002]})
                await asyncio.to_thread(wait_until, lambda: bool(source.led), "led")
                await other.send_json({"point": [0.0, 0.0]})
                assert await refused(other) == "hand: another page leads it"
                await other.send_json({"point": None})
                await first.send_json({"point": [0.02, 0]})
            # The first has left.
            await asyncio.to_thread(wait_until, lambda: len(source.led) == 2, "led again")
            await other.send_json({"point": [0.03, 0.0]})
            await asyncio.to_thread(wait_until, lambda: len(source.led) == 3, "led by the other")
            source.refusal = "hand: must be led otherwise"
            await other.send_json({"point": [0.0, 0.0]})
            assert await refused(other) == source.refusal

    visit(use)
    assert source.led[:3] == [(0.01, -0.002), (0.02, 0), (0.03, 0.0)]


def test_a_page_that_plays_sound_receives_frames_more_often(
    started: Started, source: Source, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served, "FRAME_RATE", 10)
    monkeypatch.setattr(served, "SOUND_RATE", 1000)
    _, url = started()

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:

        async def time_of_frames() -> float:
            begun = time.monotonic()
            for _ in range(15):
                source.feed(8)
                await frames(live, 1)
            return time.monotonic() - begun

        silent = await time_of_frames()
        await live.send_json(["sound"])
        assert await time_of_frames() < silent

    visit_live(url, use)


def test_the_scene_is_served_and_places_to_who_asks(started: Started, source: Source) -> None:
    _, url = started()
    source.windows.vectors = {"tool": (0.01, 0.0, -0.002), "handle": (0.0, 0.0, 0.01)}

    async def use(session: aiohttp.ClientSession) -> None:
        answer = await session.get(url.with_path("/scene"))
        assert await answer.json() == source.scene()
        async with look(session, url) as live:
            await live.send_json(["scene"])
            while True:
                message = await live.receive(PATIENCE)
                if message.type is aiohttp.WSMsgType.BINARY and message.data[0] == 3:
                    break
            places = np.frombuffer(message.data[4:], "<f4")
            assert places[:2] == pytest.approx([0.01, -0.002])
            assert np.isnan(places[2:4]).all()

    visit(use)


@pytest.mark.parametrize(
    "sent",
    [
        "x" * (served.LONGEST_COMMAND + 1),
        '{"point": 1}',
        '{"point": [NaN, 0]}',
        f'{{"point": [0, {10**400}]}}',
        '["travels"]',
        "[" * 4000,
        b"\xff",
    ],
)
def test_a_page_that_asks_for_anything_else_is_disconnected(
    started: Started, caplog: pytest.LogCaptureFixture, sent: str | bytes
) -> None:
    server, url = started()
    too_much = len(sent) > served.LONGEST_COMMAND
    code = aiohttp.WSCloseCode

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        await (live.send_bytes(sent) if isinstance(sent, bytes) else live.send_str(sent))
        while (message := await live.receive(PATIENCE)).type is not aiohttp.WSMsgType.CLOSE:
            pass
        assert message.data == (code.MESSAGE_TOO_BIG if too_much else code.UNSUPPORTED_DATA)

    visit_live(url, use)
    wait_until(lambda: server.clients == 0, "the page is forgotten")
    assert caplog.records == []


def test_an_address_that_is_taken_is_said_in_one_line(started: Started, source: Source) -> None:
    _, url = started()
    second = ScopeServer(source, Access("127.0.0.1"), "127.0.0.1", url.port or 0)
    with pytest.raises(OSError, match=f"port = {url.port}: must be an address") as error:
        second.start()
    assert len(str(error.value).splitlines()) == 1
    second.stop()


def test_a_stopped_server_says_goodbye_and_frees_its_port(
    started: Started, source: Source
) -> None:
    server, url = started()

    async def use(live: aiohttp.ClientWebSocketResponse) -> None:
        await live.receive(PATIENCE)
        await asyncio.to_thread(server.stop)
        while (message := await live.receive(PATIENCE)).type in (
            aiohttp.WSMsgType.TEXT,
            aiohttp.WSMsgType.BINARY,
        ):
            pass
        assert message.type is aiohttp.WSMsgType.CLOSE

    visit_live(url, use)
    again = ScopeServer(source, Access("127.0.0.1"), "127.0.0.1", url.port or 0)
    again.start()
    again.stop()


# Whatever comes

FIELDS = (
    *LIVE,
    f"Cookie: haptic_accel_scope_{{port}}={TOKEN}",
    "Host: evil.example",
    "Host: {host}:99999",
    "Origin: null",
    "Authorization: Bearer wrong",
    "Authorization: Bearer \udcff",
    "Content-Type: application/json",
    "Content-Length: 30",
    "Content-Length: -1",
    "Transfer-Encoding: chunked",
    "Transfer-Encoding: gzip, chunked",
    "Content-Encoding: deflate",
    "Expect: 100-continue",
    "Expect: more",
    "Range: bytes=0-",
    "Sec-WebSocket-Version: 99",
    "Sec-WebSocket-Key: \u20ac",
    "Sec-WebSocket-Extensions: permessage-deflate; server_max_window_bits=99",
    "Cookie: a=\x01; \udc80",
    "X: " + "x" * 9000,
)
METHODS = (*("GET", "POST") * 5, "HEAD", "OPTIONS", "CONNECT", "get", "G\x00T", "PRI")
TARGETS = (
    "/",
    "/live",
    "/command",
    "/scope.js",
    f"/?token={TOKEN}",
    "/?token=x",
    "*",
    "//",
    "/%00",
)
ACTIONS = ('{"action":"estop","value":true}', '{"action":"absent"}')
BODIES = (*ACTIONS, "3\r\n{}\n\r\n0\r\n\r\n", "[" * 999)


@st.composite
def requests(draw: st.DrawFn) -> bytes:
    """Draw a request of whatever fields, for any host in place of {host}."""
    line = " ".join(
        draw(st.sampled_from(part))
        for part in (METHODS, TARGETS, [*["HTTP/1.1"] * 9, "HTTP/1.0", "HTTP/9.9"])
    )
    fields = draw(st.sampled_from([OURS, OURS, OURS[:2], LIVE, ()]))
    more = draw(st.lists(st.sampled_from(FIELDS), max_size=2))
    body = draw(st.sampled_from(BODIES))
    length = draw(
        st.sampled_from(
            [f"Content-Length: {len(body)}\r\nContent-Type: application/json"] * 4 + ["X: 1"]
        )
    )
    return "\r\n".join((line, *fields, *more, length, "", body)).encode("utf-8", "surrogateescape")


pieces = st.sampled_from(
    [b"\r\n", b"\n", b"\0", b":", b" ", b"\xff", b"%", b"\r\n\r\n", b"0", b"{"]
)


Controlled = tuple[ScopeServer, Acting, URL]


@pytest.fixture
def controlled(started: Started, acting: Acting) -> Controlled:
    """Start a server that takes commands with a token."""
    server, url = started(acting, token=TOKEN)
    return server, acting, url


HOST, ORIGIN, SHOWN = OURS
OTHER_HOST, OTHER_ORIGIN = "Host: evil.example", "Origin: http://evil.example"
TEXT = "Content-Type: text/plain"
RELEASE = b'{"action": "estop", "value": false}'

MALFORMED: list[tuple[str, bytes]] = [
    *((f"Content-Length: {length}", b"") for length in ("ten", -1, 10**30)),
    ("A: b", b"{"),
    ("A: b", b"\xff\xfe\xfd"),
    ("A: b", b"[" * 4000),
    ("A: b", b'{"action":"x","value":' + b"[" * 900 + b"]" * 900 + b"}"),
    ("Content-Encoding: gzip", b"\x1f\x8b\x08 no gzip"),
    ("a field without a colon", b"5"),
    ("Cookie: " + "x" * 10_000, b"5"),
    ("A: b", b"[]"),
    ("A: b", b'"estop"'),
    ("A: b", b'{"value": 1}'),
    ("A: b", b'{"action": 3}'),
    ("A: b", b'{"action": "estop", "value": 1}'),
    ("A: b", b'{"action": "' + b"x" * 10_000 + b'"}'),
]
"""A field and a body that no command has."""

OTHER_PAGES: list[tuple[str, tuple[str, ...], int]] = [
    ("POST /command", (HOST, OTHER_ORIGIN, JSON), 403),
    ("POST /command", (OTHER_HOST, OTHER_ORIGIN, JSON), 403),
    ("POST /command", (HOST, TEXT), 403),
    ("POST /command", (HOST, ORIGIN, TEXT), 415),
    ("GET /live", (HOST,), 403),
    ("GET /live", (HOST, OTHER_ORIGIN), 403),
    ("GET /live", (OTHER_HOST,), 403),
    ("GET /", (OTHER_HOST, ORIGIN), 403),
]
"""Requests of other pages, which can neither command nor look, and their answers."""

KEYS = ("MDEyMzQ1Njc4OWFiY2RlZg=\xff", "MDEyMzQ1Njc4OWFiY2R\xe2\x82\xac==")
NO_TEXTS: list[tuple[str, tuple[str, ...], int]] = [
    *((f"GET /?token={each}", (SHOWN,), 400) for each in ("%", "%ff", "%zz", "\xff")),
    ("GET /%zz", (SHOWN,), 400),
    *(
        ("GET /", (f"Authorization: Bearer {each}",), 400 if TOKEN in each else 403)
        for each in ("\xff\xfe", "schl\xc3\xbcssel", "schl\xfcssel", f"\xff{TOKEN}")
    ),
    *(("GET /live", (*LIVE[1:-1], f"Sec-WebSocket-Key: {key}"), 400) for key in KEYS),
]
"""Requests with bytes that are no text, and their answers."""


@pytest.mark.parametrize(
    ("line", "fields", "body", "answers"),
    [
        *(("POST /command", (*OURS, JSON, each), body, {400, 413}) for each, body in MALFORMED),
        ("POST /command", (*OURS, f"{JSON}; charset=none"), b"{", {400}),
        *((line, (*of, SHOWN), RELEASE, {answer}) for line, of, answer in OTHER_PAGES),
        *((line, (HOST, *of), b"", {answer}) for line, of, answer in NO_TEXTS),
    ],
)
def test_a_malformed_or_foreign_request_is_the_clients_fault(
    controlled: Controlled,
    caplog: pytest.LogCaptureFixture,
    line: str,
    fields: tuple[str, ...],
    body: bytes,
    answers: set[int],
) -> None:
    _, acting, url = controlled
    assert status(url, request(url, line, *fields, body=body)) in answers
    assert acting.done == []
    assert caplog.records == []


@fuzz
@given(requests() | mutated(requests(), pieces))
def test_no_request_is_the_servers_fault_or_gets_past_the_token(
    controlled: Controlled,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    wire: bytes,
) -> None:
    monkeypatch.setattr(served, "REQUEST_TIME", 0.02)
    monkeypatch.setattr(connections, "STRANGER_TIME", 0.02)
    _, acting, url = controlled
    wire = wire.replace(b"{host}", url.authority.encode()).replace(
        b"{port}", str(url.port).encode()
    )
    with connected(url, wire) as opened, opened.makefile("rb") as answer:
        first = []
        with suppress(ConnectionError):
            first = answer.readline().split()
    code = int(first[1]) if first else 400
    assert code < 500 or (code == 503 and b"absent" in wire)
    assert code in (100, *range(400, 600)) or TOKEN.encode() in wire
    if acting.done:
        assert TOKEN.encode() in wire
        assert f"Origin: {url.origin()}".encode() in wire
        acting.done.clear()
    assert caplog.records == []
    caplog.clear()


def frame(opcode: int, payload: bytes, told: int, masked: bool) -> bytes:
    """Return a WebSocket frame (RFC 6455) that tells any length; the mask is zero."""
    mask = 0x80 * masked
    if told < 126:
        head = bytes([opcode, mask | told])
    elif told < 2**16:
        head = bytes([opcode, mask | 126]) + told.to_bytes(2, "big")
    else:
        head = bytes([opcode, mask | 127]) + told.to_bytes(8, "big")
    return head + bytes(4 * masked) + payload


@st.composite
def websocket_frames(draw: st.DrawFn) -> bytes:
    """Draw a frame of any kind, most with the right length."""
    opcode = draw(st.sampled_from([0x81, 0x82, 0x88, 0x89, 0x8A, 0x01, 0x80, 0xF1, 0x8B, 0xC1]))
    payload = draw(st.sampled_from([b"", b"x", b"\x03\xe8", b"\xff\xfe", b"x" * 200, b"x" * 5000]))
    lies = st.sampled_from([0, 125, 126, 2**16 - 1, 2**31, 2**63, 2**64 - 1])
    told = draw(st.one_of(*[st.just(len(payload))] * 4, lies))
    return frame(opcode, payload, told, masked=draw(st.sampled_from([True] * 5 + [False])))


ASKED = (
    *('["position"]', '["arm_force", "scene", "sound"]', "[]", '{"point": null}'),
    *('{"point": [0.01, -0.02]}', '{"point": [10, -10]}', '{"point": [-0.0, 5e-324]}'),
)
"""Messages that a page may send."""

coordinates = st.floats() | st.integers() | st.sampled_from([10.0, -10.5, True, None, "0", []])
odd_points = st.lists(coordinates, max_size=3).map(lambda point: json.dumps({"point": point}))
said = st.one_of(st.sampled_from(ASKED), odd_points, mutated(st.sampled_from(ASKED), st.text()))


def framed(text: str) -> bytes:
    payload = text.encode("utf-8", "surrogatepass")
    return frame(0x81, payload, len(payload), masked=True)


spoken = st.lists(said.map(framed), max_size=8).map(b"".join)
garbled = mutated(st.lists(websocket_frames(), min_size=1, max_size=4).map(b"".join), pieces)


@fuzz
@given(spoken | garbled)
def test_whatever_a_page_sends_the_hand_is_led_within_reach_and_the_page_forgotten(
    controlled: Controlled, source: Source, caplog: pytest.LogCaptureFixture, wire: bytes
) -> None:
    server, acting, url = controlled
    begun = time.monotonic()
    with connected(url, request(url, "GET /live", *LIVE)) as opened:
        assert opened.recv(12) == b"HTTP/1.1 101"
        source.feed(3)
        opened.sendall(wire + frame(0x88, b"", 0, masked=True))
    while server.clients:
        assert time.monotonic() - begun < PATIENCE
        time.sleep(1e-3)
    for point in source.led:
        assert all(abs(each) <= served.FARTHEST for each in point)
    source.led.clear()
    assert acting.done == []
    assert server.traffic.failures == 0
    assert caplog.records == []
    caplog.clear()

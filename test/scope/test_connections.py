# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Connections of a page's server, and access to the page."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import pytest
from hostile_connections import HOST, KINDS, TOKEN, UPGRADE, Nothing, confirm, request, stop
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.parameters import ParameterError
from haptic_accel.scope import connections
from haptic_accel.scope.connections import TOKEN_VARIABLE, Access
from haptic_accel.scope.server import Act, ScopeServer
from running import PATIENCE, wait_until

OURS = ["localhost", "localhost:8642", "127.0.0.1:9", "127.9.9.9", "[::1]:8642", "LOCALHOST:1"]
OTHERS = [None, "", "evil.example", "evil.example:8642", "localhost.evil.example"]
OTHERS += ["127.0.0.1.evil.example", "localhost@evil.example", "evil.example#localhost"]
OTHERS += ["localhost/evil", "localhost:port", "localhost:70000", "[::1"]


@pytest.mark.parametrize("header", OURS + OTHERS)
@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "0.0.0.0"])
def test_names_of_this_machine_are_admitted_on_any_port(header: str | None, host: str) -> None:
    assert Access(host).admits_host(header) is (header in OURS)


def test_an_open_address_is_reached_by_its_numbers_and_names() -> None:
    access = Access("0.0.0.0")
    assert access.admits_host("192.168.1.20:8642")
    assert access.admits_host(f"{socket.gethostname()}:8642")
    assert not Access("127.0.0.1").admits_host("192.168.1.20:8642")


@given(st.text(max_size=40))
def test_any_host_header_is_decided(header: str) -> None:
    for host in ("127.0.0.1", "0.0.0.0"):
        assert Access(host).admits_host(header) in (True, False)


@pytest.mark.parametrize(
    ("origin", "host", "ours"),
    [
        ("http://localhost:8642", "localhost:8642", True),
        ("https://localhost:8642", "localhost:8642", True),
        ("http://localhost:8000", "localhost:8642", False),
        ("http://evil.example", "localhost:8642", False),
        ("null", "localhost:8642", False),
        (None, "localhost:8642", False),
        ("http://", "", False),
        ("http://None", None, False),
    ],
)
def test_only_our_own_page_is_our_origin(origin: str | None, host: str | None, ours: bool) -> None:
    assert Access("127.0.0.1").admits_origin(origin, host) is ours


def test_a_token_is_made_only_where_others_can_reach_the_address() -> None:
    assert Access("127.0.0.1").token == ""
    assert Access("127.0.0.1").admits_token(None)
    assert Access("127.0.0.1", "given").token == "given"
    made = {Access("0.0.0.0").token for _ in range(10)}
    assert len(made) == 10
    assert all(len(token) >= 24 for token in made)


@given(st.from_regex(r"[A-Za-z0-9._~-]+", fullmatch=True), st.text(st.characters()))
def test_only_the_token_itself_is_admitted(token: str, given_token: str) -> None:
    access = Access("0.0.0.0", token)
    assert access.admits_token(token)
    assert access.admits_token(given_token) is (given_token == token)
    assert not access.admits_token(None)


@pytest.mark.parametrize("token", ["two words", "schl\u00fcssel", "a&b", "100%", "a#b", "a\n"])
def test_a_token_that_an_address_cannot_carry_is_refused_and_not_shown(token: str) -> None:
    with pytest.raises(ParameterError, match=f"^{TOKEN_VARIABLE}: must consist of") as refused:
        Access("127.0.0.1", token)
    assert token not in str(refused.value)


STOPS = 5

HOSTILE = connections.MOST_CONNECTIONS + 44
"""Hostile connections at a time: more than are held."""

RENEWAL = 0.3
"""Pause before a connection is renewed, s, that leaves others of this process their turns."""

bearer = f"Authorization: Bearer {TOKEN}"


@pytest.fixture(params=[TOKEN, ""], ids=["token", "no token"])
def token(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@contextmanager
def serving(token: str, act: Act = confirm) -> Iterator[tuple[ScopeServer, int]]:
    """Serve a page; yield the server and its port."""
    server = ScopeServer(Nothing(), Access(HOST, token), HOST, 0, act)
    try:
        yield server, int(server.start().split(":")[2].split("/")[0])
    finally:
        server.stop()


@pytest.fixture
def served(token: str) -> Iterator[tuple[ScopeServer, int]]:
    with serving(token) as found:
        yield found


@pytest.fixture
def server(served: tuple[ScopeServer, int]) -> ScopeServer:
    return served[0]


@pytest.fixture
def port(served: tuple[ScopeServer, int]) -> int:
    return served[1]


def connected(port: int, sent: bytes) -> socket.socket:
    opened = socket.create_connection((HOST, port), timeout=PATIENCE)
    opened.sendall(sent)
    return opened


def rest(opened: socket.socket) -> bytes:
    """Return what comes until the connection is closed."""
    found = b""
    with suppress(ConnectionError):
        while got := opened.recv(2**16):
            found += got
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_a_stop_comes_through_beside_more_connections_than_are_held(
    port: int, token: str, kind: str
) -> None:
    opened = 0

    async def renew() -> None:
        nonlocal opened
        while True:
            reader, writer = await asyncio.open_connection(HOST, port)
            opened += 1
            with suppress(OSError):
                await KINDS[kind](reader, writer)
            writer.close()
            await asyncio.sleep(RENEWAL)

    async def attack() -> None:
        attacking = [asyncio.create_task(renew()) for _ in range(HOSTILE)]
        while opened < HOSTILE:
            await asyncio.sleep(0.01)
        for _ in range(STOPS):
            await asyncio.to_thread(stop, port, token)  # raises an error unless confirmed
        for each in attacking:
            each.cancel()
        for ended in await asyncio.gather(*attacking, return_exceptions=True):
            assert isinstance(ended, asyncio.CancelledError | ConnectionError)

    asyncio.run(attack())


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: local", b"POST / HTTP/1.1\r\n"])
def test_half_a_header_is_dropped_and_a_page_is_not(
    server: ScopeServer, port: int, sent: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connected(port, request("GET /live HTTP/1.1", bearer, *UPGRADE)) as page:
        wait_until(lambda: server.clients == 1, "the page is there")
        monkeypatch.setattr(connections, "STRANGER_TIME", 0.1)
        with connected(port, sent) as stranger:
            assert stranger.recv(1) == b""
        page.setblocking(True)
        assert page.recv(1) != b""
        assert server.clients == 1


def test_who_shows_no_token_is_told_and_closed() -> None:
    with serving(TOKEN) as (_, port):
        for method in ("GET", "HEAD"):
            with connected(port, request(f"{method} / HTTP/1.1")) as stranger:
                answer, _, body = rest(stranger).partition(b"\r\n\r\n")
            assert answer.startswith(b"HTTP/1.1 403 ")
            assert b"Content-Security-Policy: " in answer
            assert (b"open the address" in body) == (method == "GET")
        with connected(port, request("GET / HTTP/1.1", f"{bearer}x")) as stranger:
            assert rest(stranger).startswith(b"HTTP/1.1 403 ")


def test_of_too_many_strangers_the_oldest_is_closed_and_no_page(
    server: ScopeServer, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 3)
    monkeypatch.setattr(connections, "STRANGER_TIME", 1e3)
    with ExitStack() as closing:
        page = connected(port, request("GET /live HTTP/1.1", bearer, *UPGRADE))
        closing.enter_context(page)
        wait_until(lambda: server.clients == 1, "the page is there")
        first, *others = [closing.enter_context(connected(port, b"GET /")) for _ in range(4)]
        assert rest(first) == b""
        for each in others:
            each.setblocking(False)
            with pytest.raises(BlockingIOError):
                each.recv(1)
        assert server.clients == 1


def test_of_too_many_idle_connections_with_access_the_oldest_is_closed(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 2)
    asked = request("GET /scene HTTP/1.1", bearer)
    with ExitStack() as closing:
        opened = [closing.enter_context(connected(port, b"")) for _ in range(2)]
        for each in opened:
            each.sendall(asked)
            assert each.recv(12) == b"HTTP/1.1 200"
        opened[0].sendall(asked)  # in use again: no longer the oldest
        third = closing.enter_context(connected(port, asked))
        assert third.recv(12) == b"HTTP/1.1 200"
        rest(opened[1])  # ends only when closed


def test_a_stop_that_waits_while_the_server_stands_still_is_answered_first(
    token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "STRANGER_TIME", 0.2)
    done: list[str] = []

    async def act(action: str, value: Any) -> str:
        done.append(action)
        if action == "stand still":
            time.sleep(0.5)  # of the whole server, as if it was stopped
        return action

    def give(opened: socket.socket, action: str) -> None:
        body = json.dumps({"action": action, "value": True}).encode()
        fields = bearer, "Content-Type: application/json", f"Content-Length: {len(body)}"
        opened.sendall(request("POST /command HTTP/1.1", *fields) + body)

    with serving(token, act) as (_, port), ExitStack() as closing:
        opened = [closing.enter_context(connected(port, b"")) for _ in range(32)]
        for each, action in zip(opened, ["stand still", *["record"] * 30, "estop"], strict=True):
            give(each, action)
            wait_until(lambda: done, "the server stands still")
        assert all(each.recv(12) == b"HTTP/1.1 200" for each in opened)
    assert (done[1], len(done)) == ("estop", 32)


def test_a_stop_is_answered_however_many_come_meanwhile(
    token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 2)
    asked, confirmed = threading.Event(), threading.Event()

    async def act(action: str, value: Any) -> str:
        asked.set()
        await asyncio.to_thread(confirmed.wait)
        return action

    with serving(token, act) as (_, port), ThreadPoolExecutor() as pool, ExitStack() as closing:
        closing.callback(confirmed.set)
        stopping = pool.submit(stop, port, token)
        assert asked.wait(PATIENCE)
        for _ in range(5):
            other = connected(port, request("GET /scene HTTP/1.1", bearer))
            assert closing.enter_context(other).recv(12) == b"HTTP/1.1 200"
        confirmed.set()
        stopping.result(PATIENCE)  # raises an error unless confirmed


def test_a_server_that_stops_closes_strangers(server: ScopeServer, port: int, token: str) -> None:
    with connected(port, b"GET /") as stranger:
        stop(port, token)  # a later connection: the stranger's is there
        server.stop()
        assert rest(stranger) == b""

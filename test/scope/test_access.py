# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Access by host, origin and token of a request."""

from __future__ import annotations

import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.parameters import ParameterError
from haptic_accel.scope.access import TOKEN_VARIABLE, Access, is_loopback

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


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("", False)],
)
def test_loopback(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


@pytest.mark.parametrize("token", ["two words", "schl\u00fcssel", "a&b", "100%", "a#b", "a\n"])
def test_a_token_that_an_address_cannot_carry_is_refused_and_not_shown(token: str) -> None:
    with pytest.raises(ParameterError, match=f"^{TOKEN_VARIABLE}: must consist of") as refused:
        Access("127.0.0.1", token)
    assert token not in str(refused.value)

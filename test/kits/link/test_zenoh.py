# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Zenoh's log in a user's words; links between processes are in test/nodes."""

from __future__ import annotations

import random
from collections import deque
from itertools import pairwise
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.link.addresses import Route
from haptic_accel.kits.link.zenoh import Pace, check_keys, refusal, settings

START = "\x1b[2m2026-11-23T02:01:43.418360Z\x1b[0m \x1b[33m WARN\x1b[0m acc-0 ThreadId(05) "
"""Beginning of a line of Zenoh 1.10, in colours."""


@pytest.mark.parametrize(
    ("logged", "said"),
    [
        (
            "\x1b[2mzenoh_link_commons::quic::unicast\x1b[0m\x1b[2m:\x1b[0m QUIC acceptor failed:"
            " ConnectionClosed(ConnectionClose { error_code: Code::crypto(30), frame_type: None,"
            ' reason: b"invalid peer certificate: UnknownIssuer" }) at /root/x.rs:686. Hint: no.',
            "connection refused: invalid peer certificate: UnknownIssuer;",
        ),
        (
            "zenoh_link_commons::quic::unicast: QUIC acceptor failed: TransportError(Error { code:"
            ' Code::crypto(74), frame: None, reason: "peer sent no certificates" }) at /root/x.rs',
            "connection refused: peer sent no certificates;",
        ),
        (
            "zenoh::net::runtime::orchestrator: Unable to connect to quic/10.0.0.1:7447! Can not"
            " create a new QUIC link bound to 10.0.0.1: the cryptographic handshake failed: error"
            " 48: invalid peer certificate: UnknownIssuer at /root/y.rs:597.",
            "connection refused: invalid peer certificate: UnknownIssuer;",
        ),
        (
            "zenoh::net::runtime::orchestrator: Unable to connect to quic/10.0.0.1:7447! Write"
            " error on QUIC link 0.0.0.0:1 => 10.0.0.1:7447: Connection closed at /root/y.rs:1.",
            "connection refused by the peer",
        ),
        ("zenoh::net::runtime::orchestrator: Unable to connect to any of [x]!  at /root/y", ""),
        ("zenoh::net: Something else at /root/y.rs:1.", ""),
    ],
)
def test_a_line_of_the_log_is_a_short_line_for_the_user(logged: str, said: str) -> None:
    text = refusal(START + logged + "\n")
    assert text is not None
    assert text.startswith(said)
    assert (text == "") == (said == "")
    assert "/root" not in text


def test_other_errors_are_passed_on() -> None:
    line = START.replace("WARN", "ERROR") + "zenoh::net: Something else at /root/y.rs:1.\n"
    assert refusal(line) == "zenoh: Something else"


def test_what_others_write_is_no_line_of_the_log() -> None:
    assert refusal("[INFO] [link]: peer is heard\n") is None


def test_the_slave_listens_on_the_address_towards_the_peer_and_nobody_is_searched() -> None:
    way = Route("robot.lab", "fd00::1", "fd00::2", 7447, 7447)
    slave, master = (settings(way, side, Path("keys")) for side in ("slave", "master"))
    assert slave["listen/endpoints"] == ["quic/[fd00::1]:7447?mixed_rel=1"]
    assert master["connect/endpoints"] == ["quic/robot.lab:7447?mixed_rel=1"]
    for each in (slave, master):
        assert each["transport/link/tls"]["enable_mtls"]
        assert not each["scouting/multicast/enabled"]
        assert sum(name.endswith("endpoints") for name in each) == 1


def test_missing_keys_are_named(tmp_path: Path) -> None:
    for name in ("ca.pem", "cert.pem", "key.pem"):
        with pytest.raises(ParameterError, match=rf"^keys = .*: {name}: no such file"):
            check_keys(str(tmp_path))
        (tmp_path / name).write_text("")
    assert check_keys(str(tmp_path)) == tmp_path
    with pytest.raises(ParameterError, match=r"^keys = '': must be"):
        check_keys("")


def run(seconds: float, capacity: float, jitter: float = 0.0) -> tuple[list[float], int]:
    """Send 1000 datagrams a second through a queue that lets so many pass.

    Returns the time that each waited in it, s, and how many were sent in the last second.
    """
    pace, chance = Pace(), random.Random(1)
    queue: deque[tuple[int, float]] = deque()
    echoes: list[tuple[float, int]] = []
    waited, credit, sent = [], 0.0, 0
    for tick in range(round(1000 * seconds)):
        now = tick / 1000
        if (number := pace.number(now)) is not None:
            queue.append((number, now))
            sent += now >= seconds - 1
        credit = min(credit + capacity / 1000, 2.0)
        while queue and credit >= 1:
            credit -= 1
            number, begun = queue.popleft()
            waited.append(now - begun)
            echoes.append((now + 0.04 + jitter * chance.random(), number))
        for arrival, number in [each for each in echoes if each[0] <= now]:
            echoes.remove((arrival, number))
            pace.acknowledge(number, now)
    return waited, sent


def test_a_network_that_takes_all_gets_all_in_spite_of_jitter() -> None:
    waited, sent = run(5.0, 2000.0, jitter=0.04)
    assert sent == 1000
    assert max(waited) == 0


@pytest.mark.parametrize("capacity", [150.0, 300.0, 600.0])
def test_a_queue_is_kept_short_where_the_network_takes_less(capacity: float) -> None:
    waited, sent = run(20.0, capacity)
    late = waited[len(waited) // 2 :]
    assert sorted(late)[len(late) // 2] < 0.03
    assert sent >= 0.25 * capacity


def test_a_datagram_is_never_left_out_for_long() -> None:
    pace = Pace()
    pace.stride = 16
    sent = [tick / 200 for tick in range(200) if pace.number(tick / 200)]
    assert max(b - a for a, b in pairwise(sent)) <= 0.0151

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest

from haptic_accel.core.network import TRANSPORTS
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import ARMS
from haptic_accel.kits.link.addresses import bound, route


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("namespace", ["", "/left"])
@pytest.mark.parametrize("peer", ["127.0.0.1", "127.0.0.1:9000"])
def test_both_hosts_find_the_same_ports(transport: str, namespace: str, peer: str) -> None:
    master, slave = (route(peer, side, transport, namespace) for side in ARMS)
    assert master.own_port == slave.peer_port
    assert master.peer_port == slave.own_port
    assert (master.own_port == slave.own_port) == (transport == "zenoh")
    assert not peer.endswith("9000") or master.own_port == 9000


def test_two_namespaces_have_ports_of_their_own_outside_those_of_ros() -> None:
    ports = [
        port
        for namespace in ("", "/left", "/right")
        for side in ARMS
        for port in (route("127.0.0.1", side, "udp", namespace).own_port,)
    ]
    assert len(set(ports)) == len(ports)
    assert max(ports) < 7400


def test_the_own_address_is_that_towards_the_peer() -> None:
    found = route("localhost", "master", "udp", "")
    assert (found.host, found.own, found.peer) == ("localhost", "127.0.0.1", "127.0.0.1")


def test_a_peer_without_an_address_is_said_in_one_line() -> None:
    with pytest.raises(OSError, match=r"^peer no-such.invalid: cannot be reached: "):
        route("no-such.invalid", "master", "udp", "")


@pytest.mark.parametrize("address", ["127.0.0.1", "::1"])
def test_a_port_that_is_taken_is_named_in_one_line(address: str) -> None:
    with bound(address, 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ParameterError, match=rf"^port {port}/udp of {address}: address al"):
            bound(address, port)
    bound(address, port).close()


@pytest.mark.parametrize("side", ARMS)
def test_a_peer_of_ipv6_is_reached_from_an_address_of_ipv6(side: str) -> None:
    found = route("[::1]:7000", side, "udp", "")
    assert (found.own, found.peer) == ("::1", "::1")

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Relay between two real sockets, by a clock of the test."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise

import pytest

from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.link.addresses import Route
from haptic_accel.kits.link.relaying import Relay

HOST = "127.0.0.1"


class Hosts:
    """Relay and the socket of each host."""

    def __init__(self, network: ChannelParameters) -> None:
        self.ends = [_bound(), _bound()]
        routes = [Route(HOST, HOST, HOST, 0, each.getsockname()[1]) for each in self.ends]
        self.relay = Relay((routes[0], routes[1]), network, seed=1)
        for end, own in zip(self.ends, self.relay.sockets, strict=True):
            end.connect(own.getsockname())

    def received(self, end: int) -> list[bytes]:
        found = []
        while True:
            try:
                found.append(self.ends[end].recv(100))
            except BlockingIOError:
                return found

    def close(self) -> None:
        self.relay.close()
        for each in self.ends:
            each.close()


def _bound() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind((HOST, 0))
    opened.setblocking(False)
    return opened


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    with closing(Hosts(ChannelParameters(delay=0.05))) as made:
        yield made


def test_a_datagram_arrives_after_the_delay_on_the_other_side_only(hosts: Hosts) -> None:
    for end in (0, 1):
        hosts.ends[end].send(b"from %d" % end)
    hosts.relay.step(1.0)
    assert hosts.relay.due == pytest.approx(1.05)
    hosts.relay.step(1.049)
    assert [hosts.received(end) for end in (0, 1)] == [[], []]
    hosts.relay.step(1.05)
    assert [hosts.received(end) for end in (0, 1)] == [[b"from 1"], [b"from 0"]]


def test_a_change_holds_for_later_datagrams(hosts: Hosts) -> None:
    hosts.ends[0].send(b"slow")
    hosts.relay.step(0.0)
    hosts.relay.network = ChannelParameters()
    hosts.ends[0].send(b"fast")
    hosts.relay.step(0.01)
    assert hosts.received(1) == [b"fast"]
    hosts.relay.step(0.06)
    assert hosts.received(1) == [b"slow"]


def test_a_longer_delay_comes_gradually_and_a_shorter_one_at_once(hosts: Hosts) -> None:
    hosts.relay.step(0.0)
    hosts.relay.network = ChannelParameters(delay=0.25)
    assert hosts.relay.network.delay == 0.25
    arrivals = []
    for tick in range(400):
        hosts.ends[0].send(b"%d" % tick)
        hosts.relay.step(1e-3 * tick)
        arrivals.append(len(hosts.received(1)))
    reached = [tick for tick, count in enumerate(arrivals) if count]
    assert max(b - a for a, b in pairwise(reached)) <= 3  # ms
    assert hosts.relay.due == pytest.approx(0.4, abs=0.01)
    hosts.relay.network = ChannelParameters(delay=0.0)
    hosts.ends[0].send(b"now")
    hosts.relay.step(0.4)
    assert b"now" in hosts.received(1)


def test_some_datagrams_are_lost_and_the_seed_says_which() -> None:
    arrived = []
    for _ in range(2):
        with closing(Hosts(ChannelParameters(loss=0.3))) as hosts:
            for number in range(200):
                hosts.ends[0].send(b"%d" % number)
                hosts.relay.step(float(number))
            arrived.append(hosts.received(1))
    assert arrived[0] == arrived[1]
    assert 120 < len(arrived[0]) < 160


def test_a_host_that_does_not_receive_yet_does_no_harm(hosts: Hosts) -> None:
    hosts.relay.network = ChannelParameters()
    hosts.ends[1].close()
    for number in range(5):
        hosts.ends[0].send(b"%d" % number)
        hosts.relay.step(float(number))
    assert hosts.received(0) == []


def test_strangers_are_not_heard(hosts: Hosts) -> None:
    hosts.relay.network = ChannelParameters()
    with closing(_bound()) as stranger:
        stranger.sendto(b"false", hosts.relay.sockets[0].getsockname())
    hosts.relay.step(0.0)
    assert hosts.received(1) == []


def test_a_port_in_use_is_refused(hosts: Hosts) -> None:
    used = hosts.relay.sockets[0].getsockname()[1]
    route = Route(HOST, HOST, HOST, used, 9)
    with pytest.raises(ParameterError, match=f"port {used}/udp"):
        Relay((route, route), ChannelParameters())

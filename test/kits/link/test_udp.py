# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two hosts over real sockets, and a third that reads what they send and sends to both."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from haptic_accel.kits.link.addresses import Route, bound
from haptic_accel.kits.link.datagrams import KEY_LENGTH, TAG_LENGTH, Authenticator
from haptic_accel.kits.link.endpoint import Endpoint, Motion, State, unpack
from haptic_accel.kits.link.link import UdpCarrier
from running import wait_until

KEY = b"k" * KEY_LENGTH
SIDES = ("master", "slave")
RATE = 1000.0
FAR = (0.1, 0.0, 0.0)
"""Place to which the third wants the arm, m."""


class Host:
    """A host's half of the link: its packets, and the socket that carries them."""

    def __init__(self, side: str, route: Route, session: int) -> None:
        self.side = side
        self.refused: set[str] = set()
        self.sent: list[bytes] = []
        self.places = {(0.0, 0.0, 0.0)}
        self.end = Endpoint(side, RATE, session)
        self.seal = Authenticator(KEY, side)
        self.carrier = UdpCarrier(route, self.seal, self.refused.add)
        self._thread = threading.Thread(target=self.carrier.run, args=(self._take,))
        self._lock = threading.Lock()
        self._thread.start()

    def _take(self, data: bytes) -> None:
        with self._lock:
            if packet := self.end.incoming(data, time.monotonic(), time.time_ns()):
                self.places.add(packet.position)

    def send(self) -> None:
        with self._lock:
            now = time.monotonic()
            data = self.end.outgoing(State(True), Motion(1), 0.0, now, time.time_ns())
        if data:
            self.sent.append(self.seal.tagged(data))
            self.carrier.send(data)

    def hears(self) -> bool:
        return self.end.fresh(time.monotonic(), 0.05)

    def close(self) -> None:
        self.carrier.close()
        self._thread.join()


Hosts = tuple[list[Host], list[tuple[str, int]]]


@pytest.fixture(params=["127.0.0.1", "::1"])
def hosts(request: pytest.FixtureRequest) -> Iterator[Hosts]:
    address = request.param
    with ExitStack() as stack:
        ports = []
        for _ in SIDES:
            with bound(address, 0) as free:
                ports.append(free.getsockname()[1])
        made = []
        for side, session, (own, other) in zip(SIDES, (5, 6), (ports, ports[::-1]), strict=True):
            host = Host(side, Route(address, address, address, own, other), session)
            stack.callback(host.close)
            made.append(host)
        yield made, [(address, port) for port in ports]


def met(pair: list[Host]) -> bool:
    """Send both ways at the rate of a link; return whether both have heard enough."""
    for _ in range(25):
        for host in pair:
            host.send()
        time.sleep(1.0 / RATE)
    return all(host.hears() and host.end.session.received > 20 for host in pair)


def test_what_earlier_runs_sent_is_of_no_use_to_later_ones(hosts: Hosts) -> None:
    pair, addresses = hosts
    family = socket.AF_INET6 if ":" in addresses[0][0] else socket.AF_INET
    wait_until(lambda: met(pair), "packets both ways")
    for session, host in enumerate(pair, 7):
        host.end = Endpoint(host.side, RATE, session)
    with socket.socket(family, socket.SOCK_DGRAM) as third:
        for sender, address in zip(pair, reversed(addresses), strict=True):
            for data in [*sender.sent[-50:], b"the last"]:
                third.sendto(data, address)
    wait_until(lambda: all(host.refused for host in pair), "the last")
    for host in pair:
        assert host.end.session.unanswered > -math.inf
        assert host.end.session.received == 0
        assert host.end.peer is None
    wait_until(lambda: met(pair), "packets both ways")


def test_a_third_host_moves_nothing_and_ends_nothing(hosts: Hosts) -> None:
    pair, addresses = hosts
    family = socket.AF_INET6 if ":" in addresses[0][0] else socket.AF_INET
    wait_until(lambda: met(pair), "packets both ways")
    with socket.socket(family, socket.SOCK_DGRAM) as third:
        third.setblocking(False)
        for number in range(100):
            for host in pair:
                host.send()
            for sender, address in zip(pair, reversed(addresses), strict=True):
                newest = sender.sent[-1]
                packet = unpack(newest[:-TAG_LENGTH])
                wrong = packet._replace(sequence=packet.sequence + 1 + number, position=FAR)
                for key in (b"", b"x" * KEY_LENGTH):
                    third.sendto(Authenticator(key, packet.side).tagged(wrong.pack()), address)
                third.sendto(wrong.pack() + newest[-TAG_LENGTH:], address)
                for old in sender.sent[-20:]:  # seen before: none is used a second time
                    third.sendto(old, address)
                third.sendto(newest[:-1], address)
            for host, address in zip(pair, addresses, strict=True):
                third.sendto(host.sent[-1], address)  # reflected
            time.sleep(1e-3)
        enough = [host.end.session.received + 20 for host in pair]

        def hear_on() -> bool:
            both = zip(pair, enough, strict=True)
            return met(pair) and all(host.end.session.received > least for host, least in both)

        wait_until(hear_on, "packets after the attack")
        with pytest.raises(BlockingIOError):
            third.recv(1)
    for host in pair:
        assert host.places == {(0.0, 0.0, 0.0)}
        assert host.refused == {addresses[0][0]}
        session = host.end.session
        (other,) = (each for each in pair if each is not host)
        assert session.received + session.out_of_order <= len(other.sent)
        assert session.doubled > 100
        assert (session.restarts, session.renewals) == (0, 0)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Relay process between two hosts; lines of text change its simulated network."""

from __future__ import annotations

import math
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from dataclasses import dataclass, fields, replace
from typing import Any

from haptic_accel import ChannelParameters, ParameterError, parameter
from haptic_accel.core import UDP, Channel
from haptic_accel.core.process import ENDING, WRONG_ARGUMENTS
from haptic_accel.graph import hurry
from haptic_accel.kits.link.addresses import Route, bound, route
from haptic_accel.setup import assigned_keys, parse_assignments

RISE = 1.0
"""Rate at which the delay increases, s/s. A sudden increase would be a silence of the same length,
at which arms disengage from 0.08 s on; at this rate datagrams arrive at half their rate."""

LONGEST_DATAGRAM = 65535
"""Maximum length of a datagram, bytes; the relay does not read the content."""


class Relay:
    """Two UDP ports, one toward each host, with a simulated network between them.

    The relay acts as the peer for both hosts, and forwards datagrams unchanged, so it needs no
    keys. It has no clock: the caller passes times in s, which never decrease.

    Parameters
    ----------
    routes : tuple of Route
        Routes from the relay to the master's and to the slave's host.
    network : ChannelParameters
        Behaviour of each direction.
    seed : int
        Seed of jitter and loss.

    Attributes
    ----------
    sockets : tuple of socket
        Sockets to wait for.

    Raises
    ------
    ParameterError
        A port is in use.
    """

    def __init__(
        self, routes: tuple[Route, Route], network: ChannelParameters, seed: int = 0
    ) -> None:
        self.sockets = tuple(_connected(each) for each in routes)
        self._channels = tuple(Channel[bytes](network, 2 * seed + end) for end in range(2))
        self._network, self._stepped = network, math.inf

    @property
    def network(self) -> ChannelParameters:
        """Behaviour of each direction; the delay increases at the rate `RISE`.

        Datagrams already in transit keep their delay.
        """
        return self._network

    @network.setter
    def network(self, network: ChannelParameters) -> None:
        self._network = network
        self._approach(0.0)

    @property
    def due(self) -> float:
        """Time of the next arrival, s; infinite if no datagram is in transit."""
        return min(channel.next_arrival for channel in self._channels)

    def step(self, now: float) -> None:
        """Receive the datagrams of both hosts, and deliver those whose delay is over."""
        if self._channels[0].parameters is not self._network:
            self._approach(now - self._stepped)
        self._stepped = now
        for end, channel in enumerate(self._channels):
            for datagram in _received(self.sockets[end]):
                channel.send(datagram, now)
            for datagram in channel.arrived(now):
                with suppress(OSError):  # no buffer space, or the host does not receive yet
                    self.sockets[1 - end].send(datagram)

    def _approach(self, seconds: float) -> None:
        """Set the network of both directions, with the delay increased for a time in s."""
        network = self._network
        longest = self._channels[0].parameters.delay + RISE * max(0.0, seconds)
        if network.delay > longest:
            network = replace(network, delay=longest)
        for channel in self._channels:
            channel.parameters = network

    def close(self) -> None:
        """Release the ports; datagrams in transit are lost."""
        for each in self.sockets:
            each.close()


def _connected(route: Route) -> socket.socket:
    """Return a socket on the route's own port that receives from its peer only."""
    opened = bound(route.own, route.own_port)
    opened.setblocking(False)
    found = socket.getaddrinfo(route.peer, route.peer_port, opened.family, socket.SOCK_DGRAM)
    opened.connect(found[0][4])
    return opened


def _received(connected: socket.socket) -> list[bytes]:
    """Return the datagrams waiting in a socket."""
    found: list[bytes] = []
    while True:
        try:
            found.append(connected.recv(LONGEST_DATAGRAM))
        except BlockingIOError:
            return found
        except ConnectionError:  # an earlier datagram found no receiver
            continue


END_CHECK_PERIOD = 0.1
"""Interval between checks for the end, s."""

CHANGED = "network: "
"""Prefix of the line that reports the network, at the start and after each change."""

RELAY_PRIORITY = 41
"""Real-time priority of the relay, above the nodes', as a real network does not wait for them."""

PORTS = 7200, 7210
"""First ports of master and slave with a relay on their machine, below the link's ports."""


@dataclass(frozen=True)
class RelayArguments(ChannelParameters):
    """Arguments of a relay."""

    master: str = parameter(
        f"127.0.0.1:{PORTS[0]}",
        "host of the master as HOST or HOST:PORT, where that host has peer:=RELAY or RELAY:PORT",
    )
    slave: str = parameter(
        f"127.0.0.1:{PORTS[1]}", "host of the slave, likewise; with another port on one machine"
    )
    seed: int = parameter(0, "seed of jitter and loss", "", 0, 2**31 - 1)


def assignments_of(network: ChannelParameters) -> list[str]:
    """Return a network as ``key:=value`` arguments.

    Examples
    --------
    >>> assignments_of(ChannelParameters(delay=0.05, loss=0.02))
    ['delay:=0.05', 'jitter:=0.0', 'loss:=0.02', 'duplication:=0.0']
    """
    return [f"{each.name}:={getattr(network, each.name)!r}" for each in fields(ChannelParameters)]


def changed(network: ChannelParameters, assignments: Iterable[str]) -> ChannelParameters:
    """Return a network with the values of ``key:=value`` arguments; other values remain.

    Raises
    ------
    ParameterError
        An argument is invalid.

    Examples
    --------
    >>> changed(ChannelParameters(delay=0.05), ["loss:=0.02"])
    ChannelParameters(delay=0.05, jitter=0.0, loss=0.02, duplication=0.0)
    """
    assignments = list(assignments)
    parsed = parse_assignments(assignments, ChannelParameters)
    return replace(network, **{name: getattr(parsed, name) for name in assigned_keys(assignments)})


def open_relay(arguments: RelayArguments) -> Relay:
    """Return a relay with open ports.

    Raises
    ------
    ParameterError
        An address has another form, or a port is in use.
    OSError
        A host is unknown.
    """
    # For the master, the relay is the slave, and vice versa.
    routes = (route(arguments.master, "slave", UDP, ""), route(arguments.slave, "master", UDP, ""))
    return Relay(routes, arguments, arguments.seed)


def serve_relay(
    relay: Relay,
    say: Callable[[str], object],
    ended: Callable[[], bool],
    source: int | None = None,
) -> None:
    """Relay datagrams until `ended`; each line of a file changes the network.

    Parameters
    ----------
    relay : Relay
        Closed at the end.
    say : callable
        Called with a line on the network after each change, and with the reason of a refusal.
    ended : callable
        Called at least every 0.1 s; returns true to end the relay.
    source : int, optional
        File descriptor with lines of ``key:=value`` arguments.

    Raises
    ------
    OSError
        A host cannot be reached.
    """
    with closing(relay):
        say(_stated(relay.network))
        text = b""
        while not ended():
            wait = min(END_CHECK_PERIOD, max(0.0, relay.due - time.monotonic()))
            inputs: list[Any] = [*relay.sockets, *([] if source is None else [source])]
            ready = select.select(inputs, [], [], wait)[0]
            relay.step(time.monotonic())
            if source is not None and source in ready:
                data = os.read(source, 4096)
                source = source if data else None
                *lines, text = (text + data).split(b"\n")
                for line in lines:
                    _change(relay, line.decode(errors="replace"), say)


def _change(relay: Relay, line: str, say: Callable[[str], object]) -> None:
    try:
        relay.network = changed(relay.network, line.split())
    except ParameterError as error:
        say(str(error))
    else:
        say(_stated(relay.network))


def _stated(network: ChannelParameters) -> str:
    return CHANGED + " ".join(assignments_of(network))


def main() -> None:
    """Relay until a signal, or until the process at the other end of standard input ends."""
    numbers: list[int] = []
    for number in ENDING:
        signal.signal(number, lambda number, _: numbers.append(number))
    parent = os.getppid()
    try:
        relay = open_relay(parse_assignments(sys.argv[1:], RelayArguments))
        hurry(RELAY_PRIORITY)
        serve_relay(
            relay,
            lambda line: print(line, flush=True),
            lambda: bool(numbers) or os.getppid() != parent,
            sys.stdin.fileno(),
        )
    except (ParameterError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(WRONG_ARGUMENTS)


if __name__ == "__main__":
    main()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Network between two hosts: simulated by a seed, and what its kit provides.

The kit of two hosts declares the loops of a lockstep trial and the sides of a graph by entry
points.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from haptic_accel.core.axes import Axes
from haptic_accel.core.model import FloatArray
from haptic_accel.core.outside import OutsideError, declared, load
from haptic_accel.core.parameters import Checked, ParameterError, parameter, shown
from haptic_accel.core.tick import HostLoop

T = TypeVar("T")

TWO_HOSTS_GROUP = "haptic_accel.two_hosts"
"""Group of entry points for what the kit of two hosts provides."""


@dataclass(frozen=True)
class ChannelParameters(Checked):
    """Behaviour of one direction of a network."""

    delay: float = parameter(0.0, "mean one-way delay", "s", 0, 10.0)
    jitter: float = parameter(
        0.0, "maximum deviation of a packet's delay from the mean (uniform)", "s", 0, 10.0
    )
    loss: float = parameter(0.0, "fraction of packets that are lost", low=0, high=1.0)
    duplication: float = parameter(
        0.0, "fraction of packets that arrive twice, each with its own delay", low=0, high=1.0
    )


class Channel(Generic[T]):
    """One direction of a simulated network; jitter can change the order of packets.

    The channel has no clock: the caller passes times in s, which never decrease.

    Parameters
    ----------
    parameters : ChannelParameters
    seed : int
    blackouts : sequence of (float, float)
        Start and end of each blackout, s. Packets sent during a blackout are lost.

    Attributes
    ----------
    parameters : ChannelParameters
        May be replaced at any time. Packets already in transit keep their delay.

    Examples
    --------
    >>> channel = Channel[str](ChannelParameters(delay=0.02), seed=1)
    >>> channel.send("first", now=0.0)
    >>> channel.arrived(now=0.019), channel.arrived(now=0.02)
    ([], ['first'])
    """

    def __init__(
        self,
        parameters: ChannelParameters,
        seed: int,
        blackouts: Sequence[tuple[float, float]] = (),
    ) -> None:
        self.parameters = parameters
        self._random = np.random.default_rng(seed)
        self._blackouts = tuple(blackouts)
        self._order = itertools.count()
        self.travelling: list[tuple[float, int, T]] = []
        """Packets in transit with their arrival times; a duplicated packet is listed twice."""

    @property
    def next_arrival(self) -> float:
        """Time of the next arrival, s; infinite if no packet is in transit."""
        return self.travelling[0][0] if self.travelling else math.inf

    def send(self, packet: T, now: float) -> None:
        """Send a packet; it may get lost."""
        lost, twice, *draws = self._random.random(4).tolist()
        p = self.parameters
        if lost < p.loss or any(start <= now < end for start, end in self._blackouts):
            return
        for draw in draws[: 1 + (twice < p.duplication)]:
            arrival = now + max(0.0, p.delay + p.jitter * (2.0 * draw - 1.0))
            heapq.heappush(self.travelling, (arrival, next(self._order), packet))

    def arrived(self, now: float) -> list[T]:
        """Return the packets that have arrived, in order of arrival."""
        found = []
        while self.travelling and self.travelling[0][0] <= now:
            found.append(heapq.heappop(self.travelling)[2])
        return found


@dataclass(frozen=True)
class Crossing:
    """Signals of a network between the arms, at the sampling times of a trial.

    Attributes
    ----------
    played : ndarray, shape (n,)
        Tool's acceleration received by the compensator, m/s^2; 0 while waiting.
    age : ndarray, shape (n,)
        Age of this acceleration, s; NaN while waiting.
    kinds : tuple of str
        Kind of each played sample: waiting, true, repaired or concealed.
    energy : ndarray, shape (n, 2)
        Energy in the tanks of master and slave, J.
    """

    played: FloatArray
    age: FloatArray
    kinds: tuple[str, ...]
    energy: FloatArray


class NetworkedLoops(Protocol):
    """Loops of both hosts in lockstep, with a simulated network between them."""

    loops: Mapping[str, HostLoop]

    def step(self, number: int) -> None:
        """Process a tick on both hosts."""

    def crossing(self, tool: FloatArray, axes: Axes) -> tuple[Crossing, FloatArray]:
        """Return the network's signals, and the tool's acceleration at the played times."""


def provided(name: str) -> Any:
    """Return what the kit of two hosts provides by an entry point.

    Raises
    ------
    OutsideError
        The kit is not installed, or cannot be loaded.
    """
    entry = declared(TWO_HOSTS_GROUP).get(name)
    if entry is None:
        raise OutsideError("network between the arms: needs the kit link, which is not installed")
    return load(entry, lambda _: "")


HIGHEST_PORT = 65535
"""Maximum UDP port."""

UDP, ZENOH = TRANSPORTS = ("udp", "zenoh")
"""Transports of datagrams between hosts."""


def host_and_port(peer: str) -> tuple[str, int]:
    """Return host and port of a peer; port 0 if none is specified.

    Parameters
    ----------
    peer : str
        HOST, HOST:PORT, or for an IPv6 address [HOST]:PORT.

    Raises
    ------
    ParameterError
        The peer has another form.
    """
    host, colon, port = peer.rpartition(":")
    if not colon or (":" in host and not host.endswith("]")):
        host, colon, port = peer, "", "0"
    number = int(port) if port.isascii() and port.isdigit() else -1
    host = host.removeprefix("[").removesuffix("]")
    allowed = host and host.isascii() and host.isprintable() and not set(host) & set(" /[]?#,;")
    # The highest port is not allowed, because the slave uses the next port.
    if not allowed or number not in range(HIGHEST_PORT) or (colon and not number):
        raise ParameterError(
            f"peer = {shown(repr(peer))}: must be HOST or HOST:PORT, with a port from 1 to"
            f" {HIGHEST_PORT - 1}"
        )
    return host, number


def is_loopback(host: str) -> bool:
    """Return true if a host, by its address or name, is reached from this machine only."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"

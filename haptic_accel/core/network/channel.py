# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A network between two hosts with delay, jitter, loss and blackouts, from a seed."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from haptic_accel.core.parameters import Checked, parameter

T = TypeVar("T")


@dataclass(frozen=True)
class ChannelParameters(Checked):
    """Behaviour of one direction of a network."""

    delay: float = parameter(0.0, "mean one-way delay", "s", 0, 10.0)
    jitter: float = parameter(
        0.0, "largest deviation of a packet's delay from the mean; uniform", "s", 0, 10.0
    )
    loss: float = parameter(0.0, "fraction of packets that are lost", low=0, high=1.0)
    duplication: float = parameter(
        0.0, "fraction of packets that arrive twice, each with a delay of its own", low=0, high=1.0
    )


class Channel(Generic[T]):
    """One direction of a network; packets overtake each other where the jitter allows it.

    It has no clock: times are the caller's, in s and never backwards.

    Parameters
    ----------
    parameters : ChannelParameters
    seed : int
    blackouts : sequence of (float, float)
        Start and end of each time, s, in which every packet that is sent is lost.

    Attributes
    ----------
    parameters : ChannelParameters
        May be replaced while packets are on their way, which keep the delay they have.

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
        self._travelling: list[tuple[float, int, T]] = []

    @property
    def travelling(self) -> int:
        """Number of packets on their way, one that is doubled counted twice."""
        return len(self._travelling)

    @property
    def next_arrival(self) -> float:
        """Time of the next arrival, s; infinite with no packet on its way."""
        return self._travelling[0][0] if self._travelling else math.inf

    def send(self, packet: T, now: float) -> None:
        """Put a packet on its way, or lose it."""
        lost, twice, *places = self._random.random(4).tolist()
        p = self.parameters
        if lost < p.loss or any(start <= now < end for start, end in self._blackouts):
            return
        for place in places[: 1 + (twice < p.duplication)]:
            arrival = now + max(0.0, p.delay + p.jitter * (2.0 * place - 1.0))
            heapq.heappush(self._travelling, (arrival, next(self._order), packet))

    def arrived(self, now: float) -> list[T]:
        """Return the packets that have arrived, in the order of their arrival."""
        found = []
        while self._travelling and self._travelling[0][0] <= now:
            found.append(heapq.heappop(self._travelling)[2])
        return found

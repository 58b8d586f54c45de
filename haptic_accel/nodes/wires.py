# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals between nodes that share a process: handed over as they are, without a message."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable

from haptic_accel.core.model import Vector

Queue = deque[tuple[int, Vector]]
"""Stamps, system time in ns, and vectors that wait until they are taken."""


class Wire:
    """One signal of this process, from its sender to those who take it here.

    A receiver joins with a function that is told whether the signal is sent in this process: then
    its samples are in the queue that the function returns, else they come as messages.

    Attributes
    ----------
    queues : list of Queue
        Queues of the receivers while the signal is sent here.

    Examples
    --------
    >>> wire, queue = Wire(), Queue()
    >>> wire.join(lambda here: queue if here else None)
    >>> wire.queues
    []
    >>> wire.offer()
    >>> wire.queues
    [deque([])]
    """

    def __init__(self) -> None:
        self.queues: list[Queue] = []
        self._receivers: list[Callable[[bool], Queue | None]] = []
        self._offered = False

    def join(self, receiver: Callable[[bool], Queue | None]) -> None:
        """Add a receiver, and tell it whether the signal is sent here."""
        self._receivers.append(receiver)
        self._connect()

    def leave(self, receiver: Callable[[bool], Queue | None]) -> None:
        """Remove a receiver."""
        self._receivers.remove(receiver)
        self._connect()

    def offer(self) -> None:
        """Let samples be sent here from now on."""
        self._offered = True
        self._connect()

    def withdraw(self) -> None:
        """Let samples come as messages again, from whoever sends them."""
        self._offered = False
        self._connect()

    def _connect(self) -> None:
        found = [receiver(self._offered) for receiver in self._receivers]
        self.queues = [queue for queue in found if queue is not None]


class Wires:
    """Wires of the nodes that share a process.

    Attributes
    ----------
    joined : bool
        The nodes made from now on share theirs; otherwise each has its own, as in a process of
        its own.
    """

    def __init__(self) -> None:
        self.joined = False
        self._wires: defaultdict[str, Wire] = defaultdict(Wire)

    def of(self, name: str) -> Wire:
        """Return the wire of a topic, by its full name."""
        return self._wires[name] if self.joined else Wire()


WIRES = Wires()
"""Wires of this process."""

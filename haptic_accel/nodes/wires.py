# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Signals between nodes of one process, which one loop passes on without messages."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable


class Wire:
    """One signal in this process: whether it is sent here, and its receivers.

    A receiver joins with a function of a flag: true if this process sends the signal, false if the
    signal comes as messages.

    Examples
    --------
    >>> wire, told = Wire(), []
    >>> wire.join(told.append)
    >>> wire.offer()
    >>> told, wire.listeners
    ([False, True], 1)
    """

    def __init__(self) -> None:
        self._receivers: list[Callable[[bool], object]] = []
        self._offered = False

    @property
    def listeners(self) -> int:
        """Number of receivers to which the signal is passed on here."""
        return len(self._receivers) if self._offered else 0

    def join(self, receiver: Callable[[bool], object]) -> None:
        """Add a receiver, called with whether the signal is sent here."""
        self._receivers.append(receiver)
        receiver(self._offered)

    def leave(self, receiver: Callable[[bool], object]) -> None:
        """Remove a receiver."""
        self._receivers.remove(receiver)

    def offer(self) -> None:
        """Announce to the receivers that samples come on this wire from now on."""
        self._tell(True)

    def withdraw(self) -> None:
        """Announce to the receivers that samples come as messages again, from any sender."""
        self._tell(False)

    def _tell(self, offered: bool) -> None:
        self._offered = offered
        for receiver in self._receivers:
            receiver(offered)


class Wires:
    """Wires of the nodes that share a process.

    Attributes
    ----------
    joined : bool
        Nodes made from now on share wires; otherwise each node has its own, as in a separate
        process.
    """

    def __init__(self) -> None:
        self.joined = False
        self._wires: defaultdict[str, Wire] = defaultdict(Wire)

    def of(self, name: str) -> Wire:
        """Return the wire of a topic, by its full name."""
        return self._wires[name] if self.joined else Wire()


WIRES = Wires()
"""Wires of this process."""

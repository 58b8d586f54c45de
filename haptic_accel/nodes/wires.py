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

"""Signals between nodes that share a process: one loop passes them on, without a message."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable


class Wire:
    """One signal of this process: whether it is sent here, and by whom it is taken.

    A receiver joins with a function that is told whether the signal is sent in this process: if
    not, it comes as messages.

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
        """Add a receiver, and tell it whether the signal is sent here."""
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

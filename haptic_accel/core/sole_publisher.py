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

"""Detection of messages that several publishers may have sent, as a message does not name its own.

A publisher that comes and goes between two looks changes no present number of publishers, so the
total number counts, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

CONFIRMING_LOOKS = 5
"""Looks for which nothing is taken after a number that is not above all earlier ones.

Its publisher is either the present one, which has just replaced another, or one that the
middleware has not counted yet: by then it has.
"""


class Matched(Protocol):
    """Publishers matched with a subscription, as the middleware counts them."""

    total_count: int
    current_count: int


class SolePublisher:
    """Decision whether the messages of a look at a queue come from a single publisher.

    Three facts exclude it: a publisher that came, or left, while there was another one, and a
    number of a message that is not above all earlier ones of the publisher. The last closes the
    moment between a publisher's first message and the middleware's count; so the numbers of a
    publisher are remembered while others come and go.

    Parameters
    ----------
    matched : callable
        Returns the present and the total number of publishers; None for no news.

    Attributes
    ----------
    contenders : int
        Number of publishers that may have sent the messages of the last look.
    changed : bool
        Publishers came or left between the last two looks.
    current : int
        Number of publishers at the last look.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> counts = SimpleNamespace(total_count=1, current_count=1)
    >>> publisher = SolePublisher(lambda: counts)
    >>> publisher.sole([1, 2]), publisher.sole([1, 3])
    (True, False)
    >>> [publisher.sole([number]) for number in range(4, 10)]
    [False, False, False, False, True, True]
    >>> counts.total_count = 2  # one has come and gone
    >>> publisher.sole([10]), publisher.sole([11])
    (False, True)
    """

    def __init__(self, matched: Callable[[], Matched | None]) -> None:
        self._matched = matched
        self._total = self.current = self._last = self._doubted = 0
        self.contenders, self.changed = 0, False

    def sole(self, numbers: Sequence[int | None]) -> bool:
        """Return whether all messages since the last call come from a single publisher.

        If not, what is in the queue after this call may come from others, too, and is to be
        dropped: a publisher that left meanwhile can add nothing more.

        Parameters
        ----------
        numbers : sequence of int or None
            Publisher's number of each message, in order; None if the middleware has none.
        """
        before = self.current, self._total
        if counts := self._matched():
            self.current, self._total = counts.current_count, counts.total_count
        current, total = before
        self.changed = before != (self.current, self._total)
        self.contenders = current + self._total - total
        if self.contenders > 1:
            return False
        if not current:  # numbers of an earlier publisher
            self._last = 0
        self._doubted = max(0, self._doubted - 1)
        for number in numbers:
            if number is not None:
                if number <= self._last:
                    self._doubted = CONFIRMING_LOOKS
                self._last = number
        return not self._doubted

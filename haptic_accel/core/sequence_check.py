# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of the messages of one signal: sequence by stamps, and a single publisher.

Stamps are system times, and the clock can be set while samples arrive. A single wrong stamp must
not cause the rejection of later samples.

A message does not identify its publisher, so `SolePublisher` detects messages that several
publishers may have sent. A publisher that comes and goes between two checks does not change the
present number of publishers, so the total number is checked, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from haptic_accel.core.actuator import MAX_AGE
from haptic_accel.core.sampling import NANOSECONDS

IN_A_ROW = 3
"""Number of successive samples older than the last accepted one, with increasing stamps, that
indicate a clock set back. Delayed samples arrive between newer samples."""

_MAX_AGE = round(MAX_AGE * NANOSECONDS)


class SequenceCheck:
    """Accept the samples of one signal that are newer than all before.

    Parameters
    ----------
    rate : float
        Samples per second.

    Attributes
    ----------
    outdated : int
        Number of samples rejected because their stamp differs from now by more than `MAX_AGE`.
    stale : int
        Number of samples rejected because they were not newer than the last.
    refusal : str
        Reason why the newest sample was rejected; empty if it was accepted.
    jump : float
        Clock step just before the last accepted sample, s; 0 if there was none.

    Examples
    --------
    >>> sequence = SequenceCheck(1000.0)
    >>> [sequence.admits(at, at, at) for at in (1_000_000, 2_000_000, 2_000_000, 5_000_000)]
    [True, True, False, True]
    """

    def __init__(self, rate: float) -> None:
        self._period = NANOSECONDS / rate
        self._last: int | None = None
        self._received = 0
        self._refused = self._row = 0
        self.outdated = self.stale = 0
        self.refusal = ""
        self.jump = 0.0

    def begin(self) -> None:
        """Accept the next sample as the first."""
        self._last = None

    def admits(self, stamp: int, now: int, steady: int) -> bool:
        """Count a sample; return True if it may be used.

        Parameters
        ----------
        stamp : int
            Stamp of the sample, ns.
        now, steady : int
            Reception time of the sample, as system time and monotonic time, ns.
        """
        if abs(now - stamp) > _MAX_AGE:
            self.outdated += 1
            self.refusal = f"stamps differ from now by more than {MAX_AGE:g} s"
            return False
        self.jump = 0.0
        if self._last is not None and not self._follows(stamp - self._last, stamp, steady):
            self.stale, self.refusal = self.stale + 1, "stamps do not advance"
            return False
        self._last, self._received, self._row, self.refusal = stamp, steady, 0, ""
        return True

    def _follows(self, advance: int, stamp: int, steady: int) -> bool:
        """Return True if a sample whose stamp advances by a number of ns is acceptable."""
        steps = round(advance / self._period)
        jumped = advance - (steady - self._received)
        if steps == 0:
            return False
        if steps < 0:
            self._row = self._row + 1 if stamp > self._refused else 1
            self._refused = stamp
            if self._row < IN_A_ROW:
                return False
        elif jumped <= _MAX_AGE:
            return True
        self.jump = jumped / NANOSECONDS
        return True


CONFIRMING_LOOKS = 5
"""Number of checks that reject all messages after a sequence number that is not above all earlier
ones. Its publisher is either the present one, which has just replaced another, or one that the
middleware has not counted yet; after these checks it is counted.
"""


class Matched(Protocol):
    """Publishers matched with a subscription, as the middleware counts them."""

    total_count: int
    current_count: int


class SolePublisher:
    """Check whether the messages in a queue come from a single publisher.

    Three observations exclude this: a publisher that came, or left, while there was another one,
    and a sequence number that is not above all earlier ones of the publisher. The last one covers
    the time between a publisher's first message and the middleware's count; therefore the numbers
    of a publisher are remembered while others come and go.

    Parameters
    ----------
    matched : callable
        Returns the present and the total number of publishers; None if they are unchanged.

    Attributes
    ----------
    contenders : int
        Number of publishers that may have sent the messages of the last check.
    changed : bool
        True if publishers came or left between the last two checks.
    current : int
        Number of publishers at the last check.

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
        """Return True if all messages since the last call come from a single publisher.

        If not, messages that are in the queue after this call may also come from others, and must
        be dropped. A publisher that left meanwhile cannot add more.

        Parameters
        ----------
        numbers : sequence of int or None
            Publisher's number of each message, in order; None if the middleware has none.
        """
        current, total = before = self.current, self._total
        if counts := self._matched():
            self.current, self._total = counts.current_count, counts.total_count
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

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Succession of a signal's samples by their stamps, also where a clock is set meanwhile.

Stamps are system time, which can be set while samples keep coming. A single wrong stamp must not
shut out those that follow.
"""

from __future__ import annotations

from haptic_accel.core.actuator.safety import MAX_AGE
from haptic_accel.core.sampling import NANOSECONDS

IN_A_ROW = 3
"""Samples older than the last, each newer than the one before, with which a clock counts as set
back: single stragglers come between newer samples."""

_MAX_AGE = round(MAX_AGE * NANOSECONDS)


class Succession:
    """Admits the samples of one signal that are newer than those before.

    Parameters
    ----------
    rate : float
        Samples per second.

    Attributes
    ----------
    outdated : int
        Samples refused because their stamp differs from now by more than `MAX_AGE`.
    stale : int
        Samples refused because they were not newer than the last.
    jump : float
        Time by which a clock was set just before the last one, s; 0 if it was not.

    Examples
    --------
    >>> succession = Succession(1000.0)
    >>> [succession.admits(at, at, at) for at in (1_000_000, 2_000_000, 2_000_000, 5_000_000)]
    [True, True, False, True]
    """

    def __init__(self, rate: float) -> None:
        self._period = NANOSECONDS / rate
        self._last: int | None = None
        self._received = 0
        self._refused = self._row = 0
        self.outdated = self.stale = 0
        self.jump = 0.0

    def begin(self) -> None:
        """Take the next sample as the first."""
        self._last = None

    def admits(self, stamp: int, now: int, steady: int) -> bool:
        """Count a sample; return whether it may be used.

        Parameters
        ----------
        stamp : int
            Its stamp, ns.
        now, steady : int
            Time of its reception, system time and steady time, ns.
        """
        if abs(now - stamp) > _MAX_AGE:
            self.outdated += 1
            return False
        self.jump = 0.0
        if self._last is not None and not self._follows(stamp - self._last, stamp, steady):
            self.stale += 1
            return False
        self._last, self._received, self._row = stamp, steady, 0
        return True

    def _follows(self, advance: int, stamp: int, steady: int) -> bool:
        """Return whether a sample that advances the stamps by so many ns is the next."""
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

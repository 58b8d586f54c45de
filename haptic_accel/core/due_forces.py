# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forces that wait for the tick at which they are due.

A force is due a whole number of samples after the one that caused it, neither earlier nor later:
the delay of a plant may be inverted, a delay that changes from one force to the next may not.
"""

from __future__ import annotations

from haptic_accel.core.model import Vector

MISSED_SHARE = 0.001
"""Share of missed deadlines up to which a rate counts as held."""

STRAGGLING = 20
"""Samples by which a force may be overtaken by later ones on its way."""

Caused = tuple[int, Vector]
"""Stamp of the sample that caused a force, ns, and the force, N."""


class DueForces:
    """Commands of one kind, from their reception until they are applied.

    Ticks and samples are counted by the points of the sampling grid.

    Parameters
    ----------
    latency : int
        Samples from the one that caused a force to the tick at which it is due; 0 for on arrival.

    Attributes
    ----------
    due, missed : int
        Number of forces that had a due time; of these, received after the tick was carried out.
    newest : int or None
        Number of the latest sample whose force was received.

    Examples
    --------
    >>> forces = DueForces(latency=1)
    >>> forces.put(7, 7_000_000, (0.0, 0.0, 0.5))
    >>> forces.take(7), forces.take(8)
    (None, (7000000, (0.0, 0.0, 0.5)))
    """

    def __init__(self, latency: int) -> None:
        self._latency = latency
        self._waiting: dict[int, Caused] = {}
        self._out_of_date: Caused | None = None
        self._carried_out: int | None = None
        self._last: int | None = None
        self.newest: int | None = None
        self.due = self.missed = 0

    def put(self, sample: int, stamp: int, force: Vector) -> None:
        """Keep a force until it is due; a straggler, older than the last applied, is dropped."""
        due = sample + self._latency
        if self._latency:
            self.due += 1
            self.missed += self._carried_out is not None and due <= self._carried_out
        self.newest = sample if self.newest is None else max(sample, self.newest)
        # A far older one is no straggler: the safety layer refuses it, and says so.
        if self._last is None or not 0 <= self._last - due <= STRAGGLING:
            self._waiting[due] = stamp, force

    def pass_on(self, stamp: int, force: Vector) -> None:
        """Pass a force that is out of date to the next `take`, for the safety layer to refuse it.

        If it were kept, one of the future would be in time some day.
        """
        self._out_of_date = stamp, force

    def take(self, tick: int, *, ahead: bool = False) -> Caused | None:
        """Return the newest force that is due at a tick or was before; None if there is none.

        One that is out of date counts only where no other is due. Forces taken `ahead` of their
        tick are late only if the caller counts them so.
        """
        if not ahead:
            self._carried_out = tick
        out_of_date, self._out_of_date = self._out_of_date, None
        ready = [due for due in self._waiting if due <= tick]
        if not ready:
            return out_of_date
        self._last = max(ready)
        found = self._waiting[self._last]
        for due in ready:
            del self._waiting[due]
        return found

    def count_anew(self) -> None:
        """Set the counts to zero."""
        self.due = self.missed = 0

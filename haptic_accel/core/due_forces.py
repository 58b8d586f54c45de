# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forces that wait for the tick at which they are due.

A force is due a whole number of samples after the one that caused it, neither earlier nor later:
the delay of a plant may be inverted, a delay that changes from one force to the next may not.
Whether one was in time is told by the machine's steady clock, whoever stood still meanwhile: a
hand feels a pause of the process that applies forces as it feels one of the process that sends
them.
"""

from __future__ import annotations

import math

from haptic_accel.core.model import Vector

IN_TIME = 0.25
"""Longest time from its due time until a force takes effect that is in time, periods.

So long the force before acts in its place. Were every force that late, the phase at a tenth of the
sampling rate would lag by 9 degrees, an error of 16 %. A smaller limit would count what waking,
sampling and writing take: 0.16 periods at 1 kHz (median, five processes on two shared cores).
"""

MISSED_SHARE = 0.001
"""Share of missed deadlines up to which a rate counts as held."""

STRAGGLING = 20
"""Samples by which a force may be overtaken by later ones on its way."""

PAST_TICK, LONGEST, LATE_TIME = "past their tick", "longest lateness (us)", "late (s)"
"""Ends of the names of counts in diagnostics, behind the kind of force."""

Caused = tuple[int, Vector]
"""Stamp of the sample that caused a force, ns, and the force, N."""


class DueForces:
    """Commands of one kind, from their reception until they are applied.

    Ticks and samples are counted by the points of the sampling grid.

    Parameters
    ----------
    latency : int
        Samples from the one that caused a force to the tick at which it is due; 0 for on arrival.
    period : float
        Time between two points of the grid, of which point 0 is at 0 s of the steady clock, s.

    Attributes
    ----------
    due, missed, past_tick : int
        Number of forces that had a due time; of these, in effect later than `IN_TIME` allows, and
        received after their tick was carried out.
    longest : float
        Longest time from the due time of a force until it took effect, s.
    late_time : float
        Time in which a force that was missed was due but not yet in effect, s.
    newest : int or None
        Number of the latest sample whose force was received.

    Examples
    --------
    >>> forces = DueForces(latency=1, period=1e-3)
    >>> forces.put(7, 7_000_000, (0.0, 0.0, 0.5))
    >>> forces.take(7), forces.take(8)
    (None, (7000000, (0.0, 0.0, 0.5)))
    >>> forces.took_effect(12e-3)
    >>> forces.missed, round(forces.longest, 6)
    (1, 0.004)
    """

    def __init__(self, latency: int, period: float) -> None:
        self._latency = latency
        self._period = period
        self._waiting: dict[int, Caused] = {}
        self._out_of_date: Caused | None = None
        self._carried_out = self._last = -math.inf
        self._taken: list[int] = []
        self._late_until = 0.0
        self.newest: int | None = None
        self.due = self.missed = self.past_tick = 0
        self.longest = self.late_time = 0.0

    def put(self, sample: int, stamp: int, force: Vector) -> None:
        """Keep a force until it is due; a straggler, older than the last applied, is dropped."""
        due = sample + self._latency
        if self._latency:
            self.due += 1
            self.past_tick += due <= self._carried_out
        if self.newest is None or sample > self.newest:
            self.newest = sample
        # A far older one is no straggler: the safety layer refuses it, and says so.
        if not 0 <= self._last - due <= STRAGGLING:
            self._waiting[due] = stamp, force
        else:
            self._taken.append(due)

    def pass_on(self, stamp: int, force: Vector) -> None:
        """Pass a force that is out of date to the next `take`, for the safety layer to refuse it.

        If it were kept, one of the future would be in time some day.
        """
        self._out_of_date = stamp, force

    def take(self, tick: int, *, ahead: bool = False) -> Caused | None:
        """Return the newest force that is due at a tick or was before; None if there is none.

        One that is out of date counts only where no other is due. A tick that is taken `ahead` has
        not been carried out.
        """
        if not ahead:
            self._carried_out = tick
        found, self._out_of_date = self._out_of_date, None
        waiting = self._waiting
        while waiting and (earliest := min(waiting)) <= tick:
            found = waiting.pop(earliest)
            self._last = earliest
            self._taken.append(earliest)
        return found

    def took_effect(self, now: float) -> None:
        """Note the steady time in s at which the forces taken last took effect, or were left out.

        Forces taken ahead are in time with any device that applies them by a clock of its own.
        """
        if not self._taken:
            return
        for due in sorted(self._taken) if self._latency else ():
            time = due * self._period
            lateness = now - time
            if lateness > self.longest:
                self.longest = lateness
            if lateness > IN_TIME * self._period:
                self.missed += 1
                # Of several that waited at the same time, that time counts once.
                self.late_time += max(0.0, now - max(time, self._late_until))
                self._late_until = now
        self._taken.clear()

    def status(self) -> dict[str, str]:
        """Return the counts but `missed`, for diagnostics."""
        return {
            "due": str(self.due),
            PAST_TICK: str(self.past_tick),
            LONGEST: f"{self.longest * 1e6:.0f}",
            LATE_TIME: f"{self.late_time:.6f}",
        }

    def clear(self) -> None:
        """Drop the forces that wait."""
        self._waiting.clear()
        self._out_of_date = None

    def count_anew(self) -> None:
        """Set the counts to zero."""
        self.due = self.missed = self.past_tick = 0
        self.longest = self.late_time = 0.0

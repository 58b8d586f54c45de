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

"""Queue of forces with due ticks.

A force is due a whole number of samples after the sample that caused it. A controller can invert a
constant delay of a plant, but not a varying delay. The machine's monotonic clock decides whether a
force was in time. Pauses of the sending and of the applying process both count, as a hand feels
them alike.
"""

from __future__ import annotations

import math

from haptic_accel.core.model import Vector

IN_TIME = 0.25
"""Maximum delay of a force beyond its due time that counts as in time, in periods.

During the delay the previous force acts. If every force were that late, the phase at a tenth of
the sampling rate would lag by 9 degrees, an error of 16 %. A smaller limit would count normal
waking, sampling and writing: 0.16 periods at 1 kHz (median, five processes on two shared cores).
"""

MISSED_SHARE = 0.001
"""Maximum fraction of missed deadlines for a rate that counts as kept."""

STRAGGLING = 20
"""Maximum number of samples by which a force may be overtaken."""

PAST_TICK, LONGEST, LATE_TIME = "past their tick", "longest lateness (us)", "late (s)"
"""Suffixes of counts in diagnostics, after the kind of force."""

CompensatedSample = tuple[int, Vector]
"""Stamp of the sample that caused a force, ns, and the force, N."""


class DueForces:
    """Commands of one kind, from reception until they are applied.

    Ticks and samples are numbered by the points of the sampling grid.

    Parameters
    ----------
    latency : int
        Delay from sample to force, in samples; 0 for immediate application.
    period : float
        Period of the grid, s; point 0 is at 0 s of the monotonic clock.

    Attributes
    ----------
    due, missed, past_tick : int
        Numbers of forces: with a due time; in effect later than `IN_TIME` allows; received after
        their tick.
    longest : float
        Maximum delay of a force beyond its due time, s.
    late_time : float
        Total time for which missed forces were due but not yet in effect, s.
    newest : int or None
        Number of the newest sample whose force was received.

    Examples
    --------
    >>> forces = DueForces(latency=1, period=1e-3)
    >>> forces.put(7, 7_000_000, (0.0, 0.0, 0.5))
    >>> forces.pop(7), forces.pop(8)
    (None, (7000000, (0.0, 0.0, 0.5)))
    >>> forces.took_effect(12e-3)
    >>> forces.missed, round(forces.longest, 6)
    (1, 0.004)
    """

    def __init__(self, latency: int, period: float) -> None:
        self._latency = latency
        self._period = period
        self._waiting: dict[int, CompensatedSample] = {}
        self._out_of_date: CompensatedSample | None = None
        self._carried_out = self._last = -math.inf
        self._taken: list[int] = []
        self._late_until = 0.0
        self.newest: int | None = None
        self.due = self.missed = self.past_tick = 0
        self.longest = self.late_time = 0.0

    def put(self, sample: int, stamp: int, force: Vector) -> None:
        """Store a force until due; discard a force older than the last applied force."""
        due = sample + self._latency
        if self._latency:
            self.due += 1
            self.past_tick += due <= self._carried_out
        if self.newest is None or sample > self.newest:
            self.newest = sample
        # A much older force was not overtaken: the safety layer rejects and reports it.
        if not 0 <= self._last - due <= STRAGGLING:
            self._waiting[due] = stamp, force
        else:
            self._taken.append(due)

    def pass_on(self, stamp: int, force: Vector) -> None:
        """Pass an outdated force to the next `pop`, so that the safety layer rejects it.

        A stored force from the future would be in time later.
        """
        self._out_of_date = stamp, force

    def pop(self, tick: int, *, ahead: bool = False) -> CompensatedSample | None:
        """Return the newest force that is due at a tick or earlier; None if there is none.

        An outdated force is returned only if no other is due. `ahead` means that the tick has not
        been executed yet.
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
        """Record the monotonic time in s at which the last forces took effect or were skipped.

        Forces taken ahead count as in time if the device's clock applies them.
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
                # Time in which several forces waited counts once.
                self.late_time += max(0.0, now - max(time, self._late_until))
                self._late_until = now
        self._taken.clear()

    def diagnostics(self) -> dict[str, str]:
        """Return all counts except `missed`, for diagnostics."""
        return {
            "due": str(self.due),
            PAST_TICK: str(self.past_tick),
            LONGEST: f"{self.longest * 1e6:.0f}",
            LATE_TIME: f"{self.late_time:.6f}",
        }

    def clear(self) -> None:
        """Discard the waiting forces."""
        self._waiting.clear()
        self._out_of_date = None

    def count_anew(self) -> None:
        """Reset the counts to zero."""
        self.due = self.missed = self.past_tick = 0
        self.longest = self.late_time = 0.0

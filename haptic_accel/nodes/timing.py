# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ticks and arrivals by the machine's clocks; priorities and timers of processes (without ROS)."""

from __future__ import annotations

import ctypes
import math
import os
import resource
import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import cache

from haptic_accel.core.process import REALTIME
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick.device_side import FLOWING, IN_TIME
from haptic_accel.core.tick.histogram import DurationHistogram

FORCES_TIME, RECEIVING_TIME = 60e-6, 50e-6
"""Time for each device of a process from the beginning of a tick until its forces are written, s,
and further time for each kind of force that comes as messages: a tick begins so much ahead of the
grid point at which they are due, as far as `LARGEST_LEAD` allows. Samples are taken as much
earlier, so that nothing between them and forces changes."""

FOUND_AT_ONCE = 0.9
"""Share of ticks whose messages are there at the first look."""

EARLIEST_LOOK = 0.3e-3
"""Time of the first look after the grid point until it is known better, s."""

ARRIVAL_STEP = 20e-6
"""Increase of the time of the first look after one that came too early, s; after others it shrinks
by a ninth of that, and so settles where `FOUND_AT_ONCE` find all."""

LOOKS = 5
"""Most looks in a period for what a tick still needs: more would take processor time just when
there is too little."""

CATCH_UP = 0.1
"""Longest time without a tick whose grid points are served afterwards, s; arms let go by then."""

BEHIND = 0.3
"""Longest time from one tick in time to the next, s: a process that needs longer cannot hold the
rate, and leaves out the grid points that wait rather than stay behind."""

LARGEST_LEAD = 0.2
"""Largest time that a tick may begin before its grid point, periods."""

CHOICES = ((8000, 8, 1.5), (4000, 4, 1.5), (2000, 2, 2.0), (1000, 1, 0.0), (500, 1, 0.0))
"""Documented rates, Hz, with their frames and, for frames, latencies, ms: docs/real_time.md."""

HELD = 0.6
"""Largest share of a period for the work of a tick at a rate that is held: the rest is for waking,
requests, and ticks that take longer than most."""

SHORT = 5_000
"""Duration of a reading of two clocks up to which they count as read together, ns."""

READINGS = 5
"""Most readings of the clocks, of which the shortest counts."""

SLEEPS, SLEEP = 20, 1e-3
"""Number and length in s of the sleeps that measure the time to wake a thread."""


class RateKeeper:
    """Ticks on an absolute grid: whole multiples of the period on the machine's steady clock.

    All nodes of a machine with one rate tick together, like the paper's single servo loop. A late
    tick does not shift later ticks. Missed grid points are served afterwards in their order, for
    `CATCH_UP` at most.

    Parameters
    ----------
    rate : float
        Ticks per second.
    clock : callable
        Steady time in ns.
    lead : float
        Time by which a tick may begin early, s: the time to wake a thread.
    frame : int
        Number of grid points that are served together, at the last of them: a whole multiple.

    Attributes
    ----------
    ticks, late, missed : int
        Grid points served; those of frames served later than half a frame; those skipped.
    lateness, work : DurationHistogram
        Lateness of the frames, and time of their work by grid point.
    framed : bool
        True if the devices may be served in frames.
    told : bool
        True once it was told that the rate is not held.

    Examples
    --------
    >>> keeper = RateKeeper(4000.0, lambda: 2_100_000, frame=4)
    >>> keeper.due(), keeper.next
    (None, 0.003)
    """

    def __init__(
        self,
        rate: float,
        clock: Callable[[], int] = time.monotonic_ns,
        lead: float = 0.0,
        frame: int = 1,
    ) -> None:
        self._period = NANOSECONDS / rate
        self._clock, self._frame = clock, frame
        self._lead = min(lead * NANOSECONDS, LARGEST_LEAD * self._period)
        self._most, self._longest = (
            frame * max(1, round(span * rate / frame)) for span in (CATCH_UP, BEHIND)
        )
        self._next = self._newest(clock()) + frame
        self._in_time = self._next - 1
        self._gaps: defaultdict[str, float] = defaultdict(float)
        self.ticks = self.late = self.missed = self._begun = 0
        self.lateness, self.work = DurationHistogram(), DurationHistogram()
        self.framed = self.told = False

    @property
    def period(self) -> float:
        """Period, s."""
        return self._period / NANOSECONDS

    @property
    def next(self) -> float:
        """Steady time at which to call `due`, s."""
        return (self._next * self._period - self._lead) / NANOSECONDS

    def time(self, tick: int) -> int:
        """Return the steady time of a grid point, ns."""
        return round(tick * self._period)

    def due(self) -> int | None:
        """Return the last grid point of the next frame once, if its time has come."""
        now = self._clock()
        newest = self._newest(now)
        if newest < self._next:
            return None
        if newest == self._next:
            self._in_time = newest
        behind = newest - self._in_time > self._longest
        tick = newest if behind else max(self._next, newest + self._frame - self._most)
        self.missed += tick - self._next
        lateness = now - tick * self._period
        self.lateness.add(lateness / NANOSECONDS)
        if lateness > self._frame * self._period / 2:
            self.late += self._frame
        gap = now - self._next * self._period
        for reader, longest in self._gaps.items():
            if gap > longest:
                self._gaps[reader] = gap
        self.ticks += self._frame
        self._next = tick + self._frame
        self._begun = now
        return tick

    def done(self) -> None:
        """Take note of the time that the last frame has taken."""
        self.work.add((self._clock() - self._begun) / NANOSECONDS / self._frame)

    def better(self, age: float = 0.0, latency: int = 1) -> str:
        """Return arguments of a rate that would be held at the measured time of a tick.

        The other arguments and the result are those of `rate_that_holds`.
        """
        cost, rate = self.work.quantile(0.5), round(1.0 / self.period)
        return rate_that_holds(cost, rate, self._frame, self.framed, age, latency)

    def _newest(self, now: int) -> int:
        """Return the last grid point of the newest frame at a time in ns."""
        return math.floor((now + self._lead) / self._period) // self._frame * self._frame

    def pop_longest_gap(self, reader: str) -> float:
        """Return the largest lateness of a tick since a reader's last call, s; 0 at the first."""
        gap, self._gaps[reader] = self._gaps[reader], 0.0
        return gap / NANOSECONDS


def rate_that_holds(
    cost: float, rate: float, frame: int, framed: bool, age: float = 0.0, latency: int = 1
) -> str:
    """Return the arguments of the highest documented rate that is held; empty if none is.

    Parameters
    ----------
    cost : float
        Time of the work of a tick, s.
    rate, frame : float, int
        Rate that is not held, Hz, and its frame.
    framed : bool
        True if frames are possible.
    age : float
        Time from sample to force of late forces, s; 0 if they are in time.
    latency : int
        Time from sample to force without frames, in samples.

    Examples
    --------
    >>> rate_that_holds(130e-6, 8000.0, 1, framed=True)
    'rate:=4000 frame:=4 latency:=1.5ms'
    >>> rate_that_holds(130e-6, 1000.0, 1, framed=True, age=2.2e-3)
    'rate:=500'
    """
    for other, samples, milliseconds in CHOICES:
        in_frames = framed and samples > 1
        lag = 1e-3 * milliseconds * other if in_frames else latency
        is_lower = (other, -samples * framed) < (rate, -frame)
        if is_lower and other * cost <= HELD and other * age <= lag + IN_TIME:
            return f"rate:={other}" + f" frame:={samples} latency:={milliseconds:g}ms" * in_frames
    return ""


class ArrivalKeeper:
    """Looks for each tick's messages at their expected time, and again until they come.

    Sleeping until then takes half the processor time of waking at each message.

    Parameters
    ----------
    rate : float
        Ticks per second.
    clock : callable
        Steady time in s.
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._period = 1 / rate
        self._clock = clock
        self._offset = min(EARLIEST_LOOK, self._period / 2)
        self._silence = FLOWING * self._period
        self._found = -math.inf
        self._next = 0.0
        self._first = True

    def polled(self, *, found: bool) -> float:
        """Return the steady time of the next look, s; the last look found all or not."""
        now = self._clock()
        if found:
            self._found = now
            if now >= self._next and self._first:
                self._offset -= ARRIVAL_STEP * (1 - FOUND_AT_ONCE)
        elif now < self._next:
            return self._next
        elif now - self._found < self._silence:
            if self._first:
                self._first = False
                self._offset += ARRIVAL_STEP * FOUND_AT_ONCE
            return now + self._period / LOOKS
        self._offset %= self._period
        self._next = (math.floor((now - self._offset) / self._period) + 1) * self._period
        self._next += self._offset
        self._first = True
        return self._next


@cache
def wake_time() -> float:
    """Measure, once in a process, the usual time to wake a sleeping thread on this machine, s."""
    late = []
    for _ in range(SLEEPS):
        due = time.monotonic() + SLEEP
        time.sleep(SLEEP)
        late.append(time.monotonic() - due)
    return statistics.median(late)


def system_time(steady: int) -> int:
    """Convert steady time in ns to system time in ns since 1970.

    Stamps are system time, which is comparable between machines. The offset is read at each call,
    because only system time is adjusted.
    """
    shortest = math.inf
    offset = 0
    for _ in range(READINGS):
        before, system, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if after - before < shortest:
            shortest, offset = after - before, system - (before + after) // 2
        if shortest < SHORT:
            break
    return offset + steady


LONGEST_RUN = 1_000_000
"""Time that a real-time thread may run without a pause, us, before the kernel ends its process
(with SIGXCPU): a fault in a node must not block the machine."""

RECORDING_PRIORITY, FORCE_PRIORITY, FELT_PRIORITY = 30, 40, 41
"""Real-time priorities, below the kernel's own threads at 50. Nodes that make forces have the
same, so that none interrupts another, but for the compensator: it may interrupt the others, whose
work for a tick can wait, for its force is due at the next. The recorder, which delays none of
them, must not wait for ordinary programs: messages would be lost."""

PR_SET_TIMERSLACK = 29
"""From linux/prctl.h."""


def sharpen_timers() -> None:
    """Set the timer slack to its minimum; the default, 50 us, was half of the lateness."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


def ask_for_realtime(priority: int = FORCE_PRIORITY) -> bool:
    """Request real-time priority for this process, if the system allows it.

    Call it after set-up, which would otherwise take the cores from running nodes. It applies to
    all threads that exist by then, including the middleware's.

    Returns
    -------
    bool
        The priority was granted.
    """
    if os.environ.get(REALTIME) == "no" or not hasattr(os, "sched_setscheduler"):
        return False
    try:
        if priority >= FORCE_PRIORITY:  # the recorder may write to a slow disk for longer
            resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN, 2 * LONGEST_RUN))
        schedule(os.SCHED_FIFO, priority)
    except OSError:
        return False
    return True


def schedule(policy: int, priority: int) -> None:
    """Give every thread of this process a scheduling policy and a priority.

    Threads that a library made real-time itself, as JACK's of its client, stay as they are.
    """
    own = 0, RECORDING_PRIORITY, FORCE_PRIORITY, FELT_PRIORITY
    for thread in map(int, os.listdir("/proc/self/task")):
        with suppress(ProcessLookupError):  # one that has just ended
            if os.sched_getparam(thread).sched_priority in own:
                os.sched_setscheduler(thread, policy, os.sched_param(priority))


def scheduling_class() -> str:
    """Return the scheduling class of this thread, for diagnostics."""
    if not hasattr(os, "sched_getscheduler"):
        return "unknown"
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        return f"real-time {os.sched_getparam(0).sched_priority}"
    return f"shared, niceness {os.nice(0)}"

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ticks and arrivals by the machine's clocks; priorities and timers of processes (without ROS).

``python -m haptic_accel.nodes.timing RATE SECONDS`` runs an empty loop on the sampling grid with
the priority of a node, which measures the machine's lateness without any node, and prints its
result as JSON.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

from haptic_accel.core.process import REALTIME, module_command
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick.device_side import FLOWING, IN_TIME
from haptic_accel.core.tick.watching import DurationHistogram

FORCES_TIME, RECEIVING_TIME = 60e-6, 50e-6
"""Time per device of a process from the start of a tick until its forces are written, s, and
additional time per kind of force received as messages. A tick starts this much before the grid
point at which the forces are due, within `LARGEST_LEAD`. Samples are taken equally early, so that
the time from sample to force is unchanged."""

FOUND_AT_ONCE = 0.9
"""Fraction of ticks whose messages have arrived at the first poll."""

EARLIEST_POLL = 0.3e-3
"""Initial time from the grid point to the first poll, s; adapted later."""

ARRIVAL_STEP = 20e-6
"""Increase of the time of the first poll after one that was too early, s. After any other poll the
time falls by a ninth of that, so that it settles where `FOUND_AT_ONCE` of the polls find all
messages."""

LOOKS = 5
"""Maximum number of polls per period for missing messages of a tick; more would take processor
time when it is scarce."""

CATCH_UP = 0.1
"""Longest gap whose missed grid points are still served afterwards, s; arms disengage by then."""

BEHIND = 0.3
"""Longest time from one punctual tick to the next, s. A process that needs longer cannot hold the
rate, and skips the waiting grid points rather than stay late."""

LARGEST_LEAD = 0.2
"""Longest time that a tick may start before its grid point, periods."""

CHOICES = ((8000, 8, 1.5), (4000, 4, 1.5), (2000, 2, 2.0), (1000, 1, 0.0), (500, 1, 0.0))
"""Documented rates, Hz, with their frames and, for frames, latencies, ms: docs/real_time.md."""

HELD = 0.6
"""Largest fraction of a period for the work of a tick at a rate that can be held; the rest is for
waking, requests, and ticks that take longer than most."""

SHORT = 5_000
"""Longest duration of a reading of two clocks that counts as simultaneous, ns."""

READINGS = 5
"""Maximum number of readings of the clocks; the shortest one is used."""

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
        Number of grid points served together, at the last of them, whose index is a multiple of
        `frame`.

    Attributes
    ----------
    ticks, late, missed : int
        Number of grid points served; of those served more than half a frame late; of those
        skipped.
    lateness, work : DurationHistogram
        Lateness of the frames, and working time per grid point.
    framed : bool
        True if the devices may be served in frames.
    is_warned : bool
        True once a log message has said that the rate is not held.

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
        self.ticks = self.late = self.missed = self._start = 0
        self.lateness, self.work = DurationHistogram(), DurationHistogram()
        self.framed = self.is_warned = False

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
        """Return the last grid point of the next frame once it is due; None before."""
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
        self._start = now
        return tick

    def done(self) -> None:
        """Record the working time of the last frame."""
        self.work.add((self._clock() - self._start) / NANOSECONDS / self._frame)

    def better(self, age: float = 0.0, latency: int = 1) -> str:
        """Return the arguments of a rate that the measured time of a tick allows.

        Parameters and result are as for `rate_that_holds`.
        """
        cost, rate = self.work.quantile(0.5), round(1.0 / self.period)
        return rate_that_holds(cost, rate, self._frame, self.framed, age, latency)

    def _newest(self, now: int) -> int:
        """Return the last grid point of the newest frame at a time in ns."""
        return math.floor((now + self._lead) / self._period) // self._frame * self._frame

    def pop_longest_gap(self, reader: str) -> float:
        """Return the largest lateness of a tick since a reader's last call, s; 0 at first."""
        gap, self._gaps[reader] = self._gaps[reader], 0.0
        return gap / NANOSECONDS


def rate_that_holds(
    cost: float, rate: float, frame: int, framed: bool, age: float = 0.0, latency: int = 1
) -> str:
    """Return the arguments of the highest documented rate that can be held; empty if none can.

    Parameters
    ----------
    cost : float
        Working time of a tick, s.
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
    """Schedule of polls for a tick's messages: at their expected time, and until they arrive.

    Sleeping until the expected time takes half the processor time of waking at each message.

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
        self._offset = min(EARLIEST_POLL, self._period / 2)
        self._silence = FLOWING * self._period
        self._found = -math.inf
        self._next = 0.0
        self._first = True

    def polled(self, *, found: bool) -> float:
        """Return the steady time of the next poll, s; `found`: the last one found all."""
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

RECORDING_PRIORITY, FORCE_PRIORITY, COIL_PRIORITY = 30, 40, 41
"""Real-time priorities, below the kernel's own threads at 50. Nodes that compute forces share one
priority, so that none interrupts another. Only the compensator may interrupt the others: its force
is due at the next tick, while their work can wait. The recorder delays no force, but must not wait
for ordinary programs, as messages would be lost."""

PR_SET_TIMERSLACK = 29
"""Option of prctl that sets the timer slack (linux/prctl.h)."""


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
        if priority >= FORCE_PRIORITY:  # not the recorder, which may wait for a slow disk
            resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN, 2 * LONGEST_RUN))
        schedule(os.SCHED_FIFO, priority)
    except OSError:
        return False
    return True


def schedule(policy: int, priority: int) -> None:
    """Give every thread of this process a scheduling policy and a priority.

    Threads that a library has made real-time itself, such as JACK's, are not changed.
    """
    own = 0, RECORDING_PRIORITY, FORCE_PRIORITY, COIL_PRIORITY
    for thread in map(int, os.listdir("/proc/self/task")):
        with suppress(ProcessLookupError):  # the thread has just ended
            if os.sched_getparam(thread).sched_priority in own:
                os.sched_setscheduler(thread, policy, os.sched_param(priority))


def scheduling_class() -> str:
    """Return the scheduling class of this thread, for diagnostics."""
    if not hasattr(os, "sched_getscheduler"):
        return "unknown"
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        return f"real-time {os.sched_getparam(0).sched_priority}"
    return f"shared, niceness {os.nice(0)}"


STARTING_TIME = 30.0
"""Longest time for the process to start and end on a busy machine, s."""


def empty_loop(rate: float, seconds: float) -> dict[str, Any]:
    """Run the loop in a separate process.

    Parameters
    ----------
    rate : float
        Ticks per second, Hz.
    seconds : float
        Length, s.

    Returns
    -------
    dict
        ``{"missed": n, "of": n, "lateness_us": {"p50": ..., "max": ...}}``: number of ticks that
        started too late for a force in time (`IN_TIME`), all ticks, lateness.

    Raises
    ------
    RuntimeError
        The process did not start or end.
    """
    command = [*module_command(__name__), str(rate), str(seconds)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=seconds + STARTING_TIME, check=True
        )
    except (subprocess.SubprocessError, OSError) as error:
        raise RuntimeError(f"empty loop: {error}") from None
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def run_empty_loop(rate: float, seconds: float) -> dict[str, Any]:
    """Run the loop in this process; see `empty_loop`."""
    sharpen_timers()
    lead = wake_time()
    ask_for_realtime()
    keeper = RateKeeper(rate, lead=lead)
    missed = 0
    while keeper.ticks + keeper.missed < rate * seconds:
        time.sleep(max(0.0, keeper.next - time.monotonic()))
        late = time.monotonic() - IN_TIME * keeper.period
        while (tick := keeper.due()) is not None:
            missed += keeper.time(tick) / NANOSECONDS < late
    lateness = {name: 1e6 * value for name, value in keeper.lateness.summary().items()}
    of = keeper.ticks + keeper.missed
    return {"missed": missed + keeper.missed, "of": of, "lateness_us": lateness}


if __name__ == "__main__":
    print(json.dumps(run_empty_loop(*map(float, sys.argv[1:]))))

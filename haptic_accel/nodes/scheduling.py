"""Running a node: executor, timing, signals, parent, garbage collection, exit status."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import (
    CUT_SHORT,
    DONE,
    EXECUTOR,
    FAILED,
    REALTIME,
    SUPERVISOR,
    WRONG_ARGUMENTS,
)
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.devices import DeviceError
from haptic_accel.nodes.middleware import middleware_defaults

try:
    from rclpy.executors import EventsExecutor  # ROS 2 Lyrical and newer
except ImportError:
    from rclpy.experimental import EventsExecutor

EXECUTORS = {"events": EventsExecutor, "default": SingleThreadedExecutor}
"""Executors by name; `default` is for comparison and several times slower."""


LOOK_ROUND = 0.25
"""Interval between checks for signals and the parent while no message comes, s.

A deadline is needed at all because the events executor of the binary wheels, which were
built for glibc 2.28, neither sleeps nor delivers when it waits without one.
"""

TIMER_OFFSET = 50e-6
"""Largest offset from the grid at which a timer may start, s: about the time to create one."""

TIMER_TRIES = 50

WAKES = 2
"""Number of threads that wake before a timer's callback runs: the executor's two."""

FOLLOW = 50e-6
"""Offset behind the grid of the timer that runs second in a shared process, s."""

LARGEST_SHIFT = 0.2
"""Largest offset from the grid that a timer may have, periods; `RateKeeper.tick` allows 0.25."""

LONGEST_RUN = 1_000_000
"""Time that a real-time thread may run without a pause, us, before the kernel ends its process
(with SIGXCPU): a fault in a node must not block the machine."""

SLEEPS, SLEEP = 20, 1e-3
"""Number and length in s of the sleeps that measure the time to wake a thread."""

FORCE_PRIORITY = 40
"""Real-time priority of nodes that make forces: the same for all, so that none interrupts
another, and below the kernel's own threads at 50."""

TEARDOWN = 3
"""Time allowed for shutting the middleware down, s."""

PR_SET_TIMERSLACK = 29
"""From linux/prctl.h."""


class RateKeeper:
    """Ticks on an absolute grid: whole multiples of the period on the machine's steady clock.

    All nodes of a machine at one rate tick together, as the paper's single servo loop did; a
    late tick shifts no later one; missed ticks are counted and not made up for.

    Parameters
    ----------
    rate : float
        Ticks per second.
    clock : callable
        Steady time in ns.

    Attributes
    ----------
    ticks, late, missed : int
        Ticks kept; of these, later than half a period; grid points without a tick.
    lateness : DurationHistogram
        Lateness of the ticks kept, from the first grid point not served before.
    """

    def __init__(self, rate: float, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._period = NANOSECONDS / rate
        self._clock = clock
        self._last: int | None = None
        self.ticks = self.late = self.missed = 0
        self._longest_gap = 0
        self.lateness = DurationHistogram()

    @property
    def period(self) -> float:
        """Period, s."""
        return self._period / NANOSECONDS

    def wait_for_grid(self, lead: float = 0.0) -> None:
        """Return just after a grid point, or `lead` s before: the moment to start a timer on."""
        ahead = lead * NANOSECONDS
        start = self._index(self._clock() + ahead)
        while self._index(self._clock() + ahead) == start:
            time.sleep(0)

    def lateness_now(self, lead: float = 0.0) -> float:
        """Return the time since the last grid point, or since `lead` s before it, s."""
        now = self._clock() + lead * NANOSECONDS
        return (now - self._index(now) * self._period) / NANOSECONDS

    def tick(self) -> int | None:
        """Note that the timer fired.

        Returns
        -------
        int or None
            The grid point it is for, steady time in ns; None when that one had its tick.
        """
        now = self._clock()
        # A timer may fire a little early, never by half a period.
        index = self._index(now + self._period / 4)
        first = index if self._last is None else self._last + 1
        if index < first:
            return None
        self.missed += index - first
        self._longest_gap = max(self._longest_gap, index - first)
        self._last = index
        self.ticks += 1
        # Counted from the first grid point that waited, so that a stall shows its length.
        lateness = now - first * self._period
        self.lateness.add(lateness / NANOSECONDS)
        if lateness > self._period / 2:
            self.late += 1
        return round(index * self._period)

    def take_longest_gap(self) -> float:
        """Return the longest time without a tick since the last call, s."""
        gap, self._longest_gap = self._longest_gap, 0
        return gap * self.period

    def _index(self, now: float) -> int:
        return math.floor(now / self._period)


def start_timer(
    node: Node, rate_keeper: RateKeeper, callback: Callable[[], None], *, first: bool = True
) -> Any:
    """Start a timer on a rate keeper's grid.

    Parameters
    ----------
    first : bool
        Aim ahead of the grid, by the time to wake; otherwise `FOLLOW` after it, so that the
        second of two ticks for one grid point finds a core and the interpreter free.
    """
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    lead = WAKES * wake_time() if first else -FOLLOW
    limit = LARGEST_SHIFT * rate_keeper.period
    lead = min(max(lead, -limit), limit)
    for _ in range(TIMER_TRIES):
        rate_keeper.wait_for_grid(lead)
        timer = node.create_timer(rate_keeper.period, callback, clock=clock)
        if rate_keeper.lateness_now(lead) <= TIMER_OFFSET:
            return timer
        # The process was held up just here; all ticks would be late by as much.
        node.destroy_timer(timer)
    return node.create_timer(rate_keeper.period, callback, clock=clock)


def wake_time() -> float:
    """Measure the shortest time to wake a sleeping thread on this machine, s."""
    late = []
    for _ in range(SLEEPS):
        due = time.monotonic() + SLEEP
        time.sleep(SLEEP)
        late.append(time.monotonic() - due)
    return min(late)


def system_time(steady: int) -> int:
    """Return the system time, in ns since 1970, of a moment of steady time in ns.

    Stamps are system time, so that they compare between machines; taken anew each time,
    because system time is adjusted while steady time runs on.
    """
    return time.time_ns() - (time.monotonic_ns() - steady)


class SupervisedNode(Node):
    """A node that can end by itself and be closed."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.finished: Future = Future()
        """Its result is set when the node's task is done."""

    def finish(self, line: str = "") -> None:
        """Note, once, that the node's task is done, with a line for the log if there is one."""
        if not self.finished.done():
            if line:
                self.get_logger().info(line)
            self.finished.set_result(None)

    def close(self) -> None:
        """Release everything; called once, whatever ended the node."""


Build = Callable[[], SupervisedNode]


def run(name: str, *builds: Build, niceness: int = 0) -> None:
    """Run nodes until a signal, the end of their parent, or of one of them; then exit.

    Parameters
    ----------
    name : str
        Name in messages.
    builds : callables
        Functions that make the nodes, which share this process and its executor.
    niceness : int
        Niceness of a process that must not delay the forces; 0 to request real-time priority.
    """
    # Before the middleware starts its threads, which inherit it.
    os.nice(niceness)
    os.environ.update(middleware_defaults(os.environ))
    sharpen_timers()
    # This is the one place where signals are handled: rclpy installs none, no node does.
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    # Who started us may be gone before we get here; a supervisor therefore says who it is.
    parent = int(os.environ.get(SUPERVISOR, os.getppid()))

    def ended() -> bool:
        return bool(signals) or os.getppid() != parent

    status = _status(builds, name, not niceness, ended)
    # A second signal (launch sends one after the terminal's own) must not fail an end that is
    # under way: Python's own end would put the default back, but leaves what is ignored.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _status(builds: Sequence[Build], name: str, realtime: bool, ended: Callable[[], bool]) -> int:
    wrong = (ParameterError, InvalidParameterException)
    try:
        _run(builds, realtime, ended)
    except (*wrong, DeviceError, OSError) as error:
        print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr, flush=True)
        return WRONG_ARGUMENTS if isinstance(error, wrong) else FAILED
    return DONE


def _run(builds: Sequence[Build], realtime: bool, ended: Callable[[], bool]) -> None:
    nodes: list[SupervisedNode] = []
    well = False
    try:
        try:
            _take_arguments()
            nodes.extend(build() for build in builds)
        except RuntimeError as error:
            # rcl's errors have no public type; those of a command line all say what it is.
            if any(word in str(error) for word in ("ROS arguments", "param")):
                raise ParameterError(str(error)) from error
            raise
        if realtime:
            ask_for_realtime()
        _spin(nodes, ended)
        well = True
    finally:
        _close(nodes, well)


def _take_arguments() -> None:
    """Initialise ROS from the command line, and refuse other words."""
    unknown = remove_ros_args(sys.argv)[1:]
    if unknown:
        raise ParameterError(f"{unknown[0]}: no such argument; use --ros-args -p name:=value")
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)


def _close(nodes: Sequence[SupervisedNode], well: bool) -> None:
    """Close every node, whatever the others do, then the middleware; after a failure or not."""
    with ExitStack() as stack:
        for node in nodes:
            stack.callback(node.close)
    # Once in some hundred ends under load the middleware does not come back from being torn
    # down, or aborts ("pure virtual method called"). By now nothing is left that could be lost.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(TEARDOWN)
    if well:  # an abort must not hide a failure
        # Python's own handlers run too late for an abort: C's _exit, the signal as the status.
        libc = ctypes.CDLL(None)
        libc.signal(CUT_SHORT, libc._exit)
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def _spin(nodes: Sequence[SupervisedNode], ended: Callable[[], bool]) -> None:
    executor = EXECUTORS[os.environ.get(EXECUTOR, "events")]()
    for node in nodes:
        executor.add_node(node)
    # Everything made so far stays; without garbage there is nothing to collect, and a
    # collection would take milliseconds at the wrong moment.
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        while not (any(node.finished.done() for node in nodes) or ended()):
            executor.spin_until_future_complete(nodes[0].finished, timeout_sec=LOOK_ROUND)
    finally:
        executor.shutdown()


def sharpen_timers() -> None:
    """Let timers fire when due: the kernel's default slack of 50 us was half of our lateness."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


def ask_for_realtime() -> bool:
    """Request real-time priority for this process, if the system allows it.

    To be called after set-up, which would otherwise take the cores from nodes that run;
    therefore for every thread there is by then, including the middleware's.

    Returns
    -------
    bool
        The priority was granted.
    """
    if os.environ.get(REALTIME) == "no" or not hasattr(os, "sched_setscheduler"):
        return False
    try:
        resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN, 2 * LONGEST_RUN))
        for thread in os.listdir("/proc/self/task"):
            with suppress(ProcessLookupError):  # one that has just ended
                os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(FORCE_PRIORITY))
    except OSError:
        return False
    return True


def scheduling_class() -> str:
    """Return the scheduling class of this thread, for diagnostics."""
    if not hasattr(os, "sched_getscheduler"):
        return "unknown"
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        return f"real-time {os.sched_getparam(0).sched_priority}"
    return f"shared, niceness {os.nice(0)}"

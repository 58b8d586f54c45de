"""How a node is run: executor, timing, signals, parent, garbage collection, exit status."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices import DeviceError
from haptic_accel.startup.files import config_folder

try:
    from rclpy.executors import EventsExecutor  # ROS 2 Lyrical and newer
except ImportError:
    from rclpy.experimental import EventsExecutor

DONE, FAILED, WRONG_ARGUMENTS = 0, 1, 2
"""Exit statuses of every executable."""

NANOSECONDS = 1_000_000_000

MIDDLEWARE = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(config_folder() / "fastdds.xml"),
    "FASTDDS_DEFAULT_PROFILES_FILE": str(config_folder() / "fastdds.xml"),
}
"""Our defaults where the environment says nothing: a graph stays on its machine, and its nodes
find each other quickly (Fast DDS 2 of Jazzy and 3 of Kilted name the file differently)."""

LOOK_ROUND = 0.25
"""Period in s at which signals and the parent are looked after while no message comes.

A deadline is needed at all because the events executor of the binary wheels, which were
built for glibc 2.28, neither sleeps nor delivers when it waits without one.
"""

TEARDOWN = 3
"""Time that the middleware has for its own end, s."""

SUPERVISOR = "HAPTIC_ACCEL_SUPERVISOR"
"""Environment variable with the process id of who started a node."""

PR_SET_TIMERSLACK = 29
"""From linux/prctl.h."""


class RateKeeper:
    """Ticks on an absolute grid: whole multiples of the period on the machine's steady clock.

    All nodes of a machine at one rate tick together, as the paper's single servo loop did; a
    late tick shifts no later one, and what was missed is counted and not made up for.

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
    """

    def __init__(self, rate: float, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._period = NANOSECONDS / rate
        self._clock = clock
        self._last: int | None = None
        self.ticks = self.late = self.missed = 0

    @property
    def period(self) -> float:
        """The period in s."""
        return self._period / NANOSECONDS

    def wait_for_grid(self) -> None:
        """Return just after a grid point: the moment to start a timer on."""
        start = self._index(self._clock())
        while self._index(self._clock()) == start:
            time.sleep(0)

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
        if self._last is not None:
            if index <= self._last:
                return None
            self.missed += index - self._last - 1
        self._last = index
        self.ticks += 1
        due = round(index * self._period)
        if now - due > self._period / 2:
            self.late += 1
        return due

    def _index(self, now: float) -> int:
        return math.floor(now / self._period)


def start_timer(node: Node, rate_keeper: RateKeeper, callback: Callable[[], None]) -> Any:
    """Start a timer on a rate keeper's grid."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    rate_keeper.wait_for_grid()
    return node.create_timer(rate_keeper.period, callback, clock=clock)


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
        """Its result is set when the node has done what it was for."""

    def close(self) -> None:
        """Let go of everything; called once, whatever ended the node."""


def run(build: Callable[[], SupervisedNode], name: str) -> None:
    """Run a node until a signal, the end of its parent, or its own; then exit.

    Parameters
    ----------
    build : callable
        Makes the node.
    name : str
        For messages.
    """
    for variable, value in MIDDLEWARE.items():
        os.environ.setdefault(variable, value)
    _sharpen_timers()
    # This is the one place where signals are handled: rclpy installs none, no node does.
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    # Who started us may be gone before we get here; a supervisor therefore says who it is.
    parent = int(os.environ.get(SUPERVISOR, os.getppid()))

    def ended() -> bool:
        return bool(signals) or os.getppid() != parent

    sys.exit(_status(build, name, ended))


def _status(build: Callable[[], SupervisedNode], name: str, ended: Callable[[], bool]) -> int:
    try:
        unknown = remove_ros_args(sys.argv)[1:]
        if unknown:
            raise ParameterError(f"{unknown[0]}: no such argument; use --ros-args -p name:=value")
        _run(build, ended)
    except (ParameterError, InvalidParameterException) as error:
        return _complaint(name, error, WRONG_ARGUMENTS)
    except (DeviceError, OSError) as error:
        return _complaint(name, error, FAILED)
    return DONE


def _complaint(name: str, error: Exception, status: int) -> int:
    print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr, flush=True)
    return status


def _run(build: Callable[[], SupervisedNode], ended: Callable[[], bool]) -> None:
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = build()
    except Exception as error:
        if "params" in str(error) or "parameter" in str(error):
            # rcl has no exception of its own for a parameter file that cannot be parsed.
            raise ParameterError(str(error)) from error
        raise
    try:
        _spin(node, ended)
    finally:
        node.close()
        # Once in some hundred ends under load the middleware does not come back from being
        # torn down. By now nothing is left that could be lost.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(TEARDOWN)
        node.destroy_node()
        rclpy.try_shutdown()


def _spin(node: SupervisedNode, ended: Callable[[], bool]) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    # Everything made so far stays; without garbage there is nothing to collect, and a
    # collection would take milliseconds at the wrong moment.
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        while not (node.finished.done() or ended()):
            executor.spin_until_future_complete(node.finished, timeout_sec=LOOK_ROUND)
    finally:
        executor.shutdown()


def _sharpen_timers() -> None:
    """Let timers fire when due: the kernel's default slack of 50 us was half of our lateness."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)

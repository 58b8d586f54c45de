# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Execution of nodes: executor, priorities, signals, parent, garbage collection, exit status."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, NoReturn, Protocol

import rclpy
from rclpy.exceptions import InvalidParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from haptic_accel.core import process
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.rclpy_internals import TAKES, EventsExecutor, prepare_logging
from haptic_accel.graph.domain import check_middleware, middleware_defaults
from haptic_accel.nodes.supervised_node import WIRES, SupervisedNode, unblock_standard_streams
from haptic_accel.nodes.timing import FORCE_PRIORITY, ask_for_realtime, schedule, sharpen_timers

POLL_PERIOD = 0.25
"""Interval between checks for signals and the parent while no message comes, s.

A deadline is needed because the events executor of the binary wheels, built for glibc 2.28,
neither sleeps nor delivers when it waits without one.
"""

SERVING_PERIOD = 20e-3
"""Interval between servings of requests and timers for each polling node, s. One is served at a
time; hence the interval is well below the period of the quickest timers, 0.1 s. Sleeping in
between takes half the processor time of waiting with the executor; serving takes 40 us even
without a request."""

SERVING_TIME, LONGEST_UNSERVED = 0.45e-3, 4.0
"""Time to the next work that suffices for serving, s: 99 of 100 servings take less, and a longer
one makes a tick late. Longest interval without serving, in serving periods."""

USUAL, FOLLOWING = 0.9, 0.1
"""Fraction of the usual time to the next work that also suffices: at high rates `SERVING_TIME`
is never available. Weight of the newest value in the running mean that is the usual one."""

STOP_PERIOD = 2e-3
"""Interval between polls for an emergency stop, s; a poll takes 10 us."""

LONGEST_BUSY, BREAK = 0.2, 1e-3
"""Longest time without a sleep while a polling node is late, and length of the sleep after that,
s, so that other programs run even on a slow machine."""

TEARDOWN = 6
"""Time allowed for shutting the middleware down, s."""

ORPHANED, PR_SET_PDEATHSIG = 5, 1
"""Signal by which the kernel reports the end of the parent, SIGTRAP, whose number is also the time
in s after which an orphan is killed. Option of prctl (linux/prctl.h)."""

SUSPENDING = (signal.SIGTSTP, signal.SIGTTOU)
"""Signals by which a terminal suspends a program (Ctrl-Z); a suspended node would hold its forces.
For a launch, only the launch process is suspended, likewise for `teleop`, whose nodes have
separate sessions."""


class Signals:
    """Signals to this process, and the end of its parent.

    Signals are handled here only: neither rclpy nor a node installs handlers.
    """

    def __init__(self) -> None:
        self._ends: list[int] = []
        self._stops: list[int] = []
        for number in process.ENDING:
            # After nohup, ignore a closed terminal.
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, lambda number, _: self._ends.append(number))
        for number in SUSPENDING:
            signal.signal(number, signal.SIG_IGN)
        signal.signal(process.EMERGENCY, lambda number, _: self._stops.append(number))
        # The supervisor starts nodes with this signal blocked; an earlier stop is delivered now.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {process.EMERGENCY})
        # A device's library may hang, as PortAudio does once its server is gone, and no Python
        # handler runs then. The signal therefore calls alarm() directly, with its own number.
        libc = ctypes.CDLL(None)
        libc.signal(ORPHANED, libc.alarm)
        if hasattr(libc, "prctl"):  # Linux
            libc.prctl(PR_SET_PDEATHSIG, ORPHANED)
        # The parent may have ended already; a supervisor therefore passes its process id.
        self._parent = int(os.environ.get(process.SUPERVISOR, os.getppid()))
        self._check_due, self._orphaned = 0.0, False

    def ended(self) -> bool:
        """Return whether the process must end."""
        # A check for the parent takes a system call, 20 us a tick.
        if (now := time.monotonic()) >= self._check_due:
            self._check_due = now + SERVING_PERIOD
            self._orphaned = os.getppid() != self._parent
        return bool(self._ends) or self._orphaned

    def take_stop(self) -> bool:
        """Return whether an emergency stop has come since the last call."""
        if not self._stops:
            return False
        self._stops.clear()
        return True


Build = Callable[[], SupervisedNode]


class Worker(Protocol):
    """Node, or loop of several nodes, with the attributes of `SupervisedNode`."""

    follows_stop: bool

    def begin(self) -> None:
        """Prepare for the first call of `work`."""

    def work(self) -> float:
        """Do the work that is due; return the steady time of the next call, s."""

    def follow_stop(self) -> None:
        """Process messages on the emergency stop."""


class StopPoll:
    """Polls for the emergency stop on behalf of the workers of a process that follow it.

    Parameters
    ----------
    workers : sequence of Worker
    clock : callable
        Returns the steady time, s.
    """

    def __init__(
        self, workers: Sequence[Worker], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._followers = [worker for worker in workers if worker.follows_stop]
        self._clock = clock
        self._due = 0.0 if self._followers else math.inf

    def after_work(self, wake: float) -> float:
        """Poll if it is due before the next work; return the time of the next work or poll, s.

        A due tick is served first, since the poll would delay it.

        Parameters
        ----------
        wake : float
            Time of the next work, s.
        """
        if self._followers and self._due <= max(wake, now := self._clock()):
            self._due = now + STOP_PERIOD
            for follower in self._followers:
                follower.follow_stop()
        return min(wake, self._due)


Join = Callable[[Sequence[Any]], Worker]


def run_nodes(
    name: str,
    *builds: Build,
    join: Join | None = None,
    niceness: int = 0,
    priority: int = FORCE_PRIORITY,
) -> None:
    """Run nodes until a signal, or the end of a node or of the parent process; then exit.

    Parameters
    ----------
    name : str
        Name in messages.
    builds : callables
        Functions that make the nodes, which share this process and its executor.
    join : callable, optional
        Returns the nodes' loop, which works in place of the nodes.
    niceness : int
        Niceness where real-time priority is not granted.
    priority : int
        Real-time priority to request.
    """
    # Set before the middleware starts threads, which inherit the niceness.
    os.nice(niceness)
    os.environ.update(middleware_defaults(os.environ))
    run_process(name, partial(_run, builds, join, priority))


def run_process(name: str, act: Callable[[Signals], None]) -> NoReturn:
    """Run the task of a process, then exit with its status; report a failure in one line.

    Parameters
    ----------
    name : str
        Name in messages.
    act : callable
        Function of `Signals` that returns once the process must end.
    """
    unblock_standard_streams()
    sharpen_timers()
    status = _status(name, act, Signals())
    # A second signal (launch sends one after the terminal's) must not disturb the shutdown:
    # Python's exit restores default handlers, but leaves ignored signals ignored.
    for number in process.ENDING:
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _status(name: str, act: Callable[[Signals], None], signals: Signals) -> int:
    wrong = (ParameterError, InvalidParameterException)
    try:
        act(signals)
    except (*wrong, DeviceError, OSError) as error:
        print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr, flush=True)
        return process.WRONG_ARGUMENTS if isinstance(error, wrong) else process.FAILED
    except Exception as error:
        if not (short := process.shortage(error)):
            raise
        print(f"{name}: {short}", file=sys.stderr, flush=True)
        return process.FAILED
    return process.DONE


def _run(builds: Sequence[Build], join: Join | None, priority: int, signals: Signals) -> None:
    nodes: list[SupervisedNode] = []
    well = False
    prepare_logging()
    try:
        try:
            take_arguments()
            WIRES.joined = len(builds) > 1
            nodes.extend(build() for build in builds)
            workers = [join(nodes)] if join else nodes
        except RuntimeError as error:
            # rcl's errors have no public type; these words occur in all command line errors.
            if any(word in str(error) for word in ("ROS arguments", "param")):
                raise ParameterError(str(error)) from error
            raise
        ask_for_realtime(priority)
        _spin(nodes, workers, signals)
        well = True
    finally:
        close_nodes(nodes, well)


def take_arguments(domain: int | None = None) -> None:
    """Initialise ROS from the command line; refuse arguments that are not for ROS.

    Parameters
    ----------
    domain : int, optional
        ROS domain; default: the environment's.

    Raises
    ------
    ParameterError
        An argument is not for ROS, or the environment does not suit the middleware.
    """
    check_middleware(os.environ)
    unknown = remove_ros_args(sys.argv)[1:]
    if unknown:
        raise ParameterError(f"{unknown[0]}: no such argument; use --ros-args -p name:=value")
    rclpy.init(domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)


def close_nodes(nodes: Sequence[SupervisedNode], well: bool) -> None:
    """Close every node, even if another fails or hangs, and then the middleware."""
    with ExitStack() as stack:
        for node in nodes:
            stack.callback(node.close)
        for node in nodes:
            node.take_forces_off()
    # Leave real-time priority: nothing is urgent, and the middleware may spin for too long.
    if hasattr(os, "sched_setscheduler"):
        schedule(os.SCHED_OTHER, 0)
    # Under load, about one in some hundred shutdowns of the middleware hung or aborted ("pure
    # virtual method called") while other nodes left. Nothing can be lost any more.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(min(TEARDOWN, signal.alarm(0) or TEARDOWN))  # an orphan has less time
    if well:  # an abort must not hide a failure
        # Python's handlers run too late: C's _exit gets the signal as the status.
        libc = ctypes.CDLL(None)
        for number in process.CUT_SHORT:
            libc.signal(number, libc._exit)
    for node in nodes:
        node.publish_final_diagnostics()
        node.destroy_node()
    rclpy.try_shutdown()


def _spin(nodes: Sequence[SupervisedNode], workers: Sequence[Worker], signals: Signals) -> None:
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    polls, usual = TAKES and all(node.polls for node in nodes), SERVING_TIME
    served, slept = 0.0, time.monotonic()
    serving_period = SERVING_PERIOD / len(nodes)
    stop_poll = StopPoll(workers)

    def serve(seconds: float) -> None:
        try:
            executor.spin_once(timeout_sec=seconds)
        except ExternalShutdownException:
            raise
        except Exception as error:  # no received message may end the process
            nodes[0].callback_failed(error)

    # Freeze all present objects: a collection would find no garbage among them, and delay a tick
    # by milliseconds.
    gc.collect()
    gc.freeze()
    gc.disable()
    for worker in workers:
        worker.begin()
    try:
        while not (any([node.finished.done() for node in nodes]) or signals.ended()):
            if signals.take_stop():
                for node in nodes:
                    node.stop_forces()
            wake = stop_poll.after_work(min([worker.work() for worker in workers]))
            now = time.monotonic()
            pause = min(max(0.0, wake - now), POLL_PERIOD)
            enough = pause > min(SERVING_TIME, USUAL * usual)
            usual += FOLLOWING * (pause - usual)
            if not polls:
                serve(pause)
            elif now - served >= serving_period * (1.0 if enough else LONGEST_UNSERVED):
                served = now
                serve(0.0)
            elif pause or now - slept >= LONGEST_BUSY:
                time.sleep(min(pause or BREAK, serving_period))
                slept = now
    finally:
        executor.shutdown()

"""Least age of a force on this machine: the felt path over bare UDP sockets, without a middleware.

This process stands for the devices: it sends an acceleration at each grid point and receives the
force. A second one stands for the compensator. The graph's age beyond that is due to middleware,
executor and simulated physics.
"""

from __future__ import annotations

import gc
import math
import multiprocessing
import select
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from typing import Any

from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import TOOL_ACCELERATION
from haptic_accel.graph.node_parameters import CompensatorNodeParameters
from haptic_accel.nodes.scheduling import RateKeeper, sharpen_timers, system_time

STARTING_TIME = 30.0
"""Time that the second process may take to start on a busy machine, s."""

SILENCE = 2.0
"""Time without a sample after which the second process ends by itself, s."""

TONE = 100.0
"""Frequency of the acceleration that is sent, Hz; its amplitude is 1 m/s^2."""

LARGEST_DATAGRAM = 2048
"""Size of the receive buffer, bytes; every message of the graph is smaller."""

READY = b""
"""Datagram that the second process sends when it has started."""


def udp_floor(rate: float, seconds: float) -> dict[str, Any]:
    """Measure the age of the force where it would be applied.

    A sample has the stamp of its grid point and the size of the graph's message, and passes
    through the compensation with the dynamic controller.

    Parameters
    ----------
    rate : float
        Samples per second, Hz.
    seconds : float
        Length of the measurement, s; at least one sample.

    Returns
    -------
    dict
        ``{"age_us": {"p50", "p90", "p99", "p99_9", "max"}, "sent": n, "received": n}``, ages
        in microseconds, NaN when nothing was received.

    Raises
    ------
    ParameterError
        The compensator does not support the rate, or the time is shorter than one sample.
    RuntimeError
        The second process did not start, or ended early.
    """
    CompensatorNodeParameters(rate=rate)
    if not 1 <= rate * seconds < math.inf:
        raise ParameterError(
            f"seconds = {seconds:g}: must be at least one period of {rate:g} Hz, and finite"
        )
    pack = StampedVector(TOOL_ACCELERATION).pack
    age, keeper = DurationHistogram(), RateKeeper(rate)
    with _compensator(rate) as link:
        _prepare()
        keeper.wait_for_grid()
        while keeper.ticks < round(rate * seconds):
            due = keeper.tick()
            if due is None:  # woken too early
                continue
            acceleration = math.sin(2 * math.pi * TONE / NANOSECONDS * due)
            link.send(pack(system_time(due), (0.0, 0.0, acceleration)))
            next_due = due / NANOSECONDS + keeper.period
            while data := _received(link, next_due - time.monotonic()):
                age.add((time.time_ns() - unpack_stamped_vector(data)[0]) / NANOSECONDS)
        gc.enable()
    microseconds = {name: value * 1e6 for name, value in age.summary().items()}
    return {"age_us": microseconds, "sent": keeper.ticks, "received": age.count}


@contextmanager
def _compensator(rate: float) -> Iterator[socket.socket]:
    """Start the second process; yield a socket that is connected to it."""
    here, there = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with here, there:
        for end in (here, there):
            end.bind(("127.0.0.1", 0))
        here.connect(there.getsockname())
        there.connect(here.getsockname())
        process = multiprocessing.get_context("spawn").Process(
            target=_compensate, args=(there, rate), daemon=True
        )
        process.start()
        # Only the process's own copy, so that its end is noticed by who sends to it.
        there.close()
        try:
            if here not in wait([here, process.sentinel], STARTING_TIME):
                raise RuntimeError("compensator: did not start")
            here.recv(LARGEST_DATAGRAM)
            yield here
        except ConnectionRefusedError:
            raise RuntimeError("compensator: ended early") from None
        finally:
            process.kill()
            process.join()


def _compensate(link: socket.socket, rate: float) -> None:
    """Answer each acceleration with a force, until none comes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the first process
    compensation = Compensation(CompensationParameters(controller="dynamic"), rate)
    pack = StampedVector(TOOL_ACCELERATION).pack
    _prepare()
    with suppress(ConnectionRefusedError):  # the first process was stopped
        link.send(READY)
        while data := _received(link, SILENCE):
            stamp, acceleration = unpack_stamped_vector(data)
            _, force = compensation.sample(acceleration[2], 0.0)
            link.send(pack(stamp, (0.0, 0.0, force)))


def _prepare() -> None:
    """Prepare timers and garbage collection as a node does."""
    sharpen_timers()
    gc.collect()
    gc.freeze()
    gc.disable()


def _received(link: socket.socket, seconds: float) -> bytes | None:
    """Return the next datagram; None if there is none in time."""
    # Not a time-out of the socket, which is rounded up to whole milliseconds.
    ready, _, _ = select.select([link], [], [], max(seconds, 0.0))
    return link.recv(LARGEST_DATAGRAM) if ready else None

"""The least age that a force can have on this machine: the felt path over bare UDP sockets.

Three Python processes do what slave device, compensator and master device do with one sample,
and hand it on over the loopback interface with nothing in between. What the graph needs beyond
that is the middleware's and the executor's. The simulated devices' physics is left out.
"""

from __future__ import annotations

import gc
import json
import math
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import AccelStamped
from rclpy.serialization import deserialize_message

from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, FAILED
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import TOOL_ACCELERATION
from haptic_accel.graph.node_parameters import CompensatorNodeParameters
from haptic_accel.nodes.scheduling import RateKeeper, sharpen_timers, system_time

PATIENCE = 30.0
"""Time for a process to start, or to end when it should, on a busy machine, s."""

TONE = 100.0
"""Frequency of the acceleration that is sent, Hz; its amplitude is 1 m/s^2."""

LARGEST_DATAGRAM = 2048
"""Bytes read of a datagram; no signal of the graph has as many."""

END = b""
"""The datagram that ends a run."""

END_PERIOD = 0.01
"""How often the end is sent, s: a datagram is lost where the receiver's buffer is full."""

ENDS = 200
"""How often the end is sent at most, where no error tells that the receiver has ended."""

_MODULE = "haptic_accel.cli.udp_floor"

_Pack = Callable[[int, Vector], bytes]
_Read = Callable[[bytes], tuple[int, Vector]]


def udp_floor(rate: float, seconds: float, message: bytes) -> dict[str, Any]:
    """Measure the age of the force where it would be applied, without a middleware.

    A sample is stamped with the grid point that it is for, as in the graph; its way leads
    through the compensation with the dynamic controller.

    Parameters
    ----------
    rate : float
        Samples per second, Hz.
    seconds : float
        Length of the measurement, s; at least one sample.
    message : bytes
        A serialised geometry_msgs/AccelStamped, which both hops carry: it gives the size.

    Returns
    -------
    dict
        ``{"age_us": {"p50", "p90", "p99", "p99_9", "max"}, "sent": n, "received": n}``, ages
        in microseconds, NaN when nothing was received.

    Raises
    ------
    ParameterError
        A rate that the compensator does not have, or no time for a single sample.
    RuntimeError
        A process ended early or not at all.
    """
    count = _sample_count(rate, seconds)
    with ExitStack() as stack:
        to_compensator, from_slave = _connected_pair(stack)
        to_master, from_compensator = _connected_pair(stack)
        enter = stack.enter_context
        children = {
            "slave_device": enter(_child("slave_device", rate, count, message, to_compensator)),
            "compensator": enter(
                _child("compensator", rate, count, message, from_slave, to_master)
            ),
            "master_device": enter(
                _child("master_device", rate, count, message, from_compensator)
            ),
        }
        # Only the children's own, so that one that ends is missed by who sends to it.
        for end in (to_compensator, from_slave, to_master, from_compensator):
            end.close()
        for name, child in children.items():
            _wait_until_ready(name, child)
        _say_go(children["slave_device"])
        results: dict[str, Any] = {}
        for name, child in children.items():
            results |= _result(name, child, count / rate + PATIENCE)
    return {key: results[key] for key in ("age_us", "sent", "received")}


def _sample_count(rate: float, seconds: float) -> int:
    CompensatorNodeParameters(rate=rate)
    if not 1 <= rate * seconds < math.inf:
        raise ParameterError(
            f"seconds = {seconds:g}: must be at least one period of {rate:g} Hz, and finite"
        )
    return round(rate * seconds)


# The parent's side


def _connected_pair(stack: ExitStack) -> tuple[socket.socket, socket.socket]:
    """Return two UDP sockets on ports of the system's choice that hear only each other."""
    one, other = (
        stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)
    )
    for end in (one, other):
        end.bind(("127.0.0.1", 0))
    one.connect(other.getsockname())
    other.connect(one.getsockname())
    return one, other


@contextmanager
def _child(
    role: str, rate: float, count: int, message: bytes, *sockets: socket.socket
) -> Iterator[subprocess.Popen[str]]:
    """Run one of the three processes; killed, if it still runs, on leaving."""
    files = [end.fileno() for end in sockets]
    words = [role, repr(rate), str(count), message.hex(), *map(str, files)]
    child = subprocess.Popen(
        [sys.executable, "-m", _MODULE, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        pass_fds=files,
        # Ctrl-C is for the parent.
        start_new_session=True,
    )
    try:
        yield child
    finally:
        child.kill()
        child.wait()
        for stream in (child.stdin, child.stdout):
            if stream:
                with suppress(BrokenPipeError):
                    stream.close()


def _wait_until_ready(name: str, child: subprocess.Popen[str]) -> None:
    assert child.stdout
    # A child that cannot start ends, and with it the stream.
    if not child.stdout.readline():
        raise RuntimeError(f"{name}: ended with status {child.wait()} before it was ready")


def _say_go(child: subprocess.Popen[str]) -> None:
    assert child.stdin
    # One that has ended is noticed when its result is asked for.
    with suppress(BrokenPipeError):
        child.stdin.write("go\n")
        child.stdin.flush()


def _result(name: str, child: subprocess.Popen[str], timeout: float) -> dict[str, Any]:
    """Return what a child found, once it has ended."""
    try:
        status = child.wait(timeout)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{name}: did not end within {timeout:g} s") from None
    if status != DONE:
        raise RuntimeError(f"{name}: ended with status {status}")
    assert child.stdout
    return dict(json.loads(child.stdout.read()))


# The children's side


def main() -> None:
    """Be one of the three processes: ``ROLE RATE COUNT MESSAGE SOCKET...``."""
    role, rate, count, message, *files = sys.argv[1:]
    sockets = [socket.socket(fileno=int(file)) for file in files]
    pack, read = _wire(bytes.fromhex(message))
    try:
        if role == "slave_device":
            found = _slave_device(float(rate), int(count), pack, *sockets)
        elif role == "compensator":
            found = _compensator(float(rate), pack, read, *sockets)
        else:
            found = _master_device(read, *sockets)
        print(json.dumps(found), flush=True)
    except BrokenPipeError:
        # The parent has ended; Python would complain once more if it ended by itself.
        os._exit(FAILED)


def _wire(message: bytes) -> tuple[_Pack, _Read]:
    """Return what writes and reads messages like the one given, as the graph does."""
    frame = deserialize_message(message, AccelStamped).header.frame_id
    return StampedVector(replace(TOOL_ACCELERATION, frame=frame)).pack, unpack_stamped_vector


def _get_ready() -> threading.Event:
    """Prepare as a node does and say so; return what is set when the parent says go."""
    sharpen_timers()
    gc.collect()
    gc.freeze()
    gc.disable()
    go = threading.Event()
    threading.Thread(target=_listen_to_parent, args=(go,), daemon=True).start()
    print("ready", flush=True)
    return go


def _listen_to_parent(go: threading.Event) -> None:
    """Take its word, and end this process when the parent has ended."""
    # Not sys.stdin, whose lock must be free when Python ends.
    while os.read(0, 1):
        go.set()
    os._exit(FAILED)


def _slave_device(rate: float, count: int, pack: _Pack, outgoing: socket.socket) -> dict[str, Any]:
    """Send an acceleration at each grid point."""
    _get_ready().wait()
    sent = 0
    # Refused when nobody listens any more, which the parent notices by itself.
    with suppress(ConnectionRefusedError):
        for due in _grid(rate, count):
            acceleration = math.sin(2 * math.pi * TONE / NANOSECONDS * due)
            outgoing.send(pack(system_time(due), (0.0, 0.0, acceleration)))
            sent += 1
    _send_end(outgoing)
    return {"sent": sent}


def _grid(rate: float, count: int) -> Iterator[int]:
    """Yield grid points, steady time in ns, each when it has come."""
    keeper = RateKeeper(rate)
    keeper.wait_for_grid()
    while keeper.ticks < count:
        due = keeper.tick()
        if due is None:
            continue
        yield due
        time.sleep(max(0.0, due / NANOSECONDS + keeper.period - time.monotonic()))


def _compensator(
    rate: float, pack: _Pack, read: _Read, incoming: socket.socket, outgoing: socket.socket
) -> dict[str, Any]:
    """Answer each acceleration with a force."""
    compensation = Compensation(CompensationParameters(controller="dynamic"), rate)
    _get_ready()
    with suppress(ConnectionRefusedError):
        while data := incoming.recv(LARGEST_DATAGRAM):
            moment, acceleration = read(data)
            _, force = compensation.sample(acceleration[2], 0.0)
            outgoing.send(pack(moment, (0.0, 0.0, force)))
    _send_end(outgoing)
    return {}


def _master_device(read: _Read, incoming: socket.socket) -> dict[str, Any]:
    """Take the age of each force that arrives."""
    age = DurationHistogram()
    _get_ready()
    while data := incoming.recv(LARGEST_DATAGRAM):
        moment, _ = read(data)
        age.add((time.time_ns() - moment) / NANOSECONDS)
    microseconds = {name: seconds * 1e6 for name, seconds in age.summary().items()}
    return {"age_us": microseconds, "received": age.count}


def _send_end(outgoing: socket.socket) -> None:
    """Send the end until the receiver is gone."""
    with suppress(ConnectionRefusedError):
        for _ in range(ENDS):
            outgoing.send(END)
            time.sleep(END_PERIOD)


if __name__ == "__main__":
    main()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Locks in a ROS domain of this machine: one graph per namespace, one sender per signal.

A lock is a socket with an abstract name. The kernel releases the lock however the process ends,
and no file remains. Like the graph's messages, the lock is visible to all users of the machine,
within its network namespace.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.middleware import check_middleware, check_ros
from haptic_accel.graph.stop_signal import DOMAIN, address, holder, own_domain, sender, signals

HIGHEST_FREE_DOMAIN = 101
"""Highest ROS domain whose ports Linux does not assign to other programs (ROS 2 documentation)."""

ASKERS = 4096
"""Number of queries about its owner that a lock answers; later ones do not release it."""


def lock_signal(domain: int, topic: str) -> socket.socket:
    """Lock a signal in a ROS domain for one sender until the socket returned is closed.

    Parameters
    ----------
    domain : int
    topic : str
        Name with its namespace.

    Raises
    ------
    ParameterError
        The signal already has a sender.
    """
    return _lock(domain, sender(topic))


@contextmanager
def sole_graph(namespace: str) -> Iterator[None]:
    """Lock a namespace in the environment's ROS domain for a graph while the context is entered.

    Parameters
    ----------
    namespace : str
        Namespace with a leading slash; empty for the root.

    Raises
    ------
    ParameterError
        The namespace already has a graph, or a single node that sends one of its signals; or the
        environment prevents nodes from starting or finding each other.
    ModuleNotFoundError
        ROS 2 is not installed.
    """
    check_ros()
    check_middleware(os.environ)
    domain = own_domain()
    with _lock(domain, f"graph in {namespace}" if namespace else "graph"):
        for name in signals(namespace):
            _lock(domain, sender(name)).close()
        yield


def _lock(domain: int, role: str) -> socket.socket:
    """Lock a role, or raise an error that names the role's process."""
    lock = socket.socket(socket.AF_UNIX)
    socket_name = address(domain, role)
    try:
        lock.bind(socket_name)
    except OSError as error:
        lock.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise ParameterError(
            f"ROS domain {domain}: has a {role} already, {_described(holder(socket_name))};"
            f" stop it, or set another namespace or {DOMAIN}"
        ) from None
    lock.listen(ASKERS)
    return lock


def _described(process: int) -> str:
    """Return a process id, and the command line without folders and ROS arguments.

    Inline program text, as in `module_command`, is also omitted.
    """
    try:
        line = Path(f"/proc/{process}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return f"process {process or 'unknown'}"
    own = takewhile(lambda part: part not in ("", "--ros-args"), line.split("\0"))
    parts = (part for part in own if not (part == "-c" or part.startswith("import ")))
    shown = " ".join(Path(part).name if part.startswith("/") else part for part in parts)
    return f"process {process} ({shown})"

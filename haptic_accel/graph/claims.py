# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Claims on a ROS domain of this machine: one graph in a namespace, one sender of each signal.

A claim is a socket with an abstract name. The kernel releases it however its process ends, it
leaves no file behind, and it is seen where the graph's messages are: by every user of the machine,
and not beyond its network namespace.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import takewhile
from pathlib import Path

from haptic_accel.core.decimals import read_whole
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import EMERGENCY
from haptic_accel.core.topics import SIGNALS

DOMAIN = "ROS_DOMAIN_ID"
"""Environment variable with the number of the ROS domain."""

HIGHEST_DOMAIN = 232
"""Highest number of a ROS domain, above which it has no ports."""

HIGHEST_FREE_DOMAIN = 101
"""Highest ROS domain whose ports Linux does not assign to other programs (ROS 2 documentation)."""

SOCKETS = Path("/proc/net/unix")
"""The kernel's list of addresses in use, those with an abstract name behind an @ (proc(5))."""

ASKERS = 4096
"""Number of times that a claim says whose it is; it holds beyond, too."""

_SENDER = "sender"

_CREDENTIALS = struct.Struct("3i")
"""Process, user and group of a peer (socket(7), SO_PEERCRED)."""


def own_domain() -> int:
    """Return the ROS domain of the environment.

    Raises
    ------
    ParameterError
        It is no number of a domain.
    """
    text = os.environ.get(DOMAIN) or "0"
    try:
        number = read_whole(text)
    except ValueError:
        number = -1
    if not 0 <= number <= HIGHEST_DOMAIN:
        raise ParameterError(f"{DOMAIN} = {text!r}: must be from 0 to {HIGHEST_DOMAIN}")
    return number


def claim_signal(domain: int, topic: str) -> socket.socket:
    """Claim to be the sender of a signal in a ROS domain until the socket returned is closed.

    Parameters
    ----------
    domain : int
    topic : str
        Name with its namespace.

    Raises
    ------
    ParameterError
        The signal has a sender.
    """
    return _claim(domain, _sender(topic))


@contextmanager
def sole_graph(namespace: str) -> Iterator[None]:
    """Claim a namespace in the environment's ROS domain for a graph while the context is entered.

    Parameters
    ----------
    namespace : str
        With a slash before; empty for the root.

    Raises
    ------
    ParameterError
        A graph, or a single node that sends one of its signals, runs in it already.
    """
    domain = own_domain()
    with _claim(domain, f"graph in {namespace}" if namespace else "graph"):
        for name in _signals(namespace):
            _claim(domain, _sender(name)).close()
        yield


def stop_senders(domain: int, namespace: str) -> int:
    """Let the nodes of this machine that send a graph's signals carry out the emergency stop.

    Parameters
    ----------
    domain : int
    namespace : str
        Namespace of the graph, with a slash before; empty for every graph of the domain.

    Returns
    -------
    int
        Number of processes that have been signalled; those of another user cannot be.
    """
    senders = {_address(domain, _sender(name)) for name in _signals(namespace)}
    stopped = 0
    for process in {_holder(each) for each in (senders if namespace else _senders(domain))}:
        with suppress(OSError):
            if process and _handles_emergency(process):
                os.kill(process, EMERGENCY)
                stopped += 1
    return stopped


def _signals(namespace: str) -> list[str]:
    """Return the names of a graph's signals with their namespace."""
    return [f"{namespace}/{topic.name}" for topic in SIGNALS]


def _senders(domain: int) -> Iterator[bytes]:
    """Yield the addresses of all senders of signals in a ROS domain."""
    start = _place(domain, _SENDER)
    for line in SOCKETS.read_bytes().splitlines():
        name = line.rpartition(b" ")[2].replace(b"@", b"\0", 1)
        if name.startswith(start):
            yield name


def _handles_emergency(process: int) -> bool:
    """Return whether the signal of the emergency stop would not simply end a process."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    (caught,) = (line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> EMERGENCY - 1 & 1)


def _sender(topic: str) -> str:
    return f"{_SENDER} of {topic}"


def _claim(domain: int, role: str) -> socket.socket:
    """Claim a role, or raise the error that names the process which has it."""
    claimed = socket.socket(socket.AF_UNIX)
    address = _address(domain, role)
    try:
        claimed.bind(address)
    except OSError as error:
        claimed.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise ParameterError(
            f"ROS domain {domain}: has a {role} already, {_described(_holder(address))};"
            f" stop it, or set another namespace or {DOMAIN}"
        ) from None
    claimed.listen(ASKERS)
    return claimed


def _address(domain: int, role: str) -> bytes:
    """Return the address of a role, hashed, as names of topics can be longer than addresses."""
    digest = hashlib.sha256(role.encode()).hexdigest()
    return _place(domain, role) + digest.encode()


def _place(domain: int, role: str) -> bytes:
    """Return the start of the addresses of all roles with the same first word."""
    return f"\0haptic_accel/{domain}/{role.partition(' ')[0]}/".encode()


def _holder(address: bytes) -> int:
    """Return the process that listens at an address; 0 if that is unknown."""
    with socket.socket(socket.AF_UNIX) as asking:
        asking.setblocking(False)
        try:
            asking.connect(address)
        except OSError:  # it has just ended, or was asked too often
            return 0
        peer = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(peer)[0])


def _described(process: int) -> str:
    """Return the number of a process, and its command line without folders and ROS' arguments.

    A program among the words, as in `module_command`, is left out, too.
    """
    try:
        line = Path(f"/proc/{process}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return f"process {process or 'unknown'}"
    own = takewhile(lambda word: word not in ("", "--ros-args"), line.split("\0"))
    words = (word for word in own if not (word == "-c" or word.startswith("import ")))
    shown = " ".join(Path(word).name if word.startswith("/") else word for word in words)
    return f"process {process} ({shown})"

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emergency stop of this machine without ROS, by signals to nodes, also for later graphs.

This module imports little, because each import delays the stop on a busy machine.
"""

from __future__ import annotations

import os
import socket
import time

from haptic_accel.core.process import EMERGENCY, REALTIME

TYPE_CHECKING = False  # typing is slow to import
if TYPE_CHECKING:
    from collections.abc import Sequence

# hashlib, core.parameters and core.topics are imported where needed: most stops need none.

DOMAIN = "ROS_DOMAIN_ID"
"""Environment variable with the number of the ROS domain."""

HIGHEST_DOMAIN = 232
"""Highest number of a ROS domain; above it, no ports are defined."""

SOCKETS = "/proc/net/unix"
"""The kernel's list of socket addresses in use; abstract names follow an @ (proc(5))."""

PRIORITY = 20
"""Real-time priority of a process that stops a graph: below the nodes', which must execute the
stop, and above all other programs."""

PENDING = "/tmp/haptic_accel_stop"
"""Start of the names of pending stops. The folder is the same for all users and services, which
`TMPDIR` and `XDG_RUNTIME_DIR` are not, and is emptied by a restart of the machine."""

_SENDER = "sender"

_CREDENTIALS = 12
"""Size of process, user and group of a peer, an int each (socket(7), SO_PEERCRED), bytes."""


class Signalled:
    """Result of a stop by signals.

    Attributes
    ----------
    processes : int
        Number of processes that have been signalled.
    after : float
        Time from this process's start to the last signal, s.
    pending : bool
        True if the stop also applies to graphs that start later; see `PendingStop`.
    """

    def __init__(self, processes: int, *, pending: bool) -> None:
        self.processes = processes
        self.after = age()
        self.pending = pending


class PendingStop:
    """Emergency stop, until released, of a graph whose nodes cannot be reached yet.

    The stop is a file, which a device node checks before it allows forces, and ten times a second.
    The stop thus needs no node, signal or message, and outlasts the command that requested it.
    Like the locks on signals, it applies to one network namespace and to all users.

    Parameters
    ----------
    domain : int
        ROS domain.
    namespace : str
        Namespace of the graph, with a slash before; empty for every graph of the domain.
    """

    def __init__(self, domain: int, namespace: str) -> None:
        host = os.stat("/proc/self/ns/net").st_ino
        everywhere = f"{PENDING}-{host}-{domain}"
        self._file = f"{everywhere}-{_hashed(namespace)}" if namespace else everywhere
        self._files = {everywhere, self._file}
        self._known: set[tuple[int, int]] = set()

    def leave(self) -> bool:
        """Create the stop; return False if the disk is full.

        No file is opened, because any user can put a FIFO or a link into the folder.
        """
        try:
            if not os.path.lexists(self._file):
                os.mknod(self._file, 0o644)
            os.utime(self._file, follow_symlinks=False)
        except OSError:
            return os.path.lexists(self._file)  # another user's stop also counts
        return True

    def withdraw(self) -> bool:
        """Withdraw the stop; return whether there was one.

        Raises
        ------
        OSError
            The stop belongs to another user.
        """
        try:
            os.unlink(self._file)
        except FileNotFoundError:
            return False
        return True

    def is_new(self) -> bool:
        """Return whether a stop exists that was created after the last call."""
        before, self._known = self._known, set(map(_identity, self._files)) - {(0, 0)}
        return not self._known <= before

    def holds(self) -> bool:
        """Return whether a stop exists."""
        return any(map(os.path.lexists, self._files))


def own_domain() -> int:
    """Return the ROS domain of the environment.

    Raises
    ------
    ParameterError
        The environment's domain is invalid.
    """
    text = os.environ.get(DOMAIN) or "0"
    try:
        if text.isascii() and text.isdigit():
            number = int(text)
        else:  # rare; a stop usually does not wait for the import
            from haptic_accel.core.parameters import read_whole

            number = read_whole(text)
    except ValueError:
        number = -1
    if not 0 <= number <= HIGHEST_DOMAIN:
        from haptic_accel.core.parameters import ParameterError

        raise ParameterError(f"{DOMAIN} = {text!r}: must be from 0 to {HIGHEST_DOMAIN}")
    return number


def hurry(priority: int = PRIORITY) -> None:
    """Request real-time priority for this thread; continue if refused.

    Call it before starting threads, which inherit the priority.
    """
    if os.environ.get(REALTIME) != "no" and hasattr(os, "sched_setscheduler"):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError:  # not allowed here
            return


def age() -> float:
    """Return the time since this process was started, s (proc(5), stat)."""
    with open("/proc/self/stat", "rb") as stat:
        started = int(stat.read().rpartition(b")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started


def stop_at_once(arguments: Sequence[str]) -> Signalled | None:
    """Stop a graph by the arguments of ``haptic-accel estop``, as `stop_graphs` does.

    Parameters
    ----------
    arguments : sequence of str
        Empty, or the namespace.

    Returns
    -------
    Signalled or None
        None for other arguments or an invalid namespace, which need a parser.

    Raises
    ------
    ParameterError
        The environment names no ROS domain.
    """
    key, separator, namespace = (*arguments, "namespace:=")[0].partition(":=")
    if len(arguments) > 1 or (key, separator) != ("namespace", ":="):
        return None
    bare = namespace.strip("/")
    if bare and not all(part.isascii() and part.isidentifier() for part in bare.split("/")):
        return None
    return stop_graphs(own_domain(), bare and f"/{bare}")


def stop_graphs(domain: int, namespace: str) -> Signalled:
    """Stop a graph's nodes on this machine, including those that do not run yet.

    Parameters as for `stop_senders`.
    """
    try:
        processes = stop_senders(domain, namespace)
    except OSError:  # the kernel's list cannot be read
        processes = 0
    # Signals first: a node checks for the pending stop before it allows forces, and regularly.
    return Signalled(processes, pending=PendingStop(domain, namespace).leave())


def stop_senders(domain: int, namespace: str) -> int:
    """Signal the emergency stop to the nodes of this machine that send a graph's signals.

    Parameters
    ----------
    domain : int
    namespace : str
        Namespace of the graph, with a slash before; empty for every graph of the domain.

    Returns
    -------
    int
        Number of signalled processes; processes of other users cannot be signalled.
    """
    start = _prefix(domain, _SENDER)
    senders = {name for name in _addresses() if name.startswith(start)}
    if namespace:
        senders &= {address(domain, sender(name)) for name in signals(namespace)}
    stopped = set[int]()
    for each in senders:
        try:
            process = holder(each)
            if process not in stopped and _handles_emergency(process):
                os.kill(process, EMERGENCY)
                stopped.add(process)
        except OSError:  # the process has just ended, or is another user's
            continue
    return len(stopped)


def signals(namespace: str) -> list[str]:
    """Return the names of a graph's signals with their namespace."""
    from haptic_accel.core.topics import SIGNALS

    return [f"{namespace}/{topic.name}" for topic in SIGNALS]


def sender(topic: str) -> str:
    """Return the sender's role for a topic name with its namespace."""
    return f"{_SENDER} of {topic}"


def address(domain: int, role: str) -> bytes:
    """Return the hashed address of a role, as topic names can be longer than addresses."""
    return _prefix(domain, role) + _hashed(role).encode()


def holder(address: bytes) -> int:
    """Return the process that listens at an address; 0 if unknown."""
    with socket.socket(socket.AF_UNIX) as asking:
        asking.setblocking(False)
        try:
            asking.connect(address)
        except OSError:  # the process has just ended, or was queried too often
            return 0
        peer = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS)
    return memoryview(peer).cast("i")[0]


def _hashed(name: str) -> str:
    from hashlib import sha256

    return sha256(name.encode()).hexdigest()


def _identity(file: str) -> tuple[int, int]:
    """Return numbers that differ once a file has been replaced; zeros if it does not exist."""
    try:
        found = os.lstat(file)
    except OSError:
        return 0, 0
    return found.st_ino, found.st_mtime_ns


def _prefix(domain: int, role: str) -> bytes:
    """Return the start of the addresses of all roles with the same first word."""
    return f"\0haptic_accel/{domain}/{role.partition(' ')[0]}/".encode()


def _addresses() -> list[bytes]:
    """Return this package's abstract addresses in use.

    Other programs' names may contain blanks and line ends. The list is therefore split at blanks,
    which no address of this package contains, and not into lines.
    """
    with open(SOCKETS, "rb") as file:
        parts = file.read().split()
    return [part.replace(b"@", b"\0", 1) for part in parts if part.startswith(b"@haptic_accel/")]


def used_domains() -> set[int]:
    """Return the ROS domains in which nodes of this machine send signals, or links run."""
    return {int(n) for n in (name.split(b"/")[1] for name in _addresses()) if n.isdigit()}


def _handles_emergency(process: int) -> bool:
    """Return whether a process handles the signal of the emergency stop."""
    with open(f"/proc/{process}/status", "rb") as status:
        caught = [int(line.split()[1], 16) for line in status if line.startswith(b"SigCgt:")]
    return any(handled >> EMERGENCY - 1 & 1 for handled in caught)

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Datagrams between the half coupler and the link of one host.

The sockets have abstract names: the kernel releases them however a process ends, and they are not
seen beyond the machine.
"""

from __future__ import annotations

import errno
import hashlib
import socket
from collections import deque
from contextlib import suppress

from haptic_accel.core.parameters import ParameterError

COUPLER, LINK = "coupler", "link"
"""The two ends."""

LONGEST = 1100
"""Longest datagram, bytes: with the headers of a transport and a tunnel it stays below 1280, which
every network of IPv6 carries whole (RFC 8200)."""

MOST_WAITING = 100
"""Most datagrams that wait for an end which does not take them: with a packet each millisecond
those of 0.1 s, after which the peer counts as silent. The kernel keeps net.unix.max_dgram_qlen
datagrams, 10 by default."""

_NOTE = b"note\0"
"""Begin of a datagram that the link itself has written for the coupler."""

_OTHER = {COUPLER: LINK, LINK: COUPLER}


class LocalEnd:
    """One end of the path between half coupler and link, which never blocks.

    Parameters
    ----------
    end : str
        `COUPLER` or `LINK`.
    domain : int
        ROS domain of the host's graph.
    namespace : str
        Namespace of the host's graph, with a slash before; empty for the root.

    Attributes
    ----------
    dropped : int
        Datagrams that were not sent, as the other end was not there or took none for too long.
    note : str
        Newest line of the other end about itself.

    Raises
    ------
    ParameterError
        Another process has this end.
    """

    def __init__(self, end: str, domain: int, namespace: str) -> None:
        self.dropped = 0
        self.note = ""
        self._waiting: deque[bytes] = deque()
        self._other = _address(_OTHER[end], domain, namespace)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(_address(end, domain, namespace))
        except OSError as error:
            self._socket.close()
            if error.errno != errno.EADDRINUSE:
                raise
            raise ParameterError(
                f"ROS domain {domain}: has a {end} of two hosts in namespace {namespace or '/'}"
                " already; stop it, or set another namespace"
            ) from None

    def fileno(self) -> int:
        """Return the file descriptor, to wait on; -1 once closed."""
        return self._socket.fileno()

    def send(self, datagram: bytes) -> bool:
        """Send a datagram after those that wait; return whether the other end will find it.

        What the other end has no room for waits until the next call. One thread alone may call.
        """
        if datagram.startswith(_NOTE):
            return True
        self._waiting.append(datagram)
        try:
            while self._waiting:
                self._socket.sendto(self._waiting[0], self._other)
                self._waiting.popleft()
        except BlockingIOError:
            if len(self._waiting) > MOST_WAITING:
                self._waiting.popleft()
                self.dropped += 1
            return False
        except ConnectionRefusedError:
            self.dropped += len(self._waiting)
            self._waiting.clear()
            return False
        return True

    def write_note(self, line: str) -> None:
        """Send a line about this end, apart from the datagrams that are carried.

        Any thread may, as it does not touch what waits. Without room the line is lost.
        """
        with suppress(BlockingIOError, ConnectionRefusedError):
            self._socket.sendto(_NOTE + line.encode(), self._other)

    def take(self) -> list[bytes]:
        """Return the datagrams that came from the other end since the last call, oldest first."""
        taken = []
        with suppress(BlockingIOError):
            while True:
                datagram, sender = self._socket.recvfrom(LONGEST + 1)
                if sender != self._other or len(datagram) > LONGEST:
                    continue
                if datagram.startswith(_NOTE):
                    self.note = datagram.removeprefix(_NOTE).decode()
                else:
                    taken.append(datagram)
        return taken

    def close(self) -> None:
        """Release the name."""
        self._socket.close()


def _address(end: str, domain: int, namespace: str) -> bytes:
    """Return the address of an end, hashed, as namespaces can be longer than addresses."""
    digest = hashlib.sha256(namespace.encode()).hexdigest()
    return f"\0haptic_accel/{domain}/{end}/{digest}".encode()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Datagrams between half coupler and link on one host.

The sockets have abstract names, which the kernel releases however a process ends; they are not
visible outside the machine.
"""

from __future__ import annotations

import errno
import hashlib
import socket
from collections import deque
from contextlib import suppress

from haptic_accel import ParameterError

COUPLER, LINK = "coupler", "link"
"""Names of the two ends."""

LONGEST_DATAGRAM = 1100
"""Maximum length of a datagram, bytes. With the headers of a transport and a tunnel it stays below
1280, which IPv6 networks carry without fragmentation (RFC 8200)."""

MOST_WAITING = 100
"""Maximum number of datagrams that wait for the other end. With a packet per millisecond this is
0.1 s, after which the peer counts as lost. The kernel stores net.unix.max_dgram_qlen datagrams, 10
by default."""

_NOTE = b"note\0"
"""Prefix of a datagram from the link itself to the coupler."""

_OTHER = {COUPLER: LINK, LINK: COUPLER}


class LocalEnd:
    """Endpoint of the connection of half coupler and link; it never blocks.

    Parameters
    ----------
    end : str
        `COUPLER` or `LINK`.
    domain : int
        ROS domain of the host's graph.
    namespace : str
        Namespace of the host's graph, starting with a slash; empty for the root.

    Attributes
    ----------
    dropped : int
        Number of datagrams not sent because the other end did not exist or did not receive for too
        long.
    note : str
        Newest status line of the other end.

    Raises
    ------
    ParameterError
        Another process uses this end.
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
        """Return the file descriptor to wait for; -1 once closed."""
        return self._socket.fileno()

    def send(self, datagram: bytes) -> bool:
        """Send waiting datagrams, then this; return whether the other end exists.

        Datagrams without room wait until the next call. Only one thread may call this.
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
        """Send a status line of this end, separate from the datagrams.

        Any thread may call this, as it does not use the waiting datagrams. Without room the line
        is lost.
        """
        with suppress(BlockingIOError, ConnectionRefusedError):
            self._socket.sendto(_NOTE + line.encode(), self._other)

    def drain(self) -> list[bytes]:
        """Return the datagrams received since the last call, oldest first."""
        taken = []
        with suppress(BlockingIOError):
            while True:
                datagram, sender = self._socket.recvfrom(LONGEST_DATAGRAM + 1)
                if sender != self._other or len(datagram) > LONGEST_DATAGRAM:
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
    """Return the address of an end, hashed, as namespaces may be longer than addresses."""
    digest = hashlib.sha256(namespace.encode()).hexdigest()
    return f"\0haptic_accel/{domain}/{end}/{digest}".encode()

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Datagrams of two hosts: on one host between half coupler and link, and with tags between hosts.

A tag authenticates a datagram by a shared key, which is in a file. The local sockets have
abstract names, which the kernel releases however a process ends; they are not visible outside the
machine.
"""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import socket
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from hmac import compare_digest
from pathlib import Path

from haptic_accel import ParameterError
from haptic_accel.core.parameters import shown
from haptic_accel.core.topics import ARMS

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


LINK_KEY = "link.key"
"""Name of the key file in each host's folder."""

TITLE = "haptic_accel link key: a secret of two hosts, to be read by their users alone"
"""First line of the file; the key follows in hexadecimal."""

KEY_LENGTH = 32
"""Length of a key, bytes: too long to guess."""

TAG_LENGTH = 16
"""Length of a tag, bytes: one of 2^128 values is valid."""

_LONGEST_FILE = 1000


class Authenticator:
    """Authenticator of datagrams by a tag, from which the peer verifies their origin.

    The tag is keyed BLAKE2b (RFC 7693) of the complete datagram, for the sending side and its
    graph's namespace. A datagram that is reflected to its sender, or forwarded to another graph
    with the same key, is therefore rejected. Sessions and numbers inside the datagram prevent
    replays; see `kits.link.endpoint`.

    Parameters
    ----------
    key : bytes
        Key of `KEY_LENGTH`; empty for none, which allows anybody to make tags.
    side : str
        Side of this host, from `ARMS`.
    namespace : str
        Namespace of the graphs on both hosts.

    Examples
    --------
    >>> master, slave = (Authenticator(bytes(32), side) for side in ("master", "slave"))
    >>> slave.verified(master.tagged(b"felt")), slave.verified(slave.tagged(b"felt"))
    (b'felt', None)
    """

    def __init__(self, key: bytes, side: str, namespace: str = "/") -> None:
        (other,) = set(ARMS) - {side}
        salt = hashlib.blake2b(namespace.encode(), digest_size=hashlib.blake2b.SALT_SIZE).digest()
        # The key fills one of the two blocks to compress, and is processed once.
        self._own, self._peer = (
            hashlib.blake2b(
                key=key, digest_size=TAG_LENGTH, salt=salt, person=f"link from {each}".encode()
            )
            for each in (side, other)
        )

    def tagged(self, datagram: bytes) -> bytes:
        """Return a datagram with its tag, for transmission."""
        tag = self._own.copy()
        tag.update(datagram)
        return datagram + tag.digest()

    def verified(self, data: bytes) -> bytes | None:
        """Return a received datagram without its tag; None if the tag is invalid."""
        datagram = data[:-TAG_LENGTH]
        tag = self._peer.copy()
        tag.update(datagram)
        return datagram if compare_digest(tag.digest(), data[-TAG_LENGTH:]) else None


def write_new(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by name, readable by the owner only, to a folder without such files."""
    for name, content in files.items():
        new = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(new, "wb") as file:
            file.write(content)


def write_new_key(*folders: Path) -> None:
    """Write a new key, readable by the owner only, to folders without a key."""
    text = f"{TITLE}\n{secrets.token_hex(KEY_LENGTH)}\n"
    for folder in folders:
        write_new(folder, {LINK_KEY: text.encode("ascii")})


def read_key(folder: str) -> bytes:
    """Return the key from a folder.

    Raises
    ------
    ParameterError
        The file cannot be read, is readable by others, or contains no key.
    """
    path = Path(folder, LINK_KEY)
    try:
        # Non-blocking, so that a FIFO in place of the file does not block.
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            mode, data = os.fstat(file.fileno()).st_mode, file.read(_LONGEST_FILE)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ParameterError(
            f"keys = {shown(repr(folder))}: {LINK_KEY}: {reason}; run haptic-accel keys to make it"
        ) from None
    if mode & 0o077:
        raise ParameterError(f"{path}: others can read it: must be for its owner alone, chmod 600")
    title, _, key = data.decode("ascii", "replace").strip().partition("\n")
    try:
        found = bytes.fromhex(key)
    except ValueError:
        found = b""
    if title.strip() != TITLE or len(found) != KEY_LENGTH:
        raise ParameterError(f"{path}: must be a key that haptic-accel keys made")
    return found

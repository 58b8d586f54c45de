# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Authentication of datagrams between two hosts by a shared key, and the key's file."""

from __future__ import annotations

import hashlib
import os
import secrets
from hmac import compare_digest
from pathlib import Path

from haptic_accel import ParameterError
from haptic_accel.core.parameters import shown
from haptic_accel.core.topics import ARMS

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
    replays; see `core.network.endpoint`.

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


def write_new_key(*folders: Path) -> None:
    """Write a new key, readable by the owner only, to folders without a key."""
    text = f"{TITLE}\n{secrets.token_hex(KEY_LENGTH)}\n"
    for folder in folders:
        new = os.open(folder / LINK_KEY, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(new, "w", encoding="ascii") as file:
            file.write(text)


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

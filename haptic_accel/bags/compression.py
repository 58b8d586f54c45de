# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Decompression of bags, by the libraries of rosbags, with a limit on the expanded size."""

from __future__ import annotations

import sys
from pathlib import Path

from haptic_accel.core.files import opened

if sys.version_info >= (3, 14):
    from compression import zstd as zstd
else:
    from backports import zstd as zstd  # the library of rosbags


LARGEST_RECORD = 1 << 26
"""Maximum size of a record, chunk or message, bytes; rosbag2's chunks have 768 KiB."""

ZSTD = bytes.fromhex("28b52ffd")
"""First bytes of a frame of Zstandard (RFC 8878)."""

PART = 1 << 20
"""Number of bytes decompressed at a time."""

ALWAYS = 1 << 26
"""Expanded size permitted for any file, bytes."""

RATIO = 100
"""Additional permitted bytes per byte of a file; its signals expand by a factor of two to ten."""

LARGEST_FILE = 1 << 50
"""Maximum size of a file, bytes; practically unlimited, as files are read in parts."""


class Allowance:
    """Limit on the total expanded size of a file's parts."""

    def __init__(self, path: Path) -> None:
        with opened(path, LARGEST_FILE):  # rejects what is not a file
            self._most = self._left = ALWAYS + RATIO * path.stat().st_size

    def spend(self, size: int) -> None:
        """Count decompressed bytes.

        Raises
        ------
        ValueError
            The limit is exceeded.
        """
        self._left -= size
        if self._left < 0:
            raise ValueError(f"it expands to more than {self._most} bytes")


def decompressed_file(path: Path, folder: Path) -> Path:
    """Decompress a file, compressed as a whole by rosbag2, to a folder.

    Raises
    ------
    ValueError, EOFError, ZstdError
        The file exceeds the limit, or is damaged.
    OSError
        The file cannot be read, or the result cannot be written.
    """
    allowance, target = Allowance(path), folder / path.stem
    with opened(path, LARGEST_FILE) as source, zstd.open(source) as parts, target.open("wb") as to:
        while part := parts.read(PART):
            allowance.spend(len(part))
            to.write(part)
    return target


def decompressed_message(content: bytes) -> bytes:
    """Decompress a message.

    Raises
    ------
    ValueError, ZstdError
        The message is damaged or too large.
    """
    decompressor = zstd.ZstdDecompressor()
    found = decompressor.decompress(content, LARGEST_RECORD)
    if not decompressor.eof:
        raise ValueError(f"a message is incomplete, or has more than {LARGEST_RECORD} bytes")
    return found

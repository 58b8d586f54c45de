# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compressed parts of bags, which may expand to any size: counted, and ended at a bound."""

from __future__ import annotations

from pathlib import Path

from haptic_accel.bags.rosbags_adapter import zstd
from haptic_accel.core.bounded_files import opened

LARGEST = 1 << 26
"""Largest record, chunk and message that are read, bytes: rosbag2's chunks have 768 KiB."""

PART = 1 << 20
"""Bytes that are decompressed in one go."""

ALWAYS = 1 << 26
"""Bytes to which any file may expand."""

RATIO = 100
"""Bytes more for each byte of a file: its signals expand to two to ten times."""

LARGEST_FILE = 1 << 40
"""Size of the largest file that is decompressed as a whole, bytes."""


class Allowance:
    """Bytes to which the parts of a file may expand together."""

    def __init__(self, path: Path) -> None:
        self._most = self._left = ALWAYS + RATIO * path.stat().st_size

    def spend(self, size: int) -> None:
        """Count what is decompressed.

        Raises
        ------
        ValueError
            It is more than is allowed.
        """
        self._left -= size
        if self._left < 0:
            raise ValueError(f"it expands to more than {self._most} bytes")


def decompressed_file(path: Path, folder: Path) -> Path:
    """Decompress a file that rosbag2 compressed as a whole, into a folder.

    Raises
    ------
    ValueError, EOFError, ZstdError
        It expands to more than is allowed, or is damaged.
    OSError
        It cannot be read, or the other not be written.
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
        It is damaged, or larger than is read.
    """
    decompressor = zstd.ZstdDecompressor()
    found = decompressor.decompress(content, LARGEST)
    if not decompressor.eof:
        raise ValueError(f"a message is cut off, or has more than {LARGEST} bytes")
    return found

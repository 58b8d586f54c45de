# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names of files in a bag's folder; fast to import."""

from __future__ import annotations

import os
import re
from pathlib import Path

from haptic_accel.core.parameters import ParameterError

METADATA = "metadata.yaml"
MCAP = ".mcap"
SQLITE = ".db3"
COMPRESSED = ".zstd"
"""Second suffix of a file that rosbag2 compressed as a whole."""

MUST_BE = "must be a bag: it has no .mcap or .db3 file"
"""Message for a folder without a bag's files."""


def is_storage(path: Path) -> bool:
    """Return whether a path has the name of a bag's file, compressed or not."""
    return path.name.removesuffix(COMPRESSED).endswith((MCAP, SQLITE))


def storage_files(folder: Path) -> list[Path]:
    """Return a bag's files, compressed or not, in order of the numbers in their names."""
    found = [path for path in folder.iterdir() if path.is_file() and is_storage(path)]
    return sorted(found, key=_numbers)


def find_bags(path: Path) -> list[Path]:
    """Return the bags at a path, sorted by name.

    Parameters
    ----------
    path : Path
        Folder of a bag, one of its files, or a folder to search for bags recursively.

    Raises
    ------
    ParameterError
        The path does not exist, or contains no bag.
    """
    if not os.path.exists(path):
        raise ParameterError(f"{path}: no such file or folder")
    if not path.is_dir():
        return [path]
    # Links are not followed, as they may form a cycle.
    folders = sorted(f for f in path.rglob("*") if f.is_dir() and not f.is_symlink())
    found = [
        each for each in (path, *folders) if os.path.isfile(each / METADATA) or storage_files(each)
    ]
    if not found:
        raise ParameterError(f"{path}: must be a bag, or a folder with bags in it")
    return found


def is_being_written(path: Path) -> bool:
    """Return whether a program on this machine has a file open for writing.

    The kernel refuses a read lease on such a file, and grants it as soon as the program has closed
    the file or ended. The result is False where leases do not exist, as on Windows or on some
    network drives.
    """
    try:
        import fcntl

        with path.open("rb") as file:
            fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK)
            fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except (OSError, AttributeError, ImportError) as error:
        return isinstance(error, BlockingIOError)
    return False


def free_name(path: Path) -> Path:
    """Return the first of a path, ``path-2``, ``path-3`` and so on that does not exist."""
    found, number = path, 2
    while found.exists():
        found = path.with_name(f"{path.name}-{number}")
        number += 1
    return found


def listed_name(name: str) -> str:
    """Return a file's name as UTF-8 text; other bytes are replaced."""
    return os.fsencode(name).decode(errors="replace")


def _numbers(path: Path) -> list[tuple[int, str]]:
    """Return a sort key of a name that compares the numbers in it by value."""
    parts = enumerate(re.split("([0-9]+)", path.name))
    return [(int(part) if index % 2 else 0, part) for index, part in parts]

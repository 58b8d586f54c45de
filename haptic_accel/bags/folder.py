"""Names of the files in a bag's folder; light to import."""

from __future__ import annotations

from pathlib import Path

METADATA = "metadata.yaml"
MCAP = ".mcap"
SQLITE = ".db3"
COMPRESSED = ".zstd"
"""Second suffix of a file that rosbag2 compressed as a whole."""

MUST_BE = "must be a bag: it has no .mcap or .db3 file"
"""Complaint about a folder without a bag's files."""


def is_storage(path: Path) -> bool:
    """Return whether a path has the name of a bag's file, compressed or not."""
    return path.name.removesuffix(COMPRESSED).endswith((MCAP, SQLITE))


def storage_files(folder: Path) -> list[Path]:
    """Return the files of a bag in the order of their numbers, compressed ones too."""
    found = [path for path in folder.iterdir() if path.is_file() and is_storage(path)]
    return sorted(found, key=lambda path: (_number(path), path.name))


def is_bag(folder: Path) -> bool:
    """Return whether a folder holds a bag."""
    return (folder / METADATA).is_file() or bool(storage_files(folder))


def free_name(path: Path) -> Path:
    """Return a path, or the first of ``path-2``, ``path-3`` and so on, that does not exist."""
    found, number = path, 2
    while found.exists():
        found = path.with_name(f"{path.name}-{number}")
        number += 1
    return found


def _number(path: Path) -> int:
    """Return the number of a split, as in ``name_10.mcap``."""
    digits = path.name.split(".")[0].rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0

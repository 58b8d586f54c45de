# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files and folders that are complete on disk at all times."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory


def sync_folder(path: Path) -> None:
    """Flush a folder's directory entries to disk (fsync)."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def replace_file(path: Path, content: bytes) -> None:
    """Write a new file to disk, then replace the present file by it.

    Raises
    ------
    OSError
        The file cannot be written; an earlier file remains.
    """
    new = path.with_name(path.name + ".tmp")
    with new.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder, which is renamed to `path` once all its content is on disk.

    After an error or an interruption nothing remains; a killed process leaves a hidden folder next
    to `path`.

    Parameters
    ----------
    path : Path
        New folder.

    Raises
    ------
    OSError
        The folder exists already, or cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as temporary:
        folder = Path(temporary, path.name)
        folder.mkdir()
        yield folder
        for file in (each for each in folder.rglob("*") if each.is_file()):
            with file.open("rb") as written:
                os.fsync(written.fileno())
        path.mkdir()  # fails if the folder was created meanwhile
        folder.rename(path)
        sync_folder(path.parent)

"""Finds bags: those named, and those in folders named."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from haptic_accel.bags.folder import is_bag
from haptic_accel.core.parameters import ParameterError


def find_bags(path: Path) -> list[Path]:
    """Return the bags at a place, in order of their names.

    Parameters
    ----------
    path : Path
        A bag's folder, one of its files, or a folder in which to look for bags, however deep.

    Raises
    ------
    ParameterError
        There is nothing, or no bag below it.
    """
    if not path.exists():
        raise ParameterError(f"{path}: no such file or folder")
    if not path.is_dir() or is_bag(path):
        return [path]
    found = [folder for folder in _folders(path) if is_bag(folder)]
    if not found:
        raise ParameterError(f"{path}: must be a bag, or a folder with bags in it")
    return found


def _folders(path: Path) -> Iterable[Path]:
    """Return all folders below one, sorted; links are not followed, they may lead in a ring."""
    return sorted(f for f in path.rglob("*") if f.is_dir() and not f.is_symlink())

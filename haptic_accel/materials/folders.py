# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Paths of the package's own files; fast to import."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from haptic_accel.core.parameters import ParameterError


def share_folder() -> Path:
    """Return the folder that contains ``config`` and ``launch``.

    Code in a checkout uses the checkout. Installed code uses the nearest ``share/haptic_accel`` in
    a folder above it: pip and colcon both install code and data below one prefix, on every system.

    Raises
    ------
    FileNotFoundError
        The installation is incomplete.
    """
    code = Path(__file__).resolve().parents[1]
    checkout = code.parent
    for folder in (checkout, *(above / "share" / code.name for above in code.parents)):
        if (folder / "package.xml").is_file():
            return folder
    message = "no share/haptic_accel in any folder above: reinstall haptic_accel"
    raise FileNotFoundError(errno.ENOENT, message, str(code))


def config_folder() -> Path:
    """Return the folder of parameter files."""
    return share_folder() / "config"


def is_recording(surface: str) -> bool:
    """Return true if a surface is specified by a recording: any file except ``.yaml``."""
    return Path(surface).suffix not in ("", ".yaml")


def preset_file(kind: str, name: str, folder: Path = Path()) -> Path:
    """Return a file of the package by name, or a file of the user.

    Parameters
    ----------
    kind : str
        One of rig, surface, scene or texture.
    name : str
        Name of a file in ``config/<kind>s``, or a path ending in ``.yaml`` or ``.npz``; for a
        surface also the path of a recording.
    folder : Path
        Folder for relative paths; default: current folder.

    Raises
    ------
    ParameterError
        The file does not exist.
    """
    known = {path.stem: path for path in sorted((config_folder() / f"{kind}s").glob("*.yaml"))}
    if name in known:
        return known[name]
    path = folder / name
    played = kind == "surface" and is_recording(name)
    if (played or path.suffix in (".yaml", ".npz")) and os.path.isfile(path):
        return path.absolute()
    files = ".yaml, .csv or .wav" if kind == "surface" else ".yaml"
    argument = "surface" if kind == "scene" else Path(kind).name
    raise ParameterError(
        f"{argument} = {name!r}: must be one of {', '.join(known)}, or a {files} file"
    )

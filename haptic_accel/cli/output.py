# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that verbs write."""

from __future__ import annotations

import json
import os
from datetime import datetime
from pathlib import Path
from typing import Any

from haptic_accel.core.parameters import ParameterError


def save(metrics: Any, json_file: Path | None) -> None:
    """Write metrics as JSON, if a file was given."""
    if json_file:
        json_file.write_text(json.dumps(metrics, indent=2) + "\n", encoding="utf-8")


def results_folder(out: Path | None, prefix: str = "") -> Path:
    """Make and return the folder of a report: the one given, or ``results/<date and time>``.

    Raises
    ------
    ParameterError
        It exists already or cannot be made.
    """
    return make_folder(out or Path("results") / f"{prefix}{datetime.now():%Y-%m-%d_%H-%M-%S}")


def make_folder(folder: Path) -> Path:
    """Make and return a new folder.

    Raises
    ------
    ParameterError
        It exists already or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=False)
    except FileExistsError:
        raise ParameterError(f"out = '{folder}': must be a new folder") from None
    except OSError as error:
        raise ParameterError(f"out = '{folder}': {error.strerror}") from None
    return folder


def check_writable(file: Path, name: str = "json") -> None:
    """Refuse a file that cannot be written, before anything runs for it.

    Raises
    ------
    ParameterError
        The file cannot be opened; with the reason.
    """
    new = not os.path.exists(file)
    try:
        file.open("a", encoding="utf-8").close()
    except OSError as error:
        raise ParameterError(f"{name} = '{file}': {error.strerror}") from None
    if new:
        file.unlink()

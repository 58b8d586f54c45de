# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Files that verbs write, and lines for a terminal."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from haptic_accel.core.bounded_files import located
from haptic_accel.core.decimals import defined
from haptic_accel.core.parameters import ParameterError, printable

LINE_ENDS = "\n\t"
"""Controls that lines for a terminal have."""


@contextmanager
def printable_output() -> Iterator[None]:
    """Escape control characters on the standard streams, as names in files may hold some.

    The streams stay the same objects. Coloured output of `rich`, escaped by `print_table`, is not
    changed.
    """
    with ExitStack() as stack:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and not hasattr(stream, "rich_proxied_file"):
                write = stream.write
                # By this name rich looks for the stream behind another.
                setattr(stream, "rich_proxied_file", _Unescaped(stream, write))  # noqa: B010
                setattr(stream, "write", _escaping(write))  # noqa: B010
                stack.callback(delattr, stream, "rich_proxied_file")
                stack.callback(delattr, stream, "write")
        yield


def _escaping(write: Callable[[str], int]) -> Callable[[str], int]:
    return lambda text: write(printable(text, LINE_ENDS))


class _Unescaped:
    """A stream with the `write` that it had before."""

    def __init__(self, stream: Any, write: Callable[[str], int]) -> None:
        self._stream = stream
        self.write = write

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def next_command(*words: str, host: str = "") -> str:
    """Return the line with the command that naturally follows, on this host or another one.

    Examples
    --------
    >>> next_command("analyze", "my bags")
    "next: haptic-accel analyze 'my bags'"
    """
    return f"next{f' on {host}' if host else ''}: {shlex.join(['haptic-accel', *words])}"


def save(metrics: Any, json_file: Path | None) -> None:
    """Write metrics as JSON, if a file was given; undefined numbers are null."""
    if json_file:
        text = json.dumps(defined(metrics), indent=2, allow_nan=False)
        json_file.write_text(f"{text}\n", encoding="utf-8")


def results_folder(out: Path | None, prefix: str = "", unfinished: str = "") -> Path:
    """Make and return the folder of a report: the one given, or ``results/<date and time>``.

    Parameters
    ----------
    out : Path or None
    prefix : str
        Text before date and time.
    unfinished : str
        Name of the file of an unfinished run, whose folder may exist; empty for none.

    Raises
    ------
    ParameterError
        It exists already or cannot be made.
    """
    if out and unfinished and (out / unfinished).is_file():
        return out
    return make_folder(out or Path("results") / f"{prefix}{datetime.now():%Y-%m-%d_%H-%M-%S}")


def make_folder(folder: Path) -> Path:
    """Make and return a new folder.

    Raises
    ------
    ParameterError
        It exists already or cannot be made.
    """
    with located(f"out = '{folder}'", unreadable=""):
        try:
            folder.mkdir(parents=True, exist_ok=False)
        except FileExistsError:
            raise ParameterError("must be a new folder") from None
    return folder


def check_writable(file: Path, name: str = "json") -> None:
    """Refuse a file that cannot be written, before anything runs for it.

    Raises
    ------
    ParameterError
        The file cannot be opened; with the reason.
    """
    new = not os.path.exists(file)
    with located(f"{name} = '{file}'", unreadable=""):
        file.open("a", encoding="utf-8").close()
    if new:
        file.unlink()

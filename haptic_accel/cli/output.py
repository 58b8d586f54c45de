# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that verbs write, and lines for a terminal."""

from __future__ import annotations

import errno
import io
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from haptic_accel.core.bounded_files import located
from haptic_accel.core.parameters import ParameterError, defined, printable
from haptic_accel.core.process import FAILED


class StoppedError(Exception):
    """Error that ends a verb early.

    Parameters
    ----------
    line : str
        Reason for the terminal; empty if it has been shown.
    status : int
        Exit status.
    """

    def __init__(self, line: str = "", status: int = FAILED) -> None:
        super().__init__(line)
        self.status = status


LINE_ENDS = "\n\t"
"""Controls that lines for a terminal have."""

UNABLE = ("strict", "surrogateescape")
"""Error handlers of streams that refuse characters which the encoding lacks: Python's default, and
that of the locale C."""

GONE = (errno.EPIPE, errno.EIO)
"""Errors of output whose reader has gone, or whose terminal was closed: an end like any other."""


@contextmanager
def printable_output() -> Iterator[None]:
    """Keep a verb running despite unprintable text, or an output without a reader.

    Control characters are escaped, as names in files may hold some, and characters that the
    terminal's encoding lacks. Output that cannot be written is dropped. The streams stay the same
    objects. Coloured output of `rich`, escaped by `print_table`, is not changed.

    Raises
    ------
    OSError
        At the end, if output was dropped for another reason than that its reader has gone.
    """
    lost: list[OSError] = []
    with ExitStack() as stack:
        streams = [stream for stream in (sys.stdout, sys.stderr) if stream is not None]
        for stream in streams:
            if isinstance(stream, io.TextIOWrapper) and stream.errors in UNABLE:
                stack.callback(stream.reconfigure, errors=stream.errors)
                stream.reconfigure(errors="backslashreplace")
            if not hasattr(stream, "rich_proxied_file"):
                write = _dropping(stream, stream.write, lost)
                # By this name rich looks for the stream behind another.
                setattr(stream, "rich_proxied_file", _Unescaped(stream, write))  # noqa: B010
                setattr(stream, "write", lambda t, to=write: to(printable(t, LINE_ENDS)))  # noqa: B010
                setattr(stream, "flush", _dropping(stream, stream.flush, lost))  # noqa: B010
                for name in ("rich_proxied_file", "write", "flush"):
                    stack.callback(delattr, stream, name)
        yield
        for stream in streams:
            stream.flush()
    if lost and lost[0].errno not in GONE:
        raise lost[0]


def _dropping(stream: Any, act: Callable[..., Any], lost: list[OSError]) -> Callable[..., Any]:
    """Return a stream's write or flush that notes an error, and then drops output."""

    def call(*text: str) -> Any:
        try:
            return act(*text)
        except BlockingIOError:  # as of a terminal of another program, whose flag may change
            raise
        except OSError as error:
            lost.append(error)
            drop_output(stream)
            return len("".join(text))

    return call


def drop_output(stream: Any) -> None:
    """Redirect a standard stream to the null device: Python would repeat a failed write."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)


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
    line = " ".join(map(quoted, ["haptic-accel", *words]))
    return f"next{f' on {host}' if host else ''}: {line}"


def quoted(word: str) -> str:
    r"""Return a word for a shell, also where it cannot be shown as it is.

    Examples
    --------
    >>> print(quoted("my bags"), quoted("caf\udce9"), quoted("a\nb's"))
    'my bags' $'caf\xe9' $'a\nb\'s'
    """
    if word.isprintable():
        return shlex.quote(word)
    # Bash's form; other bytes than of ASCII, which the locale may not know, by number.
    escaped = repr(os.fsencode(word) + b'"').removesuffix("\"'")[2:]
    return f"$'{escaped}'"


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


@contextmanager
def removed_if_empty(folder: Path) -> Iterator[None]:
    """Remove a new folder after an error before anything was written into it."""
    try:
        yield
    except BaseException:
        with suppress(OSError):  # it holds something
            folder.rmdir()
        raise


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

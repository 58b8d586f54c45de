# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that commands write, and lines for a terminal."""

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

from haptic_accel.core.files import located
from haptic_accel.core.parameters import ParameterError, defined, printable
from haptic_accel.core.process import FAILED


class StoppedError(Exception):
    """Error that ends a command early.

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
"""Control characters that are allowed in output to a terminal."""

UNABLE = ("strict", "surrogateescape")
"""Error handlers of streams that raise an error for characters missing in the encoding: Python's
default, and that of the locale C."""

GONE = (errno.EPIPE, errno.EIO)
"""Errors of output whose reader has gone or whose terminal was closed, which count as a normal
end."""


@contextmanager
def printable_output() -> Iterator[None]:
    """Keep a command running despite unprintable text or output without a reader.

    Control characters, which names in files may contain, and characters missing in the terminal's
    encoding are escaped. Output that cannot be written is dropped. The stream objects stay the
    same. Coloured output of `rich`, escaped by `print_table`, is not changed.

    Raises
    ------
    OSError
        Raised at the end if output was dropped, except for a missing reader.
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
                # rich finds the original stream by this attribute.
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
    """Return a stream's write or flush that records an error, and then drops output."""

    def call(*text: str) -> Any:
        try:
            return act(*text)
        except BlockingIOError:  # another program has set the flag of a shared terminal
            raise
        except OSError as error:
            lost.append(error)
            drop_output(stream.fileno())
            return len("".join(text))

    return call


def drop_output(descriptor: int) -> None:
    """Redirect a standard stream to the null device, as Python would repeat a failed write."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


class _Unescaped:
    """Stream with its original `write`."""

    def __init__(self, stream: Any, write: Callable[[str], int]) -> None:
        self._stream = stream
        self.write = write

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def next_command(*arguments: str, host: str = "") -> str:
    """Return a line with the usual next command, on this host or another one.

    Examples
    --------
    >>> next_command("analyze", "my bags")
    "next: haptic-accel analyze 'my bags'"
    """
    line = " ".join(map(quoted, ["haptic-accel", *arguments]))
    return f"next{f' on {host}' if host else ''}: {line}"


def quoted(word: str) -> str:
    r"""Return a word quoted for a shell, with escapes for characters that cannot be shown.

    Examples
    --------
    >>> print(quoted("my bags"), quoted("caf\udce9"), quoted("a\nb's"))
    'my bags' $'caf\xe9' $'a\nb\'s'
    """
    if word.isprintable():
        return shlex.quote(word)
    # Use Bash's $'' quoting; write non-ASCII bytes, which the locale may lack, by number.
    escaped = repr(os.fsencode(word) + b'"').removesuffix("\"'")[2:]
    return f"$'{escaped}'"


def save(metrics: Any, json_file: Path | None) -> None:
    """Write metrics as JSON if a file is specified; undefined numbers are null."""
    if json_file:
        text = json.dumps(defined(metrics), indent=2, allow_nan=False)
        json_file.write_text(f"{text}\n", encoding="utf-8")


def results_folder(out: Path | None, prefix: str = "", unfinished: str = "") -> Path:
    """Make and return the folder of a report: `out`, or ``results/<date and time>``.

    Parameters
    ----------
    out : Path or None
    prefix : str
        Text before date and time.
    unfinished : str
        File that marks an unfinished run, whose folder may exist; empty for none.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be made.
    """
    if out and unfinished and (out / unfinished).is_file():
        return out
    return make_folder(out or Path("results") / f"{prefix}{datetime.now():%Y-%m-%d_%H-%M-%S}")


@contextmanager
def removed_if_empty(folder: Path) -> Iterator[None]:
    """Remove a new folder if an error occurs before anything was written to it."""
    try:
        yield
    except BaseException:
        with suppress(OSError):  # the folder is not empty
            folder.rmdir()
        raise


def make_folder(folder: Path) -> Path:
    """Make and return a new folder.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be made.
    """
    with located(f"out = '{folder}'", unreadable=""):
        try:
            folder.mkdir(parents=True, exist_ok=False)
        except FileExistsError:
            raise ParameterError("must be a new folder") from None
    return folder


def check_writable(file: Path, name: str = "json") -> None:
    """Refuse a file that cannot be written, before a run.

    Raises
    ------
    ParameterError
        The file cannot be opened; the message has the reason.
    """
    new = not os.path.exists(file)
    with located(f"{name} = '{file}'", unreadable=""):
        file.open("a", encoding="utf-8").close()
    if new:
        file.unlink()

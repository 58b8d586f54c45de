# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads files that may be anything, in bounded time and memory.

All readers of a user's files begin here. A file that is none, or too large, is an `OSError` whose
``strerror`` says so: it is refused wherever one that is missing is.
"""

from __future__ import annotations

import errno
import io
import itertools
import json
import os
import stat
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from haptic_accel.core.parameters import ParameterError, shown

LARGEST_TEXT = 1 << 22
"""Largest file of text that is read as a whole, bytes: a metadata.yaml of ten thousand files has
half of it. Its content takes up to a hundred times as much memory."""

DEEPEST = 32
"""Levels of nesting that are read; no format here has more than ten."""

MOST_VALUES = 200_000
"""Values, names and collections that are read, each of which takes a kilobyte and 10 us: a bag of
ten thousand files has 150,000."""

BLOCK = 1 << 16
"""Bytes that are parsed in one go."""


@contextmanager
def located(
    place: object, form: str = "", unreadable: str = "must be a readable file: "
) -> Iterator[None]:
    """Refuse a file in one line that begins with its place.

    Parameters
    ----------
    place : object
        File, or another beginning of the message.
    form : str
        Form that the file must have, for an error of its reader.
    unreadable : str
        Text before the reason of an `OSError`.

    Raises
    ------
    ParameterError
        In place of any `OSError` or `ValueError`; a `ParameterError` states its reason itself.
    """
    try:
        yield
    except ParameterError as error:
        raise ParameterError(f"{place}: {error}") from None
    except OSError as error:
        raise ParameterError(f"{place}: {unreadable}{error.strerror}") from None
    except ValueError as error:
        if not form:
            raise
        raise ParameterError(f"{place}: {form}: {shown(str(error))}") from None


@contextmanager
def opened(path: str | os.PathLike[str], largest: int) -> Iterator[io.BufferedReader]:
    """Open a regular file to read; nothing else is waited for.

    Parameters
    ----------
    path : str or path-like
    largest : int
        Size up to which it is opened, bytes.

    Raises
    ------
    OSError
        It is not there, not a regular file, or too large.
    """
    try:
        # Without waiting for the other end of a pipe.
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError as error:  # a NUL in the name
        raise OSError(errno.EINVAL, str(error)) from None
    try:
        status = os.fstat(number)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is not a regular file")
        _check_size(status.st_size, largest)
        with open(number, "rb", closefd=False) as file:
            yield file
    finally:
        os.close(number)


def read_bytes(path: str | os.PathLike[str], largest: int = LARGEST_TEXT) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        As `opened`.
    """
    with opened(path, largest) as file:
        content = file.read(largest + 1) or b""  # nothing yet, in /proc
        _check_size(len(content), largest)
        return content


def read_text(path: str | os.PathLike[str], encoding: str = "utf-8") -> str:
    """Return the text of a file of at most `LARGEST_TEXT` bytes.

    Raises
    ------
    OSError
        As `opened`.
    UnicodeDecodeError
        It is not text.
    """
    return read_bytes(path).decode(encoding)


def read_json(path: Path) -> Any:
    """Return what a file of JSON holds.

    Raises
    ------
    OSError
        As `opened`.
    ValueError
        It is not JSON, is nested deeper than `DEEPEST` levels, or has too many values.
    """
    try:
        content = json.loads(read_text(path, "utf-8-sig"))
    except RecursionError:
        raise _too_deep() from None
    level: list[Any] = [content]
    values = 0
    for _ in range(DEEPEST + 1):
        values += len(level)
        if values > MOST_VALUES:
            raise ValueError(f"it has more than {MOST_VALUES} values")
        nested = [each for each in level if isinstance(each, (dict, list))]
        if not nested:
            return content
        rows = (each.values() if isinstance(each, dict) else each for each in nested)
        level = list(itertools.chain.from_iterable(rows))
    raise _too_deep()


def read_xml(path: Path) -> ElementTree.Element:
    """Return the root of a file of XML, which has no document type and so no entities.

    Raises
    ------
    OSError
        As `opened`.
    ValueError
        It is not XML, has a document type, or is nested deeper than `DEEPEST` levels.
    """
    parser = ElementTree.XMLParser(target=_Elements())
    content = memoryview(read_bytes(path))
    try:
        for place in range(0, len(content), BLOCK):
            parser.feed(bytes(content[place : place + BLOCK]))
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, LookupError, AssertionError) as error:
        # Encodings that Python does not have, too.
        raise ValueError(str(error)) from None
    return root


class _Elements(ElementTree.TreeBuilder):
    """Builder of a tree that is not too deep."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, _name: str, _public: str, _system: str) -> None:
        """Refuse a document type, whose entities may stand for any amount of text."""
        raise ValueError("it has a document type, which is not read")

    def start(self, tag: Any, attributes: Any) -> ElementTree.Element:
        """Begin an element."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise _too_deep()
        return super().start(tag, attributes)

    def end(self, tag: Any) -> ElementTree.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def _too_deep() -> ValueError:
    return ValueError(f"it is nested deeper than {DEEPEST} levels")


def _check_size(size: int, largest: int) -> None:
    if size > largest:
        raise OSError(errno.EFBIG, f"has {size} bytes or more, and may have {largest}")

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files: bounded readers of untrusted ones, and writers that leave only complete ones on disk.

All readers of user files start here. A file that is irregular or too large raises an `OSError`
with the reason in ``strerror``. It is thus rejected like a missing file.
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
from tempfile import TemporaryDirectory
from typing import Any

from haptic_accel.core.parameters import ParameterError, shown

LARGEST_TEXT = 1 << 22
"""Maximum size of a text file that is read as a whole, bytes: twice a metadata.yaml of ten
thousand files. The parsed content takes up to a hundred times as much memory."""

DEEPEST = 32
"""Maximum nesting depth; no format here needs more than ten."""

TOO_DEEP = f"it is nested deeper than {DEEPEST} levels"

MOST_VALUES = 200_000
"""Maximum number of values, names and collections. Each takes a kilobyte and 10 us; a bag of ten
thousand files has 150,000."""

BLOCK = 1 << 16
"""Number of bytes parsed at a time."""


POINTER = b"version https://git-lfs.github.com/spec/"
"""First bytes of a text that Git keeps in place of a large file."""


@contextmanager
def located(
    location: object, form: str = "", unreadable: str = "must be a readable file: "
) -> Iterator[None]:
    """Convert errors into one-line messages that start with the file's name.

    Parameters
    ----------
    location : object
        File, or another start of the message.
    form : str
        Required form of the file, for errors of its reader.
    unreadable : str
        Text before the reason of an `OSError`.

    Raises
    ------
    ParameterError
        Replaces any `OSError` or `ValueError`; a `ParameterError` keeps its message.
    """
    try:
        yield
    except ParameterError as error:
        raise ParameterError(f"{location}: {error}") from None
    except OSError as error:
        raise ParameterError(f"{location}: {unreadable}{error.strerror}") from None
    except ValueError as error:
        if not form:
            raise
        raise ParameterError(f"{location}: {form}: {shown(str(error))}") from None


@contextmanager
def opened(path: str | os.PathLike[str], largest: int) -> Iterator[io.BufferedReader]:
    """Open a regular file for reading, without blocking, e.g. on a pipe.

    Parameters
    ----------
    path : str or path-like
    largest : int
        Maximum size, bytes.

    Raises
    ------
    OSError
        The file does not exist, is not a regular file, is too large, or is a pointer of Git LFS.
    """
    try:
        # Do not wait for the other end of a pipe.
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
            if file.peek(len(POINTER)).startswith(POINTER):
                reason = "is a pointer of Git LFS, not the file: get it with git lfs pull"
                raise OSError(errno.EINVAL, reason)
            yield file
    finally:
        os.close(number)


def read_bytes(path: str | os.PathLike[str], largest: int = LARGEST_TEXT) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        As for `opened`.
    """
    with opened(path, largest) as file:
        content = file.read(largest + 1) or b""  # 0 for files in /proc
        _check_size(len(content), largest)
        return content


def read_text(path: str | os.PathLike[str], encoding: str = "utf-8") -> str:
    """Return the text of a file of at most `LARGEST_TEXT` bytes.

    Raises
    ------
    OSError
        As for `opened`.
    UnicodeDecodeError
        The file is not text.
    """
    return read_bytes(path).decode(encoding)


def read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    OSError
        As for `opened`.
    ValueError
        The file is not JSON, is nested deeper than `DEEPEST` levels, or has too many values.
    """
    try:
        content = json.loads(read_text(path, "utf-8-sig"))
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    level, values = [content], 0
    for _ in range(DEEPEST + 1):
        values += len(level)
        if values > MOST_VALUES:
            raise ValueError(f"it has more than {MOST_VALUES} values")
        nested = [each for each in level if isinstance(each, (dict, list))]
        if not nested:
            return content
        rows = (each.values() if isinstance(each, dict) else each for each in nested)
        level = list(itertools.chain.from_iterable(rows))
    raise ValueError(TOO_DEEP)


def read_xml(path: Path) -> ElementTree.Element:
    """Return the root of an XML file without document type, and thus without entities.

    Raises
    ------
    OSError
        As for `opened`.
    ValueError
        The file is not XML, has a document type, or is nested deeper than `DEEPEST` levels.
    """
    parser = ElementTree.XMLParser(target=_Elements())
    content = memoryview(read_bytes(path))
    try:
        for start in range(0, len(content), BLOCK):
            parser.feed(bytes(content[start : start + BLOCK]))
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, LookupError, AssertionError) as error:
        # Includes encodings that Python does not support.
        raise ValueError(str(error)) from None
    return root


class _Elements(ElementTree.TreeBuilder):
    """Builder of a tree with bounded depth."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, _name: str, _public: str, _system: str) -> None:
        """Reject a document type, as its entities may expand to any amount of text."""
        raise ValueError("it has a document type, which is not allowed")

    def start(self, tag: Any, attributes: Any) -> ElementTree.Element:
        """Start an element."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise ValueError(TOO_DEEP)
        return super().start(tag, attributes)

    def end(self, tag: Any) -> ElementTree.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def _check_size(size: int, largest: int) -> None:
    if size > largest:
        raise OSError(errno.EFBIG, f"has {size} bytes or more; at most {largest} are allowed")


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

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arrays in files that lie about their size, or are none."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.materials.texture_files import LARGEST_FILE


def header(shape: Any, kind: str = "<f8", **others: Any) -> bytes:
    """Return the beginning of an NPY file that states a shape."""
    file = io.BytesIO()
    stated = {"descr": kind, "fortran_order": False, "shape": shape, **others}
    np.lib.format.write_array_header_2_0(file, stated)
    return file.getvalue()


def zipped(path: Path, *members: bytes, kind: int = zipfile.ZIP_DEFLATED) -> Path:
    """Write an NPZ file, whose members all are called data."""
    with zipfile.ZipFile(path, "w", kind) as file:
        for number, content in enumerate(members):
            file.writestr(f"data{number or ''}.npy", content)
    return path


def encrypted(path: Path) -> Path:
    content = bytearray(zipped(path, header((1,)) + bytes(8)).read_bytes())
    content[6] |= 1
    content[content.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(content)
    return path


def damaged(path: Path) -> Path:
    content = zipped(path, header((1000,)) + bytes(range(200)) * 40).read_bytes()
    path.write_bytes(content[:80] + b"\xff" * 20 + content[100:])
    return path


def commented(path: Path) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.comment = b"x" * 100
    return path


ZEROS = header((LARGEST_FILE,), "|u1") + bytes(LARGEST_FILE)
BOMBS: dict[str, Callable[[Path], Path]] = {
    "3 GB in 3 MB": lambda path: zipped(path, *[ZEROS] * 3),
    "a shape of 800 GB": lambda path: zipped(path, header((10**11,)) + bytes(10_000_000)),
    "texts of 4 GB": lambda path: zipped(path, header((1,), "<U1000000000") + bytes(10_000_000)),
    "a shape below 0": lambda path: zipped(path, header((-1, 8)) + bytes(64)),
    "no size for any number": lambda path: zipped(path, header((2**62,), "<U0")),
    "a header of 4 GB": lambda path: zipped(
        path, b"\x93NUMPY\2\0\xff\xff\xff\xff" + b" " * 50_000_000
    ),
    "a nested header": lambda path: zipped(path, b"\x93NUMPY\1\0\x10\x27" + b"(" * 10_000),
    "an open text in the header": lambda path: zipped(path, b"\x93NUMPY\1\0\4\0'''\n"),
    "more than 64 arrays": lambda path: zipped(path, *[header((1,)) + bytes(8)] * 65),
    "a million names": lambda path: zipped(path, *[b""] * 2000),
    "objects": lambda path: zipped(path, header((1,), "|O") + b"cos\nsystem\n(S'exit'\ntR."),
    "encrypted": encrypted,
    "damaged": damaged,
    "cut off": lambda path: zipped(path, header((9,)) + bytes(8)),
    "longer than stated": lambda path: zipped(path, header((1,)) + bytes(10**8)),
    "with a comment": commented,
    "LZMA": lambda path: zipped(path, header((1,)) + bytes(8), kind=zipfile.ZIP_LZMA),
}
"""Files that ran out of memory or time, or gave a traceback."""

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

"""Arrays in files: as NumPy writes them; what lies about its size is refused before it is read."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fuzzing import measured
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.textures.foreign import import_texture
from haptic_accel.materials.array_files import (
    LARGEST,
    MOST_MEMBERS,
    MOST_NUMBERS,
    read_array,
    read_arrays,
)
from haptic_accel.materials.sampled_shapes import Sampling, read_heights
from haptic_accel.materials.scenes import read_taps
from haptic_accel.materials.texture_files import read_texture

ARRAYS: dict[str, Any] = {
    "whole": np.arange(6, dtype=np.int16).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "one": np.float64(3.0),
    "texts": np.array(["left", "r\u00fcck"]),
    "truth": np.array([True, False]),
    "other order": np.array([1.5, 2.5], dtype=">f8"),
    "none": np.empty((0, 3)),
}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_are_read_as_they_were(tmp_path: Path, save: Callable[..., None]) -> None:
    save(tmp_path / "a.npz", **ARRAYS)
    found = read_arrays(tmp_path / "a.npz")
    assert list(found) == list(ARRAYS)
    for name, values in ARRAYS.items():
        np.testing.assert_array_equal(found[name], values)
        assert found[name].dtype == np.asarray(values).dtype
        np.save(tmp_path / "a.npy", values)
        np.testing.assert_array_equal(read_array(tmp_path / "a.npy"), values)


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


ZEROS = header((LARGEST,), "|u1") + bytes(LARGEST)
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


@pytest.mark.parametrize("kind", BOMBS)
def test_a_file_that_expands_or_is_none_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = BOMBS[kind](tmp_path / "a.npz")
    for read in (read_texture, read_taps, import_texture):
        with measured(megabytes=300), pytest.raises(ParameterError, match="a.npz: ") as refused:
            read(path)
        assert str(refused.value).isprintable()


def test_a_table_of_a_size_that_no_file_has_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "relief.npy"
    with path.open("wb") as file:
        file.write(header((30_000, 30_000)))
        file.truncate(6_500_000_000)
    with (
        measured(megabytes=300),
        pytest.raises(ParameterError, match="at most 67108864 are allowed"),
    ):
        read_heights(path, Sampling())
    for shape in ((30_000, 30_000), (MOST_NUMBERS + 1,)):
        path.write_bytes(header(shape) + bytes(1000))
        with measured(megabytes=300), pytest.raises(ParameterError, match="4000000 are allowed"):
            read_heights(path, Sampling())
    assert MOST_MEMBERS == 64


def test_a_pattern_of_many_events_is_refused(tmp_path: Path) -> None:
    strength = [{"ParameterID": "HapticIntensity", "ParameterValue": 0.5}]
    event = {"Time": 0, "EventType": "HapticContinuous", "EventParameters": strength}
    path = tmp_path / "a.ahap"
    for count, seconds, says in ((20_000, 0.01, "at most 10000 events"), (100, 60, "6000 s")):
        pattern = [{"Event": {**event, "EventDuration": seconds}}] * count
        path.write_text(json.dumps({"Pattern": pattern}))
        with measured(), pytest.raises(ParameterError, match=says):
            import_texture(path, calibration=1.0)

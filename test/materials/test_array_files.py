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

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archive_bombs import BOMBS, header
from fuzzing import measured
from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.array_files import MOST_MEMBERS, MOST_NUMBERS, read_array, read_arrays
from haptic_accel.materials.scenes import Sampling, read_heights, read_taps
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


@pytest.mark.parametrize("kind", BOMBS)
def test_a_file_that_expands_or_is_none_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = BOMBS[kind](tmp_path / "a.npz")
    for read in (read_texture, read_taps):
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

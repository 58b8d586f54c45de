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

"""Shapes from files: height fields, and meshes converted to distance grids."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from haptic_accel.core.bounded_files import located, read_bytes
from haptic_accel.core.bounded_work import OutOfBoundsError, run_bounded
from haptic_accel.core.model import vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.surfaces.sampled_shapes import DistanceGrid, HeightField
from haptic_accel.core.warning import warn_once
from haptic_accel.materials import mesh_baking
from haptic_accel.materials.array_files import read_array, read_arrays

MISSING_LIBRARY = "meshes need trimesh: pip install 'haptic_accel[mesh]'"

LARGEST_MESH = 1 << 26
"""Maximum size of a mesh file, bytes."""


@dataclass(frozen=True)
class Sampling(Checked):
    """Sampling of a shape from a file."""

    spacing: float = parameter(1e-3, "distance between two samples", "m", 1e-5, 0.1)
    scale: float = parameter(1.0, "length of the file's unit", "m", 1e-6, 1.0)


def read_heights(path: Path, sampling: Sampling) -> HeightField:
    """Read a table of heights by position along x and y.

    Parameters
    ----------
    path : Path
        NumPy array (.npy) of shape (n, m).
    sampling : Sampling
        Distance between two heights, and their unit.

    Raises
    ------
    ParameterError
        The file cannot be read, or is no such table.
    """
    with located(path, "must be an array of numbers"):
        heights = read_array(path)
        return HeightField(np.asarray(heights, dtype=float) * sampling.scale, sampling.spacing)


def read_mesh(path: Path, sampling: Sampling) -> DistanceGrid:
    """Read a mesh as a distance grid.

    This takes up to half a minute. The result is stored beside the mesh, in a file that ends in
    .npz.

    Parameters
    ----------
    path : Path
        STL, OBJ or another file readable by trimesh; the mesh must enclose a volume. Bodies that
        overlap are united.
    sampling : Sampling
        Distance between two samples, at most half of the thinnest part; and the unit.

    Raises
    ------
    ParameterError
        The file cannot be read, encloses no volume, or needs too many samples, or trimesh is
        missing.
    """
    with located(path):
        content = read_bytes(path, LARGEST_MESH)
    source = hashlib.sha256(content + repr(sampling).encode()).hexdigest()
    kept = path.with_name(path.name + ".npz")
    try:
        found: dict[str, Any] = dict(read_arrays(kept))
        if str(found["source"]) == source:
            return _grid(path, found, sampling)
    except (OSError, ValueError, KeyError):
        pass  # missing or damaged
    baked = _baked(path, sampling)
    with suppress(OSError):  # in a read-only folder the grid is computed each time
        np.savez_compressed(kept, source=source, **baked)
    return _grid(path, baked, sampling)


def _grid(path: Path, baked: Mapping[str, Any], sampling: Sampling) -> DistanceGrid:
    if remark := str(baked["remark"]):
        warn_once(f"{path}: {remark}")
    return DistanceGrid(baked["grid"], sampling.spacing, vector(baked["corner"]))


def _baked(path: Path, sampling: Sampling) -> dict[str, Any]:
    """Return a mesh's signed distances, the position of the first distance, and a remark."""
    if not (find_spec("trimesh") and find_spec("trimesh.proximity")):
        raise ParameterError(MISSING_LIBRARY)
    with TemporaryDirectory(prefix="haptic_accel-") as folder:
        result = Path(folder) / "grid.npz"
        words = [path.absolute(), result, sampling.spacing, sampling.scale]
        try:
            run_bounded(mesh_baking.__name__, list(map(str, words)), mesh_baking.SECONDS)
        except OutOfBoundsError as error:
            raise ParameterError(
                f"{path}: {error}; the limits for its grid are {mesh_baking.SECONDS:g} s"
                f" and {mesh_baking.MEGABYTES} MB"
            ) from None
        return dict(read_arrays(result))

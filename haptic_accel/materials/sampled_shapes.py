# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shapes from files: height fields, and meshes baked into grids of distances."""

from __future__ import annotations

import hashlib
import math
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.surfaces.sampled_shapes import DistanceGrid, HeightField

MISSING_LIBRARY = "meshes need trimesh: pip install 'haptic_accel[mesh]'"

LARGEST_GRID = 300_000
"""Samples of a baked mesh, which take about half a minute, once."""

BORDER = 2
"""Samples around a mesh, so that its surface is in the grid."""


@dataclass(frozen=True)
class Sampling(Checked):
    """Sampling of a file that describes a shape."""

    spacing: float = parameter(1e-3, "distance between two samples", "m", 1e-5, 0.1)
    scale: float = parameter(1.0, "length of the file's unit", "m", 1e-6, 1.0)


def read_heights(path: Path, sampling: Sampling) -> HeightField:
    """Read a table of heights by place along x and y.

    Parameters
    ----------
    path : Path
        Array of NumPy (.npy) of shape (n, m).
    sampling : Sampling
        Distance between two heights, and their unit.

    Raises
    ------
    ParameterError
        It cannot be read, or is no such table.
    """
    try:
        heights = np.load(path, allow_pickle=False)
        return HeightField(np.asarray(heights, dtype=float) * sampling.scale, sampling.spacing)
    except OSError as error:
        raise _unreadable(path, error) from None
    except (ValueError, TypeError, EOFError) as error:
        reason = error if isinstance(error, ParameterError) else "must be an array of numbers"
        raise ParameterError(f"{path}: {reason}") from None


def read_mesh(path: Path, sampling: Sampling) -> DistanceGrid:
    """Read a mesh as a grid of distances.

    That takes up to half a minute, and is kept beside the mesh, in a file that ends in .npz.

    Parameters
    ----------
    path : Path
        STL, OBJ or another file that trimesh reads; the mesh must enclose a volume.
    sampling : Sampling
        Distance between two samples, of which the thinnest part should have two; and the unit.

    Raises
    ------
    ParameterError
        It cannot be read, encloses no volume, or has too many samples; or trimesh is missing.
    """
    try:
        source = hashlib.sha256(path.read_bytes() + repr(sampling).encode()).hexdigest()
    except OSError as error:
        raise _unreadable(path, error) from None
    kept = path.with_name(path.name + ".npz")
    try:
        with np.load(kept, allow_pickle=False) as found:
            if found["source"] == source:
                return _grid(found["grid"], found["corner"], sampling)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        pass  # none yet, or a damaged one
    grid, corner = _baked(path, sampling)
    with suppress(OSError):  # in a folder that is not the user's, it takes its time again
        np.savez_compressed(kept, source=source, grid=grid, corner=corner)
    return _grid(grid, corner, sampling)


def _grid(grid: FloatArray, corner: FloatArray, sampling: Sampling) -> DistanceGrid:
    x, y, z = corner.tolist()
    return DistanceGrid(grid, sampling.spacing, (x, y, z))


def _baked(path: Path, sampling: Sampling) -> tuple[FloatArray, FloatArray]:
    """Return the signed distances of a mesh, and the place of the first of them."""
    try:
        from trimesh.proximity import signed_distance
    except ImportError:
        raise ParameterError(MISSING_LIBRARY) from None
    mesh = _mesh(path)
    mesh.apply_scale(sampling.scale)
    low, high = mesh.bounds
    counts = np.ceil((high - low) / sampling.spacing).astype(int) + 1 + 2 * BORDER
    if math.prod(counts.tolist()) > LARGEST_GRID:
        size = " x ".join(f"{side:g}" for side in high - low)
        raise ParameterError(
            f"spacing = {sampling.spacing:g}: must be larger: {path} is {size} m large,"
            f" and may have {LARGEST_GRID} samples"
        )
    # Centred: the same on opposite sides.
    corner = (low + high - (counts - 1) * sampling.spacing) / 2
    places = corner + sampling.spacing * np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3)
    return -signed_distance(mesh, places).reshape(counts), corner


def _mesh(path: Path) -> Any:
    """Return a mesh that encloses a volume."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
    except Exception as error:  # whatever a reader of one of many formats raises
        reason = " ".join(str(error).split())[:100]
        raise ParameterError(f"{path}: must be a mesh that trimesh reads: {reason}") from None
    if not (len(getattr(mesh, "faces", ())) and mesh.is_watertight):
        raise ParameterError(f"{path}: must be a mesh that encloses a volume without gaps")
    return mesh


def _unreadable(path: Path, error: OSError) -> ParameterError:
    return ParameterError(f"{path}: must be a readable file: {error.strerror}")

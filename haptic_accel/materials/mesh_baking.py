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

"""Conversion of a mesh into a grid of distances, in a separate process.

Readers of meshes trust the sizes stated in a file, and the distances take time in proportion to
the number of faces.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.core.bounded_work import bounded
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, shown

SECONDS = 120.0
"""Maximum processor time for a mesh, s."""

MEGABYTES = 2000
"""Maximum memory, MB."""

LARGEST_GRID = 300_000
"""Maximum number of samples of a mesh; they take about half a minute, once."""

BORDER = 2
"""Number of samples around a mesh, so that its surface lies within the grid."""


def baked(path: Path, spacing: float, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return a mesh's signed distances, and the position of the first distance.

    Parameters
    ----------
    path : Path
    spacing : float
        Distance between two samples, m.
    scale : float
        Unit of the file, m.

    Raises
    ------
    ParameterError
        The file cannot be read, encloses no volume, or needs too many samples.
    """
    from trimesh.proximity import signed_distance

    mesh = _mesh(path)
    mesh.apply_scale(scale)
    low, high = mesh.bounds
    sides = np.ceil((high - low) / spacing) + 1 + 2 * BORDER
    if not math.prod(sides.tolist()) <= LARGEST_GRID:
        size = " x ".join(f"{side:g}" for side in high - low)
        raise ParameterError(
            f"spacing = {spacing:g}: must be larger: {path} is {size} m large,"
            f" at most {LARGEST_GRID} samples are allowed"
        )
    # The grid is centred: margins are equal on opposite sides.
    counts = sides.astype(int)
    corner = (low + high - (counts - 1) * spacing) / 2
    places = corner + spacing * np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3)
    return -signed_distance(mesh, places).reshape(counts), corner


def _mesh(path: Path) -> Any:
    """Return a mesh that encloses a volume."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
    except Exception as error:  # arbitrary errors from readers of many formats
        reason = shown(" ".join(str(error).split())[:100])
        raise ParameterError(f"{path}: must be a mesh that trimesh reads: {reason}") from None
    if not (len(getattr(mesh, "faces", ())) and mesh.is_watertight):
        raise ParameterError(f"{path}: must be a mesh that encloses a volume without gaps")
    return mesh


def main() -> None:
    """Write the grid of a given mesh to a file."""
    import trimesh.proximity  # noqa: F401 - what it takes is not the mesh's

    path, result = Path(sys.argv[1]), Path(sys.argv[2])
    spacing, scale = map(float, sys.argv[3:])

    def work() -> None:
        grid, corner = baked(path, spacing, scale)
        np.savez(result, grid=grid, corner=corner)

    bounded(work, SECONDS, MEGABYTES)


if __name__ == "__main__":
    main()

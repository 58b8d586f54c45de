# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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
"""Number of samples on each side of a mesh, so that its surface lies within the grid."""


ROUNDING = 1e-4
"""Fraction of a spacing by which a single-precision mesh may exceed a whole number of spacings."""

MOST_BODIES = 1000
"""Maximum number of closed surfaces in a mesh."""

LARGEST_LOSS = 0.3
"""Maximum difference between the volumes of a mesh and of its grid, relative to that of a layer on
the surface as thick as the spacing. The edges of a box of four spacings cause up to 0.2."""


def baked(path: Path, spacing: float, scale: float) -> tuple[FloatArray, FloatArray, str]:
    """Return a mesh's signed distances, the position of the first distance, and a remark.

    Overlapping bodies are united. A mesh with all faces inwards is inverted, with a remark.

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
        The file cannot be read, encloses no volume, needs too many samples, or its faces
        contradict each other.
    """
    mesh = _mesh(path)
    remarks = [_unit_remark(mesh, scale)]
    mesh.apply_scale(scale)
    low, high = mesh.bounds
    sides = np.ceil((high - low) / spacing - ROUNDING) + 1 + 2 * BORDER
    if not math.prod(sides.tolist()) <= LARGEST_GRID:
        size = " x ".join(f"{side:g}" for side in high - low)
        raise ParameterError(
            f"spacing = {spacing:g}: must be larger: {path} is {size} m large,"
            f" at most {LARGEST_GRID} samples are allowed"
        )
    if mesh.volume < 0:
        mesh.invert()
        remarks.append("its faces were inwards, and have been turned")
    # The grid is centred: margins are equal on opposite sides.
    counts = sides.astype(int)
    corner = (low + high - (counts - 1) * spacing) / 2
    positions = corner + spacing * np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3)
    every = [_distances(path, apart, positions, spacing) for apart in _apart(_solids(path, mesh))]
    return np.min(every, axis=0).reshape(counts), corner, "; ".join(filter(None, remarks))


def _distances(path: Path, mesh: Any, positions: FloatArray, spacing: float) -> FloatArray:
    """Return signed distances to solids that do not overlap; check them by the volume."""
    from trimesh.proximity import signed_distance

    found = -np.asarray(signed_distance(mesh, positions))
    filled = float(np.clip(0.5 - found / spacing, 0.0, 1.0).sum()) * spacing**3
    if abs(filled - mesh.volume) > LARGEST_LOSS * mesh.area * spacing:
        raise ParameterError(
            f"{path}: faces around {mesh.volume:.3g} m^3 enclose {filled:.3g} m^3 at this spacing:"
            " the surface intersects itself, or is thinner than two spacings; repair it, or lower"
            " spacing"
        )
    return found


def _solids(path: Path, mesh: Any) -> list[Any]:
    """Return the bodies of a mesh, each with its cavities."""
    import trimesh

    if not mesh.is_winding_consistent:
        raise ParameterError(
            f"{path}: faces beside each other face inwards and outwards: must all face outwards;"
            " recalculate the normals in the program that wrote it"
        )
    bodies = list(mesh.split(only_watertight=False))
    if len(bodies) > MOST_BODIES:
        raise ParameterError(f"{path}: {len(bodies)} bodies: must be at most {MOST_BODIES}")
    solids = sorted((each for each in bodies if each.volume > 0), key=lambda each: each.volume)
    parts = [[solid] for solid in solids]
    for hollow in (each for each in bodies if each.volume <= 0):
        outer = [
            number
            for number, solid in enumerate(solids)
            if _within(hollow.bounds, solid.bounds) and solid.contains(hollow.vertices).all()
        ]
        if not outer:
            where = ", ".join(f"{value:.3g}" for value in hollow.centroid)
            raise ParameterError(
                f"{path}: the faces of a body around ({where}) m are inwards, but it is no hollow"
                " in another: must face outwards; turn them in the program that wrote it"
            )
        parts[outer[0]].append(hollow)
    return [trimesh.util.concatenate(part) if len(part) > 1 else part[0] for part in parts]


def _apart(solids: list[Any]) -> list[Any]:
    """Return meshes of solids whose bounding boxes do not overlap."""
    import trimesh

    groups: list[list[Any]] = []
    for solid in solids:
        for group in groups:
            if not any(_overlap(solid.bounds, each.bounds) for each in group):
                group.append(solid)
                break
        else:
            groups.append([solid])
    return [trimesh.util.concatenate(group) if len(group) > 1 else group[0] for group in groups]


def _overlap(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.all(one[0] <= other[1]) and np.all(other[0] <= one[1]))


def _within(inner: FloatArray, outer: FloatArray) -> bool:
    return bool(np.all(inner[0] >= outer[0]) and np.all(inner[1] <= outer[1]))


def _unit_remark(mesh: Any, scale: float) -> str:
    """Return a remark if the scale contradicts the unit stated by a file or its format."""
    from trimesh.units import unit_conversion

    try:
        stated = float(unit_conversion(mesh.units, "meters")) if mesh.units else scale
    except (KeyError, ValueError):
        return ""  # the file has no unit of length
    if math.isclose(stated, scale, rel_tol=1e-6):
        return ""
    return f"is in {shown(mesh.units)}, but scale = {scale:g} m is used"


def _mesh(path: Path) -> Any:
    """Return a mesh that encloses a volume."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
    except Exception as error:  # readers of many formats raise any error
        reason = shown(" ".join(str(error).split())[:100])
        raise ParameterError(f"{path}: must be a mesh that trimesh reads: {reason}") from None
    if not (len(getattr(mesh, "faces", ())) and mesh.is_watertight):
        raise ParameterError(f"{path}: must be a mesh that encloses a volume without gaps")
    return mesh


def main() -> None:
    """Write the grid of the mesh in the arguments to a file."""
    import trimesh.proximity  # noqa: F401 - what it takes is not the mesh's

    path, result = Path(sys.argv[1]), Path(sys.argv[2])
    spacing, scale = map(float, sys.argv[3:])

    def work() -> None:
        grid, corner, remark = baked(path, spacing, scale)
        np.savez(result, grid=grid, corner=corner, remark=remark)

    bounded(work, SECONDS, MEGABYTES)


if __name__ == "__main__":
    main()

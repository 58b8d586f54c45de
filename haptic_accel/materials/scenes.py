# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes from YAML files: materials and objects."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from haptic_accel.core import parameters
from haptic_accel.core.bounded_work import OutOfBoundsError, run_bounded
from haptic_accel.core.document import Document, read_yaml_document
from haptic_accel.core.files import located, read_bytes
from haptic_accel.core.model import vector
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import SHAPES, DistanceGrid, HeightField
from haptic_accel.core.surfaces.taps import Mode, TapModel
from haptic_accel.core.surfaces.texture import Provenance, TextureModel
from haptic_accel.materials import mesh_baking
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.moving import moving_scene
from haptic_accel.materials.texture_files import read_array, read_arrays, read_npz, read_texture

MISSING_LIBRARY = "meshes need trimesh: pip install 'haptic_accel[mesh]'"

LARGEST_MESH = 1 << 26
"""Maximum size of a mesh file, bytes."""


@dataclass(frozen=True)
class Sampling(parameters.Checked):
    """Sampling of a shape from a file."""

    spacing: float = parameters.parameter(1e-3, "distance between two samples", "m", 1e-5, 0.1)
    scale: float = parameters.parameter(1.0, "length of the file's unit", "m", 1e-6, 1.0)


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
        The file cannot be read, or is not such a table.
    """
    with located(path, "must be an array of numbers"):
        heights = read_array(path)
        return HeightField(np.asarray(heights, dtype=float) * sampling.scale, sampling.spacing)


def read_mesh(path: Path, sampling: Sampling) -> DistanceGrid:
    """Read a mesh as a distance grid.

    This takes up to half a minute. The result is stored in the mesh's folder, in a file that ends
    in .npz.

    Parameters
    ----------
    path : Path
        STL, OBJ or another file readable by trimesh; the mesh must enclose a volume. Overlapping
        bodies are united.
    sampling : Sampling
        Distance between two samples, at most half of the thinnest part; and the file's unit.

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
        pass  # the stored grid is missing or damaged
    baked = _baked(path, sampling)
    with suppress(OSError):  # a read-only folder: compute the grid each time
        np.savez_compressed(kept, source=source, **baked)
    return _grid(path, baked, sampling)


def _grid(path: Path, baked: Mapping[str, Any], sampling: Sampling) -> DistanceGrid:
    if remark := str(baked["remark"]):
        parameters.warn_once(f"{path}: {remark}")
    return DistanceGrid(baked["grid"], sampling.spacing, vector(baked["corner"]))


def _baked(path: Path, sampling: Sampling) -> dict[str, Any]:
    """Return a mesh's signed distances, the position of the first distance, and a remark."""
    if not (find_spec("trimesh") and find_spec("trimesh.proximity")):
        raise parameters.ParameterError(MISSING_LIBRARY)
    with TemporaryDirectory(prefix="haptic_accel-") as folder:
        result = Path(folder) / "grid.npz"
        arguments = [path.absolute(), result, sampling.spacing, sampling.scale]
        try:
            run_bounded(mesh_baking.__name__, list(map(str, arguments)), mesh_baking.SECONDS)
        except OutOfBoundsError as error:
            raise parameters.ParameterError(
                f"{path}: {error}; the limits for its grid are {mesh_baking.SECONDS:g} s"
                f" and {mesh_baking.MEGABYTES} MB"
            ) from None
        return dict(read_arrays(result))


POSITION = parameters.Specification("position in the arm's base frame", "m", -10.0, 10.0)
ANGLE = parameters.Specification("roll, pitch and yaw", "rad", -2 * math.pi, 2 * math.pi)

FILES: Mapping[str, Any] = {"heights": read_heights, "mesh": read_mesh}
"""Readers of shapes in separate files, by name."""

KEYS = ("start", "materials", "objects", "mujoco")
"""Keys of a file."""

_PLACED = ("shape", "material", "position", "rotation")
"""Keys of an object in addition to its shape's keys."""


def read_scene(path: Path) -> Scene:
    """Read a scene, with the textures that it names.

    Parameters
    ----------
    path : Path
        YAML file; its name is the scene's name.

    Returns
    -------
    Scene

    Raises
    ------
    ParameterError
        The file cannot be read, or a value is invalid. The message contains the file, the line,
        the value and the allowed values.
    """
    file = read_yaml_document(path)
    file.check_keys(*KEYS)
    materials = {name: _material(name, each) for name, each in file.get("materials", {}).members()}
    if "mujoco" in file:
        return _moving(file, materials)
    objects = [_object(name, each, materials) for name, each in file.get("objects", {}).members()]
    if not objects:
        file.refuse("objects: must be one at least", "objects")
    return Scene(tuple(objects), file.get("start").vector(POSITION), path.stem)


def is_scene(name: str) -> bool:
    """Return whether a name is that of a scene or a scene file, not of a surface."""
    try:
        return not read_yaml_document(preset_file("scene", name)).mapping().keys().isdisjoint(KEYS)
    except parameters.ParameterError:
        return False


def _moving(file: Document, materials: Mapping[str, Material]) -> Scene:
    """Return the scene of an MJCF file, with materials for its geoms from this file."""
    for _, section in file.get("materials", {}).members():
        section.check_keys("texture", "tap")  # all other properties come from the MJCF file
    named = {}
    for geom, section in file.get("objects", {}).members():
        section.check_keys("material")
        named[geom] = section.get("material").choice(materials)
    path = file.path.parent / file.at("mujoco").text()
    start = file.get("start").vector(POSITION)
    with file.located("mujoco"):
        return moving_scene(path, named, start, file.path.stem)


def _material(name: str, section: Document) -> Material:
    section.check_keys(*parameters.own_schema(Material), "texture", "tap")
    return section.build(Material, name=name, texture=_texture(section), tap=_tap(section))


def _texture(section: Document) -> TextureModel | None:
    """Return a texture model by name, or from a path relative to the scene."""
    if "texture" not in section:
        return None
    name = section.at("texture").text()
    with section.located("texture"):
        path = preset_file("texture", name, section.path.parent)
        return _model(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=32)
def _model(path: Path, _modified: int) -> TextureModel:
    """Return a texture; cached, as a scene must change within a few samples."""
    return read_texture(path)


def _tap(section: Document) -> TapModel | None:
    """Return a tap from a list of modes, or from recordings at a path relative to the scene."""
    tap = section.get("tap")
    if tap.value is None:
        return None
    recorded = section.path.parent / tap.value if isinstance(tap.value, str) else None
    modes = () if recorded else _modes(tap)
    with section.located("tap"):
        return read_taps(recorded) if recorded else TapModel(modes)


def read_taps(path: Path) -> TapModel:
    """Read taps recorded at several impact speeds from an NPZ file.

    Contents: ``speeds``, impact speeds, m/s; ``samples``, a row of acceleration for each, m/s^2;
    ``rate``, samples per second.

    Raises
    ------
    ParameterError
        The message is one line with the file and its error.
    """
    file = read_npz(path)
    speeds, samples = file.at("speeds").array(), file.at("samples").array()
    rate = file.at("rate").number()
    with file.located():
        about = Provenance(source=path.name)
        return TapModel(speeds=speeds, samples=samples, rate=rate, provenance=about)


def _modes(modes: Document) -> tuple[Mode, ...]:
    for each in modes.items():
        each.check_keys(*parameters.own_schema(Mode))
    return tuple(each.build(Mode) for each in modes.items())


def _object(name: str, section: Document, materials: Mapping[str, Material]) -> SceneObject:
    kind = section.get("shape").choice({**SHAPES, **FILES})
    from_file = kind in FILES.values()
    own = parameters.own_schema(Sampling if from_file else kind)
    section.check_keys(*_PLACED, *(["file"] if from_file else []), *own)
    return SceneObject(
        name,
        _sampled(section, kind) if from_file else section.build(kind),
        section.get("material").choice(materials),
        section.get("position").vector(POSITION),
        section.get("rotation").vector(ANGLE),
    )


def _sampled(section: Document, read: Any) -> HeightField | DistanceGrid:
    """Return a shape from a separate file."""
    file, sampling = section.path.parent / section.at("file").text(), section.build(Sampling)
    with section.located("file"):
        shape: HeightField | DistanceGrid = read(file, sampling)
    return shape

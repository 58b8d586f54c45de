# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Damaged files of every kind: read or refused in one line, within 2 s and 500 MB."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damaged_files import ANY_BYTES, NOISE, array, other_arrays, text, written, zipped
from fuzzing import accepted, fuzz_few, in_child, measured, mutated, without_programs
from haptic_accel.core.handle.plant import read_discrete_model
from haptic_accel.core.surfaces.taps import Tap
from haptic_accel.materials.mesh_baking import baked
from haptic_accel.materials.scenes import Sampling, read_heights, read_taps
from haptic_accel.materials.texture_files import read_texture, write_texture

FRAME = {"speeds": np.array([0.0, 0.1, 0.0, 0.1]), "forces": np.array([0.0, 0.0, 1.0, 1.0])}
TEXTURE = {
    "about": "name: oak\nrate: 1000.0\nunits: {}\nprovenance: {licence: none}\n",
    **FRAME,
    "deviation": np.array([0.0, 0.0, 0.0, 1.0]),
    "lsf": np.tile([0.5, 1.0, 2.0], (4, 1)),
}
TAPS = {"speeds": np.array([0.1, 0.2]), "samples": NOISE.reshape(2, -1), "rate": 1000.0}
MODEL = {
    "discrete_model": {"sections": [[1, 0, 0, 1, -0.5, 0]], "rate_hz": 1e3, "delay_samples": 1}
}


def texture() -> bytes:
    """Return a texture as YAML."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "whole.npz"
        np.savez(path, **TEXTURE)
        write_texture(path.with_suffix(".yaml"), read_texture(path))
        return path.with_suffix(".yaml").read_bytes()


def heard(path: Path) -> None:
    """Read taps and play one."""
    Tap(read_taps(path), 1000.0)


Read = Callable[[Path], object]
KINDS: dict[str, tuple[str, Read, st.SearchStrategy[bytes]]] = {
    "texture, NPZ": ("a.npz", read_texture, zipped(TEXTURE) | other_arrays(TEXTURE)),
    "taps, NPZ": ("a.npz", heard, zipped(TAPS) | other_arrays(TAPS)),
    "heights, NPY": (
        "a.npy",
        lambda path: read_heights(path, Sampling()),
        mutated(st.just(array(NOISE.reshape(8, 8))), ANY_BYTES),
    ),
    "model, JSON": ("a.json", read_discrete_model, written(MODEL)),
}


@pytest.mark.parametrize("kind", KINDS)
@fuzz_few
@given(st.data())
def test_any_damage_is_refused_in_one_line(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    name, read, contents = KINDS[kind]
    path = tmp_path / name
    path.write_bytes(data.draw(contents))
    with measured(), without_programs():
        accepted(lambda: read(path))


@fuzz_few
@given(text(texture()))
def test_any_damage_to_a_texture_in_yaml_is_refused_in_one_line(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(content)
    with measured(), without_programs():
        accepted(lambda: read_texture(path))


CORNERS = np.array([(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)], "<f4")
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
STL = (
    bytes(80)
    + struct.pack("<I", len(FACES))
    + b"".join(bytes(12) + CORNERS[list(face)].tobytes() + bytes(2) for face in FACES)
)
OBJ = "".join(
    [
        *(f"v {x} {y} {z}\n" for x, y, z in CORNERS),
        *(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES),
    ]
).encode()


@pytest.mark.parametrize(("name", "whole"), [("a.stl", STL), ("a.obj", OBJ)])
@fuzz_few
@given(st.data())
def test_any_damage_to_a_mesh_is_refused_in_one_line(
    tmp_path: Path, name: str, whole: bytes, data: st.DataObject
) -> None:
    pytest.importorskip("trimesh.proximity")
    path = tmp_path / name
    path.write_bytes(data.draw(mutated(st.just(whole), ANY_BYTES)))
    in_child(lambda: accepted(lambda: baked(path, 2e-3, 1e-3)))

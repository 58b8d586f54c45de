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

"""Tests of scenes as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import ODD_TEXTS, accepted, fuzz, mutated
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.shapes import Box, Plane, Sphere
from haptic_accel.core.surfaces.taps import Tap
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.scenes import is_scene, read_scene, read_taps

SCENE = """start: [0.0, 0.0, 0.01]
materials:
  wood:
    stiffness: 3000
    friction: 0.2
    tap:
      - {frequency: 150.0, decay: 90.0, amplitude: 100.0}
objects:
  bench:
    shape: plane
    material: wood
  box:
    shape: box
    material: wood
    height: 0.03
    position: [-0.05, 0.0, 0.0]
"""

TAPS: dict[str, Any] = {"speeds": [0.1, 0.2], "samples": [[1.0, -2.0], [3.0, -4.0]], "rate": 1000}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(SCENE)
    return path


def test_a_scene_has_what_its_file_says(file: Path) -> None:
    scene = read_scene(file)
    assert (scene.name, scene.start) == ("mine", (0.0, 0.0, 0.01))
    bench, box = scene.objects
    assert (bench.name, bench.shape) == ("bench", Plane())
    assert (box.name, box.shape, box.position) == ("box", Box(height=0.03), (-0.05, 0.0, 0.0))
    assert bench.material is box.material
    material = bench.material
    assert (material.name, material.stiffness, material.friction) == ("wood", 3000.0, 0.2)
    assert material.texture is None
    assert [mode.frequency for mode in material.tap.modes] == [150.0]


def test_a_scene_is_told_from_a_surface(file: Path) -> None:
    assert is_scene("workshop")
    assert is_scene(str(file))
    names = ["plywood", "cave", str(preset_file("surface", "text"))]
    assert not any(map(is_scene, names))


def test_the_workshop_has_a_plane_a_box_and_a_sphere() -> None:
    scene = read_scene(preset_file("scene", "workshop"))
    assert [type(each.shape) for each in scene.objects] == [Plane, Box, Sphere]
    assert len({each.material.name for each in scene.objects}) == 3


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("3000", "-1", 4, "materials.wood.stiffness = -1: must be from 1 to 10000 N/m"),
        ("3000", "hard", 4, "materials.wood.stiffness = 'hard': must be from 1 to 10000 N/m"),
        ("friction: 0.2", "fricton: 0.2", 5, "materials.wood.fricton: unknown (did you mean"),
        ("decay: 90.0", "decay: 0.0", 7, "materials.wood.tap.0.decay = 0.0: must be above 0"),
        ("- {freq", "{freq", 6, "materials.wood.tap = {'frequency'"),
        ("shape: plane", "shape: [1]", 10, "objects.bench.shape = [1]: must be one"),
        (
            "shape: plane",
            "shape: plain",
            10,
            "objects.bench.shape = 'plain': must be one of plane",
        ),
        (
            "material: wood\n  box",
            "material: oak\n  box",
            11,
            "objects.bench.material = 'oak': must",
        ),
        ("height: 0.03", "radius: 0.03", 15, "objects.box.radius: unknown"),
        (
            "[-0.05, 0.0, 0.0]",
            "[0.0, 0.0]",
            16,
            "objects.box.position = [0.0, 0.0]: must be three",
        ),
        ("-0.05", "-50.0", 16, "objects.box.position.0 = -50.0: must be from -10 to 10 m"),
        ("start: [0.0", "start: [.nan", 1, "start.0 = "),
        ("    tap:", "    texture: slate\n    tap:", 6, "materials.wood.texture = 'slate'"),
        ("objects:", "things:", 8, "things: unknown"),
    ],
)
def test_a_wrong_value_is_named_with_file_line_and_range(
    file: Path, old: str, new: str, line: int, message: str
) -> None:
    file.write_text(SCENE.replace(old, new))
    with pytest.raises(ParameterError) as error:
        read_scene(file)
    assert str(error.value).startswith(f"{file}:{line}: {message}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "[1, 2]", "a: [", "objects: 3", "objects: {}", "\0"])
def test_a_file_of_another_form_is_refused(file: Path, text: str) -> None:
    file.write_text(text)
    with pytest.raises(ParameterError, match="mine.yaml"):
        read_scene(file)
    with pytest.raises(ParameterError, match=r"other\.yaml: must be a readable file"):
        read_scene(file.with_name("other.yaml"))


pieces = st.sampled_from(
    [*ODD_TEXTS, "\n", ": ", "  ", "- ", "[]", "{}", "1", "texture: text", "tap: a.npz"]
)


@fuzz
@given(mutated(st.sampled_from([SCENE]), pieces))
def test_any_damage_to_a_scene_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_bytes(text.encode())
    accepted(lambda: read_scene(file))


def test_a_scene_plays_recorded_taps(tmp_path: Path) -> None:
    np.savez(tmp_path / "oak.npz", **TAPS)
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "materials: {oak: {tap: oak.npz}}\nobjects: {bench: {shape: plane, material: oak}}\n"
    )
    model = read_scene(scene).objects[0].material.tap
    assert model.provenance.source == "oak.npz"
    tap = Tap(model, 1000.0)
    tap.strike(0.2)
    assert [tap.synthesize() for _ in range(3)] == pytest.approx([3.0, -4.0, 0.0])
    (tmp_path / "oak.npz").unlink()
    with pytest.raises(
        ParameterError, match=rf"^{scene}:1: .*oak.npz: must be a readable file: No such file"
    ):
        read_scene(scene)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rate": -1}, "rate = -1.0: must be above 0 Hz"),
        ({"rate": [1, 2]}, "rate = .*: must be a finite number"),
        ({"speeds": ["fast"]}, "speeds = .*: must be numbers"),
        ({"speeds": [0.2, 0.1]}, "must ascend"),
        ({"samples": [1.0, 2.0]}, r"samples of shape \(2,\)"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, changed: dict[str, Any], words: str) -> None:
    path = tmp_path / "wrong.npz"
    np.savez(path, **{**TAPS, **changed})
    with pytest.raises(ParameterError, match=rf"^{path}: .*{words}"):
        read_taps(path)


def test_a_file_without_speeds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wrong.npz"
    np.savez(path, samples=np.ones((1, 4)))
    with pytest.raises(ParameterError, match=f"^{path}: speeds = nothing: must be given"):
        read_taps(path)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of scenes as files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import ODD_TEXTS, accepted, fuzz, mutated
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.shapes import Box, DistanceGrid, Plane
from haptic_accel.core.surfaces.taps import Tap
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.scenes import (
    Sampling,
    is_scene,
    read_heights,
    read_mesh,
    read_scene,
    read_taps,
)

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
    assert not any(map(is_scene, ["plywood", "cave", str(preset_file("surface", "text"))]))


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("3000", "-1", 4, "materials.wood.stiffness = -1: must be from 1 to 10000 N/m"),
        ("friction: 0.2", "fricton: 0.2", 5, "materials.wood.fricton: unknown (did you mean"),
        ("decay: 90.0", "decay: 0.0", 7, "materials.wood.tap.0.decay = 0.0: must be above 0"),
        ("- {freq", "{freq", 6, "materials.wood.tap = {'frequency'"),
        (
            "shape: plane",
            "shape: plain",
            10,
            "objects.bench.shape = 'plain': must be one of plane",
        ),
        ("wood\n  box", "oak\n  box", 11, "objects.bench.material = 'oak': must"),
        ("height: 0.03", "radius: 0.03", 15, "objects.box.radius: unknown"),
        ("[-0.05, 0.0, 0.0]", "[1, 0]", 16, "objects.box.position = [1, 0]: must be three"),
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
        ({"speeds": [0.2, 0.1]}, "must increase"),
        ({"speeds": None}, "speeds = nothing: must be given"),
        ({"samples": [1.0, 2.0]}, r"samples of shape \(2,\)"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, changed: dict[str, Any], words: str) -> None:
    path = tmp_path / "wrong.npz"
    kept = {name: each for name, each in {**TAPS, **changed}.items() if each is not None}
    np.savez(path, **kept)
    with pytest.raises(ParameterError, match=rf"^{path}: .*{words}"):
        read_taps(path)


# A box of 20 x 10 x 8, in mm.
CORNERS = [(x, y, z) for x in (-10, 10) for y in (-5, 5) for z in (-4, 4)]
FACES = [*((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1)), *((2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))]
TRIANGLES = [triangle for a, b, c, d in FACES for triangle in ((a, b, c), (a, c, d))]
MILLIMETRES = Sampling(spacing=2e-3, scale=1e-3)


Body = tuple[list[tuple[float, float, float]], list[tuple[int, int, int]]]


def write_bodies(path: Path, *bodies: Body) -> Path:
    lines, count = [], 0
    for corners, triangles in bodies:
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines += ["f " + " ".join(str(count + index + 1) for index in each) for each in triangles]
        count += len(corners)
    path.write_text("\n".join(lines))
    return path


@pytest.fixture
def brick(tmp_path: Path) -> Path:
    return write_bodies(tmp_path / "brick.obj", (CORNERS, TRIANGLES))


def test_a_mesh_is_the_solid_that_it_encloses(
    brick: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("trimesh")
    baked, box = read_mesh(brick, MILLIMETRES), Box(0.020, 0.010, 0.008)
    places = np.random.default_rng(0).uniform(-0.02, 0.02, (200, 3))
    near = np.abs(box.distances(places)) < 2e-3
    # The corners of the box are between samples.
    assert baked.distances(places)[near] == pytest.approx(box.distances(places)[near], abs=1e-3)
    # The next time it is not computed, and so needs no library.
    monkeypatch.setitem(sys.modules, "trimesh.proximity", None)
    assert np.array_equal(read_mesh(brick, MILLIMETRES).grid, baked.grid)
    with pytest.raises(ParameterError, match=r"pip install 'haptic_accel\[mesh\]'"):
        read_mesh(brick, Sampling(spacing=3e-3, scale=1e-3))


@pytest.mark.parametrize(
    ("text", "sampling", "error"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", MILLIMETRES, "encloses a volume without gaps"),
        ("", MILLIMETRES, "brick.obj: must be a mesh"),
        (None, Sampling(spacing=1e-5, scale=1e-3), "spacing = 1e-05: must be larger: .*0.02 x"),
    ],
)
def test_a_wrong_mesh_is_refused(
    brick: Path, text: str | None, sampling: Sampling, error: str
) -> None:
    pytest.importorskip("trimesh")
    if text is not None:
        brick.write_text(text)
    with pytest.raises(ParameterError, match=error):
        read_mesh(brick, sampling)


def test_a_scene_has_heights_of_a_file_beside_it(tmp_path: Path) -> None:
    np.save(tmp_path / "relief.npy", np.full((3, 4), 2.0))
    scene = tmp_path / "relief.yaml"
    scene.write_text(
        "materials:\n  clay: {stiffness: 900.0}\n"
        "objects:\n  relief:\n    shape: heights\n    material: clay\n"
        "    file: relief.npy\n    spacing: 0.002\n    scale: 0.001\n"
    )
    (relief,) = read_scene(scene).objects
    assert relief.distance(0.001, 0.002, 0.005) == pytest.approx(0.003)
    (tmp_path / "relief.npy").unlink()
    with pytest.raises(ParameterError, match=r"relief.yaml:7: .*relief.npy: must be"):
        read_scene(scene)


@pytest.mark.parametrize("damage", [b"", b"no array", "text"])
def test_wrong_heights_are_refused(tmp_path: Path, damage: bytes | str) -> None:
    path = tmp_path / "relief.npy"
    if isinstance(damage, bytes):
        path.write_bytes(damage)
    else:
        np.save(path, np.array([damage]))
    with pytest.raises(ParameterError, match="relief.npy: must be an array of numbers"):
        read_heights(path, Sampling())


TINY = Sampling(spacing=1e-3, scale=1e-3)


def box_of(low: float, high: float, inwards: bool = False, side: float = 5.0) -> Body:
    """Return a body from `low` to `high` along x, and from -`side` to `side` along y and z, mm."""
    corners = [
        (low if x < 0 else high, side if y > 0 else -side, side if z > 0 else -side)
        for x, y, z in CORNERS
    ]
    return corners, [each[::-1] if inwards else each for each in TRIANGLES]


def is_inside(grid: DistanceGrid, *along_x: float) -> list[bool]:
    return (grid.distances(np.array([(x * 1e-3, 0.0, 0.0) for x in along_x])) < 0).tolist()


def test_a_body_with_faces_inwards_in_another_is_a_hollow(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    inner = box_of(6, 24, inwards=True, side=4.0)
    path = write_bodies(
        tmp_path / "case.obj", box_of(0, 30, side=10.0), inner, box_of(12, 18, side=2)
    )
    assert is_inside(read_mesh(path, TINY), 3, 9, 15, 21, 27) == [True, False, True, False, True]


def test_a_mesh_with_all_faces_inwards_is_turned_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("trimesh")
    path = write_bodies(tmp_path / "in.obj", box_of(0, 20, inwards=True))
    right = write_bodies(tmp_path / "out.obj", box_of(0, 20))
    turned = read_mesh(path, TINY)
    assert caplog.messages == [f"{path}: its faces were inwards, and have been turned"]
    assert turned.grid == pytest.approx(read_mesh(right, TINY).grid, abs=1e-12)


def joined(one: Body, other: Body) -> Body:
    """Return two boxes as one closed surface, joined by a tube between a triangle of each."""
    first, last = one[1][0], [index + 8 for index in other[1][-1][::-1]]
    tube = [
        triangle
        for a, b, c, d in zip(first, first[1:] + first[:1], last[1:] + last[:1], last, strict=True)
        for triangle in ((a, b, c), (a, c, d))
    ]
    moved = [(a + 8, b + 8, c + 8) for a, b, c in other[1][:-1]]
    return [*one[0], *other[0]], [*one[1][1:], *moved, *tube]


MIXED = box_of(0, 20)[0], [TRIANGLES[0][::-1], *TRIANGLES[1:]]


@pytest.mark.parametrize(
    ("bodies", "words"),
    [
        ([box_of(0, 20), box_of(30, 36, inwards=True)], "the faces of a body .* are inwards"),
        ([MIXED], "faces beside each other face inwards"),
        ([joined(box_of(0, 20), box_of(10, 30))], ".*the surface intersects itself"),
    ],
    ids=["apart", "mixed", "crossed"],
)
def test_faces_that_contradict_each_other_are_refused(
    tmp_path: Path, bodies: list[Body], words: str
) -> None:
    pytest.importorskip("trimesh")
    path = write_bodies(tmp_path / "a.obj", *bodies)
    with pytest.raises(ParameterError, match=rf"^{path}: {words}"):
        read_mesh(path, TINY)

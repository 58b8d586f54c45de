# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes moved by MuJoCo, and the limits within which a file is compiled."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import accepted, fuzz_few, in_child, mutated
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.scene import Scene
from haptic_accel.core.surfaces.tool import Contact
from haptic_accel.core.surfaces.virtual_rig import VirtualRig, VirtualRigParameters
from haptic_accel.materials.moving import check_mjcf, compile_and_step
from haptic_accel.materials.scenes import read_scene

RATE = 1000.0

MJCF = """
<mujoco>
  <asset><mesh name="wedge" vertex="0 0 0  .01 0 0  0 .01 0  0 0 .01"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" friction=".3"/>
    <geom name="wall" type="box" size=".01 .1 .1" pos="-.1 0 .1" euler="0 0 30"/>
    <body pos="0.03 0 0.02">
      <joint type="slide" axis="1 0 0"/>
      <geom name="cart" type="box" size=".01 .01 .01" mass=".05"/>
    </body>
    <body pos="0.5 0 0"><geom type="mesh" mesh="wedge"/></body>
  </worldbody>
</mujoco>
"""

SCENE = """
mujoco: world.xml
materials:
  wood: {tap: [{frequency: 200.0, decay: 80.0, amplitude: 100.0}]}
objects:
  floor: {material: wood}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    (tmp_path / "world.xml").write_text(MJCF)
    (tmp_path / "scene.yaml").write_text(SCENE)
    return tmp_path / "scene.yaml"


def rig(scene: Scene) -> VirtualRig:
    return VirtualRig(VirtualRigParameters(), scene, RATE)


def contacts(rig: VirtualRig, *force: float, samples: int = 600) -> list[Contact | None]:
    """Return the contact of each sample while the motors push."""
    start, found = getattr(rig, "passed", 0), []
    for number in range(start + 1, start + samples + 1):
        rig.apply_arm_force((force[0], force[1], force[2]))
        rig.advance(number / RATE)
        found.append(rig.motion.contact)
    rig.passed = start + samples  # type: ignore[attr-defined]
    return found


def test_a_tool_that_is_pressed_onto_a_geom_taps_once_and_rests_with_the_motors_force(
    path: Path,
) -> None:
    found = contacts(rig(read_scene(path)), 0.0, 0.0, -1.5)
    impacts = [each.impact_speed for each in found if each and each.impact_speed]
    assert 0.05 < impacts[0] < 1.0
    assert len(impacts) == 1
    last = found[-1]
    assert last is not None
    assert last.object.name == "floor"
    assert last.object.material.tap is not None
    assert last.normal == pytest.approx((0, 0, 1))
    assert last.normal_force == pytest.approx(1.5, rel=0.02)
    assert 0 < last.depth < 5e-3
    assert last.speed < 1e-3


def test_friction_is_against_the_motion_along_the_surface(path: Path) -> None:
    own = rig(read_scene(path))
    contacts(own, 0.0, 0.0, -0.5)
    sliding = contacts(own, 0.0, 2.0, -0.5, samples=100)[-1]
    assert sliding is not None
    assert sliding.sliding
    assert sliding.velocity[1] == pytest.approx(sliding.speed)
    assert sliding.speed > 0.05
    assert sliding.force == pytest.approx((0.0, -0.15, 0.5), abs=0.02)
    sticking = contacts(own, 0.0, 0.0, -3.0, samples=300)
    sticking += contacts(own, 0.0, 0.6, -3.0, samples=300)
    place = own.measure().position[1]
    contacts(own, 0.0, 0.6, -3.0, samples=100)
    assert own.measure().position[1] == pytest.approx(place, abs=1e-5)
    assert sticking[-1] is not None
    assert not sticking[-1].sliding


def test_what_is_pushed_moves_and_is_put_back(path: Path) -> None:
    scene = read_scene(path)
    assert scene.mover is not None
    tool = scene.mover(VirtualRigParameters().tool, scene, RATE)
    moved = []
    for _ in range(600):
        contact = tool.advance((0.5, 0.0, 0.0))
        if contact and contact.object.name == "cart":
            moved.append(tool.position[0])
            assert contact.normal[0] == pytest.approx(-1.0)
            assert contact.speed < 0.02  # it goes along with the tool
    assert moved[-1] - moved[0] > 0.01
    tool.return_to_start()
    assert tool.position[0] == pytest.approx(0.0)


def test_geoms_are_drawn_where_they_begin(path: Path) -> None:
    scene = read_scene(path)
    outlines = scene.section((-0.15, 0.15), (-0.01, 0.25))
    assert set(outlines) == {"floor", "wall", "cart"}
    left, right = (getattr(np, end)(outlines["cart"][0][:, 0]) for end in ("min", "max"))
    assert (left, right) == pytest.approx((0.02, 0.04), abs=2e-3)
    wall = next(each for each in scene.objects if each.name == "wall")
    assert wall.rotation == pytest.approx((0.0, 0.0, np.pi / 6))


def test_a_scene_that_moves_is_not_changed_into_another(path: Path) -> None:
    with pytest.raises(ParameterError, match="scene: no change to or from moving scenes"):
        rig(read_scene(path)).change_scene(read_scene(path))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("floor: {", "flor: {", ":2: .*geom flor: must be one of .*did you mean floor"),
        ("world.xml", "none.xml", ":2: .*must be MJCF that MuJoCo reads"),
        ("{tap:", "{stiffness: 3.0, tap:", ":4: .*stiffness: unknown"),
        ("{material: wood}", "{shape: box, material: wood}", ":6: .*shape: unknown"),
    ],
)
def test_a_wrong_file_is_refused(path: Path, old: str, new: str, words: str) -> None:
    path.write_text(SCENE.replace(old, new))
    with pytest.raises(ParameterError, match=words) as raised:
        read_scene(path)
    assert str(raised.value).isprintable()


def test_without_mujoco_it_is_asked_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        ParameterError, match=r"needs MuJoCo: pip install 'haptic_accel\[mujoco\]'"
    ):
        read_scene(path)


WORLD = """
<mujoco>
  <option timestep="0.002" iterations="50"/>
  <asset>
    <mesh name="wedge" vertex="0 0 0  .01 0 0  0 .01 0  0 0 .01"/>
    <hfield name="hills" nrow="2" ncol="3" size="1 1 .1 .1"/>
    <texture name="plain" type="2d" builtin="flat" width="8" height="8"/>
  </asset>
  <custom><numeric name="n" size="3" data="1"/></custom>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" friction=".3"/>
    <replicate count="3" offset=".1 0 0"><geom type="sphere" size=".01"/></replicate>
    <body pos="0 0 .2"><joint type="slide" axis="1 0 0"/><geom type="mesh" mesh="wedge"/></body>
  </worldbody>
</mujoco>
"""

HOSTILE = {
    "a step that is no time": ('"0.002"', '"1e-12"', "timestep = 1e-12: must be from 2e-05"),
    "steps of no end": ('"0.002"', '"1e300"', "timestep = 1e.300: must be from 2e-05"),
    "a million copies": ('count="3"', 'count="1000000"', "compiled within 2 s and 400 MB"),
    "copies of copies": (
        '<replicate count="3" offset=".1 0 0">',
        '<replicate count="2000"><frame/></replicate><replicate count="2000" offset=".1 0 0">',
        "200[0-9] geoms: must be at most 1000",
    ),
    "a solver without end": ('"50"', '"1000000000"', "iterations = 1000000000: must be at most"),
    "ten billion heights": (
        'nrow="2" ncol="3"',
        'nrow="100000" ncol="100000"',
        "compiled within|must be MJCF",
    ),
    "a picture of 30 GB": (
        'width="8" height="8"',
        'width="100000" height="100000"',
        "compiled within|must be MJCF",
    ),
    "two billion numbers": ('size="3"', 'size="2000000000"', "compiled within|must be MJCF"),
    "what has no mass": (
        '<geom type="mesh" mesh="wedge"/>',
        "",
        "must be MJCF that MuJoCo reads: .*mass",
    ),
    "itself": ("<custom>", '<include file="world.xml"/><custom>', "must be MJCF"),
    "bodies without end": ("<worldbody>", "<worldbody>" + "<body>" * 100_000, "must be"),
    "no end": ("</mujoco>", "", "must be MJCF"),
}


@pytest.fixture
def world(tmp_path: Path) -> Path:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    (tmp_path / "world.xml").write_text(WORLD)
    return tmp_path / "world.xml"


def test_a_scene_is_taken(world: Path) -> None:
    check_mjcf(world)


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_out_of_bounds_is_refused_in_one_line(world: Path, kind: str) -> None:
    old, new, says = HOSTILE[kind]
    assert WORLD.count(old) == 1
    world.write_text(WORLD.replace(old, new))
    with pytest.raises(ParameterError, match=says) as refused:
        check_mjcf(world)
    assert str(refused.value).isprintable()


def test_a_pipe_is_not_waited_for(world: Path) -> None:
    world.unlink()
    os.mkfifo(world)
    with pytest.raises(ParameterError, match=r"world\.xml: .*is not a regular file"):
        check_mjcf(world)


pieces = st.sampled_from(
    ["9", "0", "-1", "e9", "nan", "inf", '"', "<", ">", "/>", "\0", " ", "<body>", "é", "1 1 1"]
)


@fuzz_few
@given(mutated(st.sampled_from([WORLD]), pieces))
def test_any_damage_is_refused_in_one_line_and_in_time(world: Path, text: str) -> None:
    world.write_text(text, encoding="utf-8")
    # A process forked of this one, which has MuJoCo already, with the bounds of `check_mjcf`.
    in_child(lambda: accepted(lambda: compile_and_step(world)))

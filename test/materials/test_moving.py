# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes that MuJoCo moves: what the tool touches in them, and what a file must have."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.scene import Scene
from haptic_accel.core.surfaces.tool import Contact
from haptic_accel.core.surfaces.virtual_rig import VirtualRig, VirtualRigParameters
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

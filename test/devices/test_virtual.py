# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the virtual slave as a device."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices.simulated import VirtualSlave, VirtualSlaveParameters
from haptic_accel.materials.folders import preset_file

WORKSHOP = VirtualSlaveParameters(scene=str(preset_file("scene", "workshop")))


def pressed() -> VirtualSlave:
    device = VirtualSlave(WORKSHOP, 1000.0, 0)
    device.open()
    device.write(100.0, arm_force=(0.5, 0.0, -1.0))
    for index in range(1, 500):
        device.read(100.0 + index / 1000)
    return device


def test_the_force_of_the_contact_is_known() -> None:
    device = pressed()
    assert device.contact_force[2] == pytest.approx(1.0, rel=0.05)
    device.close()
    assert VirtualSlave(WORKSHOP, 1000.0, 0).contact_force == ZERO


def test_a_wrong_scene_is_refused_and_the_old_one_stays(tmp_path: Path) -> None:
    device, wrong = pressed(), tmp_path / "wrong.yaml"
    wrong.write_text("materials: {wood: {stiffness: -1}}")
    before = device.contact_force
    with pytest.raises(ParameterError, match=r"wrong\.yaml:1: materials\.wood\.stiffness = -1"):
        device.change(VirtualSlaveParameters(scene=str(wrong)))
    assert device.contact_force == before
    with pytest.raises(ParameterError, match="must be a readable file"):
        VirtualSlave(VirtualSlaveParameters(), 1000.0, 0)


@pytest.mark.parametrize(
    ("library", "file", "content", "scene"),
    [
        ("mujoco", "world.xml", "<mujoco/>", "mujoco: world.xml"),
        (
            "trimesh",
            "part.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3",
            "{materials: {a: {}}, objects: {b: {shape: mesh, file: part.obj, material: a}}}",
        ),
    ],
)
def test_a_running_device_does_not_wait_for_a_scene_to_be_examined(
    tmp_path: Path, library: str, file: str, content: str, scene: str
) -> None:
    pytest.importorskip(library)
    (tmp_path / file).write_text(content)
    (tmp_path / "new.yaml").write_text(scene)
    device = pressed()
    before = device.contact_force
    with pytest.raises(
        ParameterError, match=r"new\.yaml:1: .*: takes longer than a running graph"
    ):
        device.change(VirtualSlaveParameters(scene=str(tmp_path / "new.yaml")))
    assert device.contact_force == before

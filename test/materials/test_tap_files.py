"""Recorded taps as files, and in scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.taps import Tap
from haptic_accel.materials.scenes import read_scene
from haptic_accel.materials.tap_files import read_taps

TAPS: dict[str, Any] = {"speeds": [0.1, 0.2], "samples": [[1.0, -2.0], [3.0, -4.0]], "rate": 1000}


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
    assert [tap.sample() for _ in range(3)] == pytest.approx([3.0, -4.0, 0.0])
    (tmp_path / "oak.npz").unlink()
    with pytest.raises(ParameterError, match=rf"^{scene}:1: .*oak.npz: No such file"):
        read_scene(scene)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rate": -1}, "rate = -1.0: must be above 0 Hz"),
        ({"rate": [1, 2]}, "must hold numbers speeds, samples, rate"),
        ({"speeds": ["fast"]}, "must hold numbers"),
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
    with pytest.raises(ParameterError, match=f"^{path}: must hold numbers speeds, samples, rate"):
        read_taps(path)

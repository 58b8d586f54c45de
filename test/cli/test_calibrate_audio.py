# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scales of a sound card's inputs, on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from running import python
from sound_cards import sound_world
from verbs import refusal

MASS, FULL_SCALE = 0.128, 5.0
"""Mass of the handle, kg, and force at full scale, N, behind the card."""


def calibrate(*words: object) -> list[str]:
    given = [str(word) for word in words]
    return ["-m", "haptic_accel.cli.main", "calibrate", "audio", "device:=system", *given]


@pytest.mark.slow  # a busy machine loses blocks of an emulated card: measured again
@pytest.mark.live
@pytest.mark.parametrize("polarity", [1, -1])
def test_a_known_force_gives_scale_and_polarity(polarity: int, tmp_path: Path) -> None:
    words = calibrate("by:=force", f"mass:={MASS}", f"full_scale:={FULL_SCALE}", "file:=rig.yaml")
    with sound_world(tmp_path, polarity) as (environment, _):
        done = python(*words, input="\n", env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (own,) = yaml.safe_load((tmp_path / "rig.yaml").read_text()).values()
    found = own["ros__parameters"]
    assert found["accelerometer_device"] == "audio"
    assert float(found["audio"]["scales"]) == pytest.approx(polarity * 100.0, rel=0.05)
    assert f"handle, input 1: full scale {'-' * (polarity < 0)}" in done.stdout
    assert "next: haptic-accel calibrate audio device:=system side:=slave" in done.stdout


@pytest.mark.slow  # a busy machine loses blocks of an emulated card: measured again
@pytest.mark.live
def test_the_input_of_another_sensor_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    words = calibrate("input:=2", "by:=force", "mass:=0.128", "full_scale:=5", "file:=rig.yaml")
    with sound_world(tmp_path) as (environment, _):
        done = python(*words, input="\n", env=environment, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("haptic-accel: input 2: coherence 0.")
    assert not (tmp_path / "rig.yaml").exists()


@pytest.mark.parametrize(
    ("words", "refused"),
    [
        (["by:=force", "mass:=0.1"], "full_scale = 0: must be given with by:=force"),
        (["by:=reference"], "reference_scale = 0: must be given with by:=reference"),
        (
            ["by:=reference", "reference_scale:=9", "reference:=1"],
            "reference = 1: must be another channel than input",
        ),
        (["by:=guess"], "by = 'guess': must be one of gravity, reference, force, name, relative"),
        (["port:=/dev/null"], "port: no such argument"),
        (["by:=name", "device:=HDA"], "device = 'HDA': states no scale"),
    ],
)
def test_wrong_arguments_are_refused(words: list[str], refused: str, tmp_path: Path) -> None:
    assert refused in refusal("calibrate", "audio", *words, f"file:={tmp_path / 'a.yaml'}")


def test_arguments_of_an_input_are_none_of_a_board() -> None:
    assert "by: no such argument" in refusal("calibrate", "port:=/dev/null", "by:=force")

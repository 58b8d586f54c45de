# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""MJCF files that ask for more time or memory than there is: refused in one line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import accepted, fuzz_few, in_child, mutated
from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.moving_check import check_mjcf, compile_and_step

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

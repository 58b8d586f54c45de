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

"""State of a graph as a page shows it: the drawing of its scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.scenes import read_scene
from haptic_accel.scope.state import drawing, scene_of

SURFACE = {"device": "simulated", "simulated.surface.name": "vinyl"}


def test_of_a_simulated_surface_its_plane_is_drawn() -> None:
    assert scene_of(SURFACE) == "vinyl"
    drawn = drawing(SURFACE)
    ((line,),) = drawn["outlines"].values()
    assert {z for _, z in line} == {0}
    assert [x for x, _ in line] == list(drawn["view"][0])


def test_of_a_scene_the_outlines_of_all_its_objects_are_drawn() -> None:
    file = preset_file("scene", "workshop")
    slave = {"device": "virtual", "virtual.scene": str(file)}
    assert scene_of(slave) == str(file)
    scene, drawn = read_scene(file), drawing(slave)
    assert set(drawn["outlines"]) == {each.name for each in scene.objects}
    for each in scene.objects:
        for line in drawn["outlines"][each.name]:
            places = np.insert(np.array(line), 1, scene.start[1], axis=1)
            assert each.distances(places) == pytest.approx(0.0, abs=1e-3)
    assert drawn["offset"] == [scene.start[0], scene.start[2]]
    textured = {each.name for each in scene.objects if each.material.texture}
    assert set(drawn["nodes"]) == textured


def test_a_scene_whose_file_has_gone_is_not_drawn(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"gone\.yaml"):
        drawing({"device": "virtual", "virtual.scene": str(tmp_path / "gone.yaml")})


@pytest.mark.parametrize("slave", [{}, {"device": "can"}, {"device": "simulated"}])
def test_of_other_slaves_nothing_is_known(slave: dict[str, str]) -> None:
    assert scene_of(slave) is None
    assert drawing(slave)["outlines"] == {}

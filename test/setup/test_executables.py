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

"""Modules of executables: in this package, in a kit, in another package, or missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from foreign_packages import declare
from haptic_accel.core.outside import node_module
from haptic_accel.setup.node_parameters import NODES


@pytest.mark.parametrize("executable", [*NODES, "half_coupler", "composed", "composed_master"])
def test_every_executable_of_a_graph_has_its_module(executable: str) -> None:
    assert node_module(executable).endswith(f".{executable}")


def test_a_module_of_another_package_is_found_unless_it_is_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    declare(tmp_path, "lab", {"stage": "lab_stage.node", "lost": "lab_lost.node"}, "nodes")
    (tmp_path / "lab_stage").mkdir()
    (tmp_path / "lab_stage" / "node.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    assert node_module("stage") == "lab_stage.node"
    assert node_module("lost") == ""
    assert node_module("nothing") == ""

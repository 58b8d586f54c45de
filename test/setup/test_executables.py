# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The groups of diagnostics for other programs."""

from __future__ import annotations

import yaml

from haptic_accel.materials.folders import config_folder
from haptic_accel.setup.node_parameters import NODES


def test_every_node_is_in_one_group() -> None:
    content = yaml.safe_load((config_folder() / "analyzers.yaml").read_text(encoding="utf-8"))
    groups = content["/**/analyzers"]["ros__parameters"]
    assert groups.pop("path")
    grouped = [text for group in groups.values() for text in group["contains"]]
    # The link, between two hosts, publishes none.
    assert sorted(grouped) == sorted(f"{node}: " for node in NODES if node != "link")

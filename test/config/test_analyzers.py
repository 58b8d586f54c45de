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

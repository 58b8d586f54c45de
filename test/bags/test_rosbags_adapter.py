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

from __future__ import annotations

from importlib import import_module

import pytest

from haptic_accel.bags import rosbags_adapter

PRIVATE = {"rosbags.rosbag2.metadata": {"dump_qos_v9", "parse_qos"}}


@pytest.mark.parametrize("module", PRIVATE)
def test_rosbags_has_the_names_that_it_does_not_document(module: str) -> None:
    found = import_module(module)
    assert {name for name in PRIVATE[module] if not hasattr(found, name)} == set()


def test_no_other_name_of_theirs_is_used() -> None:
    assert set(rosbags_adapter.__all__) - {"lz4", "zstd"} == set().union(*PRIVATE.values())

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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

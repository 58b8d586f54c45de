# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.metadata import UndefinedTypeError, connection


def test_a_known_type_comes_with_those_it_is_made_of_and_its_hash() -> None:
    made = connection(1, "/x", "geometry_msgs/msg/AccelStamped", [])
    assert "geometry_msgs/Accel accel" in made.msgdef.data
    for inner in ("std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/Vector3"):
        assert f"MSG: {inner}" in made.msgdef.data
    types = get_typestore(Stores.ROS2_JAZZY)
    assert made.digest == types.hash_rihs01("geometry_msgs/msg/AccelStamped")


@pytest.mark.skipif(
    importlib.util.find_spec("ament_index_python") is None, reason="no ROS 2 installed"
)
def test_an_unknown_type_is_read_from_its_installed_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "haptic_accel_test_msgs"
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / name).touch()
    messages = tmp_path / "share" / name / "msg"
    messages.mkdir(parents=True)
    (messages / "Outer.msg").write_text(f"std_msgs/Header header\n{name}/Inner[] parts\n")
    (messages / "Inner.msg").write_text("float64 weight  # kg\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    made = connection(1, "/x", f"{name}/msg/Outer", [])
    assert f"MSG: {name}/Inner\nfloat64 weight" in made.msgdef.data
    assert made.digest.startswith("RIHS01_")


@pytest.mark.parametrize("kind", ["nowhere_msgs/msg/Nothing", "nonsense", "a/b/c/d"])
def test_a_type_that_nobody_defines_is_refused_by_name(kind: str) -> None:
    with pytest.raises(UndefinedTypeError, match=f"^{kind}: no definition"):
        connection(1, "/x", kind, [])

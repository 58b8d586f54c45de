# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Graphs on an rclpy that has renamed all that it does not document, as a later one may."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from renamed_rclpy import rename

from haptic_accel.core.topics import SIGNALS
from haptic_accel.devices import rclpy_internals
from reading import with_rosbags
from running import Start


def test_a_graph_passes_its_signals_and_obeys(
    haptic_accel: Start,
    ask: Callable[..., tuple[int, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rename(tmp_path, monkeypatch)
    graph = haptic_accel("teleop", "rate:=250", "rig:=ideal", "bag:=bag")
    graph.wait_for("engaged")
    seen = len(graph.lines)
    stop = haptic_accel("estop")
    assert stop.end() == 0, stop.text
    graph.wait_for("uncoupled: emergency stop", after=seen)
    assert ask("estop", "release:=true")[0] == 0
    graph.wait_for("engaged", after=seen)
    assert graph.end(signal.SIGINT) == 0, graph.text
    recorded = {topic for topic, _, _ in with_rosbags(tmp_path / "bag")}
    assert recorded >= {f"/{topic.name}" for topic in SIGNALS}


UNDOCUMENTED = re.compile(
    r"\.handle\b.*\.(publish|take|service|get)_|rclpy\.impl\b|rclpy\.experimental"
    r"|\b_LifecycleNodeMixin|\._state_machine\b|\._ready_to_take_data\b|\bself\._logger\b"
)


def test_one_module_has_all_undocumented_names() -> None:
    files = Path(rclpy_internals.__file__).parents[1].rglob("*.py")
    assert [p.name for p in files if UNDOCUMENTED.search(p.read_text())] == ["rclpy_internals.py"]

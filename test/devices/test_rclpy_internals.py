# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Graphs on an rclpy that has renamed all that it does not document, as a later one may."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.core.topics import SIGNALS
from haptic_accel.devices import rclpy_internals
from reading import with_rosbags
from running import Start

RENAMED = '''
import re
from importlib.machinery import SourceFileLoader

METHODS = {
    "Publisher": ["publish_raw", "get_subscription_count"],
    "Subscription": ["take_message", "get_publisher_count"],
    "Service": ["service_take_request"],
    "EventHandle": ["take_event"],
    "": ["rclpy_logging_rcutils_log"],
}
PRIVATE = re.compile(
    r"\\b(publish_raw|take_message|service_take_request|take_event|rclpy_logging_rcutils_log"
    r"|rclpy_implementation|CallerId|_ready_to_take_data|_logger)\\b"
    r"|(?<=publisher\\.)(get_subscription_count)\\b|(?<=subscription\\.)(get_publisher_count)\\b"
    r"|\\b(__on_)(?=change_state|get_)"
)
RENAMING = """
for kind, names in METHODS.items():
    owner = getattr(rclpy_implementationrenamed, kind, rclpy_implementationrenamed)
    for name in names:
        setattr(owner, name + "renamed", getattr(owner, name))
        delattr(owner, name)
"""
read = SourceFileLoader.get_code

def get_code(self, name):
    if not name.startswith("rclpy."):
        return read(self, name)
    path = self.get_filename(name)
    source = PRIVATE.sub(lambda found: found[0] + "renamed", self.get_data(path).decode())
    if name.endswith(".implementation_singleton"):
        source += f"METHODS = {METHODS}" + RENAMING
    return self.source_to_code(source, path)

SourceFileLoader.get_code = get_code
'''
"""Program that Python runs at its start: it renames in rclpy's sources, and in its C library."""


@pytest.fixture(autouse=True)
def renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rename in the processes that a test starts."""
    folder = tmp_path / "renamed"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(RENAMED)
    monkeypatch.setenv("PYTHONPATH", str(folder))


def test_a_graph_passes_its_signals_and_obeys(
    haptic_accel: Start, ask: Callable[..., tuple[int, str]], tmp_path: Path
) -> None:
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


READ = """
import time
from haptic_accel.devices.crtk.device import CrtkArm, CrtkParameters
from haptic_accel.devices.rclpy_internals import TAKES

arm = CrtkArm(CrtkParameters(namespace="/somebody/slave", start_timeout=60.0, timeout=1.0), 1e3, 0)
arm.open()
while not (sample := arm.read(0.0)) or sample.position[0] <= 0:
    arm.write(0.0, arm_force=(0.5, 0.0, 0.0))
    time.sleep(0.001)
arm.close()
print("moved", TAKES)
"""


def test_an_arm_is_read_and_pushed(start: Start) -> None:
    start("-m", "haptic_accel.nodes.slave_device", "--ros-args", "-r", "__ns:=/somebody")
    reader = start("-c", READ)
    assert reader.end() == 0, reader.text
    assert reader.lines[-1] == "moved False"


UNDOCUMENTED = re.compile(
    r"\.handle\b.*\.(publish|take|service|get)_|rclpy\.impl\b|rclpy\.experimental"
    r"|\b_LifecycleNodeMixin|\._state_machine\b|\._ready_to_take_data\b|\bself\._logger\b"
)


def test_one_module_has_all_undocumented_names() -> None:
    files = Path(rclpy_internals.__file__).parents[1].rglob("*.py")
    assert [p.name for p in files if UNDOCUMENTED.search(p.read_text())] == ["rclpy_internals.py"]

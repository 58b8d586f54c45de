# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The driver of arms that speak CRTK, against the simulated slave as an arm of somebody else."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from renamed_rclpy import rename

from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices import DeviceError
from haptic_accel.kits.crtk.device import CrtkArm, CrtkParameters
from haptic_accel.setup import build_parameters
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.node_parameters import declared_schema
from haptic_accel.setup.processes import arrangement, graph
from observing import Observer
from running import PATIENCE, Command, Start, wait_until

NAMESPACE = "/somebody/slave"

REST = (0.0, 0.0, pytest.approx(0.01, abs=55e-6))
"""Position at which the simulated tip begins, m."""


def built(**parameters: Any) -> CrtkArm:
    return CrtkArm(CrtkParameters(namespace=NAMESPACE, **parameters), 1000.0, 0)


NONE = (0.0, 0.0)


def forces(observer: Observer) -> list[tuple[float, float]]:
    """Return the list in which the arm's forces along x and z, N, are gathered."""
    acting: list[tuple[float, float]] = []

    def keep(sent: WrenchStamped) -> None:
        acting.append((sent.wrench.force.x, sent.wrench.force.z))

    observer.node.create_subscription(WrenchStamped, f"{NAMESPACE}/measured_cf", keep, 10)
    return acting


@pytest.fixture
def somebody(start: Start) -> Command:
    """Start the node of another's arm."""
    return start("-m", "haptic_accel.nodes.slave_device", "--ros-args", "-r", "__ns:=/somebody")


@pytest.fixture
def arm(somebody: Command) -> Iterator[CrtkArm]:
    arm = built(start_timeout=60.0, timeout=1.0)
    arm.open()
    yield arm
    arm.close()


def test_an_arm_is_read_and_pushed_left_without_force_and_missed(
    arm: CrtkArm, somebody: Command, observer: Observer
) -> None:
    acting = forces(observer)
    sample = arm.read(0.0)
    assert sample is not None
    assert sample.position == REST
    assert sample.acceleration == ZERO

    def moves() -> bool:
        arm.write(0.0, arm_force=(0.5, 0.0, 0.0))
        observer.executor.spin_once(timeout_sec=0.005)
        sample = arm.read(0.0)
        return sample is not None and sample.position[0] > 0 and sample.velocity[0] > 0

    deadline = time.monotonic() + PATIENCE
    while not (moves() and (0.5, 0.0) in acting):
        assert time.monotonic() < deadline, acting[-5:]
    arm.close()
    while acting[-1] != NONE:
        assert time.monotonic() < deadline, acting[-5:]
        observer.executor.spin_once(timeout_sec=0.01)
    arm.open()
    assert "measured_cp" not in arm.problem
    somebody.end(signal.SIGINT)
    wait_until(lambda: arm.read(0.0) is None, "no sample")
    assert arm.problem == f"crtk: no {NAMESPACE}/measured_cp for 1 s"
    assert arm.arm() is False


@pytest.fixture
def pose(observer: Observer) -> Iterator[dict[str, float]]:
    """Publish a pose 200 times a second: its position, m, stamp, s, or lag behind now; or none."""
    sent, ended = dict[str, float](), threading.Event()
    publisher = observer.node.create_publisher(PoseStamped, f"{NAMESPACE}/measured_cp", 10)

    def publish() -> None:
        while not ended.wait(0.005):
            if "silent" in sent:
                continue
            message = PoseStamped()
            now = time.time_ns() - round(sent.get("lag", 0.0) * 1e9)
            stamp = round(sent.get("stamp", 0.0) * 1e9) or now
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            message.pose.position.x, message.pose.orientation.w = sent.get("x", 0.0), 1.0
            publisher.publish(message)

    thread = threading.Thread(target=publish)
    thread.start()
    yield sent
    ended.set()
    thread.join()


def test_a_pose_of_another_time_or_of_no_place_is_no_sample(pose: dict[str, float]) -> None:
    arm = built(start_timeout=60.0)
    arm.open()
    far = "stamps differ from now by more than 0.1 s"
    others = ({"stamp": time.time()}, {"lag": 1.0}, {"lag": -1.0}, {"stamp": 1e-9})
    for wrong, reason in (
        *((each, far) for each in others),
        ({"x": math.nan}, "values are not finite"),
    ):
        wait_until(lambda: arm.read(0.0) is not None, "a sample")
        refused = arm.counters()["poses refused"]
        pose.update(wrong)
        wait_until(lambda: arm.read(0.0) is None, "no sample")
        wait_until(lambda said=reason: said in arm.problem, reason)
        assert arm.counters()["poses refused"] > refused
        pose.clear()
    arm.close()


def test_a_pose_that_waited_for_its_reader_is_not_refused(pose: dict[str, float]) -> None:
    arm = built(start_timeout=60.0, timeout=10.0)
    arm.open()  # with the first pose
    refused = arm.counters()["poses refused"]
    pose["silent"] = 1.0
    # Longer than the stamp of a pose may differ from its reception.
    late = time.monotonic() + 0.2
    wait_until(lambda: time.monotonic() > late, "the last pose is old")
    assert arm.read(0.0) is not None
    assert (arm.counters()["poses refused"], arm.problem) == (refused, "")
    arm.close()


def test_an_arm_is_enabled_when_it_is_opened(start: Start) -> None:
    pytest.importorskip("crtk_msgs.msg")
    words = ("-r", "__ns:=/somebody", "-p", "autostart:=false")
    start("-m", "haptic_accel.nodes.slave_device", "--ros-args", *words)
    arm = built(start_timeout=60.0, timeout=1.0)
    arm.open()
    wait_until(lambda: arm.read(0.0) is not None and not arm.problem, "enabled")
    arm.close()


def test_an_arm_that_is_not_there_is_named(domain: int) -> None:
    arm = built(start_timeout=0.1)
    with pytest.raises(DeviceError, match=f"^crtk: no {NAMESPACE}/measured_cp for 0.1 s$"):
        arm.open()
    assert arm.read(0.0) is None
    arm.write(0.0, arm_force=(1.0, 0.0, 0.0))
    arm.close()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"namespace": ""}, "namespace = '': must be names of letters"),
        ({"namespace": "/MTM R"}, "namespace = '/MTM R': must be names"),
        ({"force": "body//servo_cf"}, "force = 'body//servo_cf': must be names"),
    ],
)
def test_a_name_that_ros_would_refuse_is_refused(wrong: dict[str, str], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        CrtkParameters(**wrong)


def test_the_graph_couples_an_arm_of_somebody_else(
    somebody: Command, haptic_accel: Start, observer: Observer, tmp_path: Path
) -> None:
    values = f"{{namespace: {NAMESPACE}, start_timeout: 60.0, timeout: 1.0}}"
    file = tmp_path / "arm.yaml"
    file.write_text(f"/**/slave_device:\n  ros__parameters:\n    crtk: {values}\n")
    graph = haptic_accel("teleop", "slave:=crtk", f"params_file:={file}", "record:=false")
    graph.wait_for("engaged")

    acting = forces(observer)

    def acts() -> bool:
        observer.executor.spin_once(timeout_sec=0.1)
        return acting[-1:] not in ([], [NONE])

    wait_until(acts, "a force on the arm")
    assert graph.end(signal.SIGINT) == 0, graph.text
    wait_until(lambda: not acts(), "no force")


READ = """
import time
from haptic_accel.kits.crtk.device import CrtkArm, CrtkParameters
from haptic_accel.setup import build_parameters
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.node_parameters import declared_schema
from haptic_accel.setup.processes import arrangement, graph
from haptic_accel.devices.rclpy_internals import TAKES

arm = CrtkArm(CrtkParameters(namespace="/somebody/slave", start_timeout=60.0, timeout=1.0), 1e3, 0)
arm.open()
while not (sample := arm.read(0.0)) or sample.position[0] <= 0:
    arm.write(0.0, arm_force=(0.5, 0.0, 0.0))
    time.sleep(0.001)
arm.close()
print("moved", TAKES)
"""


def test_an_arm_is_read_and_pushed_by_an_rclpy_with_other_private_names(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rename(tmp_path, monkeypatch)
    start("-m", "haptic_accel.nodes.slave_device", "--ros-args", "-r", "__ns:=/somebody")
    reader = start("-c", READ)
    assert reader.end() == 0, reader.text
    assert reader.lines[-1] == "moved False"


@pytest.mark.smoke
@pytest.mark.parametrize("words", ["slave:=crtk", "master:=crtk"])
def test_each_node_has_its_process_as_crtk_promises_no_watchdog(words: str) -> None:
    arguments = parse_arguments([*words.split(), "composed:=true"])
    assert not arguments.composed
    assert arrangement(graph(arguments)).startswith("a process for each node; ")


def test_a_device_node_declares_the_parameters_of_the_arm_and_its_sensor() -> None:
    values = {"device": "crtk", "accelerometer_device": "audio"}
    own, _ = build_parameters("slave_device", values)
    declared = declared_schema("slave_device", own)
    parts = {name.partition(".")[0] for name in declared if "." in name}
    assert parts == {"crtk", "audio", "safety", "servo_cp"}

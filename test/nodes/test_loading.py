# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loading of modules and files by a running graph: none, as it would stop the loop."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import SetBool

from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import SLAVE
from haptic_accel.graph.stop_signal import PENDING
from haptic_accel.nodes.supervised_node import message_type
from nightly import rest_slow
from observing import Observer
from running import Start

BEFORE = NANOSECONDS // 50
"""Time before the line "engaged" that counts as running, ns: that line is looked at, too. It is
less than from the end of a node's set-up to the first force, without which no arm engages."""

MODULES = 500
"""Half of the modules that a node has loaded."""

APART = ("master_device", "slave_device", "coupler", "compensator")
"""Executables of the processes that carry the forces."""

COUPLED = SLAVE.arm_force
"""A signal of the coupler."""


@pytest.mark.parametrize("composed", rest_slow(["true", "false"]))
def test_a_running_graph_loads_nothing(
    composed: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    haptic_accel: Start,
    observer: Observer,
) -> None:
    folder = tmp_path / "loading"
    folder.mkdir()
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "support" / "loading"))
    monkeypatch.setenv("LOADING_FOLDER", str(folder))
    teleop = haptic_accel("teleop", f"composed:={composed}", "controller:=adaptive")
    engaged = teleop.wait_for("engaged")
    for controller in ("feedback", "adaptive"):
        choice = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=controller)
        changed = Parameter(name="controller", value=choice)
        change = SetParametersAtomically.Request(parameters=[changed])
        service = "compensator/set_parameters_atomically"
        assert observer.call(SetParametersAtomically, service, change).result.successful
        observer.status("compensator", controller=controller)
    assert observer.call(SetBool, "estop", SetBool.Request(data=True)).success
    observer.status("slave_device", said="emergency stop")
    stopped = len(teleop.lines)
    assert observer.call(SetBool, "estop", SetBool.Request(data=False)).success
    teleop.wait_for("engaged", after=stopped)
    observer.status("compensator", least={"grip estimates": 1})
    over = time.time_ns()

    # What rclpy logs itself: somebody asks for the messages from before, which nobody keeps.
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    kind = message_type(COUPLED)
    observer.node.create_subscription(kind, COUPLED.name, lambda _: None, latched)
    teleop.wait_for("incompatible QoS")

    (stamp,) = re.findall(r"\[(\d+)\.(\d+)\]", engaged)
    begin = int("".join(stamp)) - BEFORE
    nodes = ("composed",) if composed == "true" else APART
    late: dict[bool, list[str]] = {False: [], True: []}
    for node in ("recorder", *nodes):
        for line in (folder / node).read_text().splitlines():
            moment = int(line.split()[0])
            of_its_bag = node == "recorder" and re.search(r"\bbags/", line)
            # A device looks for a stop that is pending, without opening anything.
            is_of_stop = re.search(rf" (lstat|unlink) '{PENDING}-", line)
            if begin <= moment and not of_its_bag and not is_of_stop:
                late[moment >= over].append(f"{node} {(moment - begin) * 1e-9:.3f} {line}")
    assert not late[False], "\n".join(late[False])
    # rclpy looks where its own line comes from, but not for the files of all modules.
    assert len(late[True]) < MODULES, "\n".join(late[True])

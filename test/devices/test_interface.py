# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drivers of other packages, installed as a package installer does it, used as a user does."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from foreign_packages import declare
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.process import module_command
from haptic_accel.devices.registry import RESERVED
from haptic_accel.setup.arguments import PLAYED_TOPICS
from haptic_accel.setup.node_parameters import NODES
from nightly import rest_slow
from observing import Observer
from running import PATIENCE, Start, python

DRIVER = """
from dataclasses import dataclass
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.model import ZERO
from haptic_accel.devices import Device, DeviceDescription, Sample
from haptic_accel.devices.interface import CombinedTool
from haptic_accel.devices.interface import NoParameters
from haptic_accel.devices.simulated import SimulatedMaster, SimulatedSlave

@dataclass(frozen=True)
class LabParameters(Checked):
    bias: float = parameter(3.0, "acceleration of a handle at rest", unit="m/s^2")

class LabMaster(Device):
    Parameters = LabParameters

    def __init__(self, parameters, rate, seed):
        self._bias = parameters.bias

    def open(self): ...

    def read(self, time):
        return Sample((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, self._bias))

    def write(self, time, *, arm_force=None, actuator_force=None): ...

    def close(self): ...

class Described(LabMaster):
    description = DeviceDescription(changeable=("bias",))

    def change(self, parameters):
        self._bias = parameters.bias

class Borrowing(Device):
    description = DeviceDescription(parameters_of=("serial", "can"))

    def __init__(self, serial, can, rate, seed):
        self._bias = serial.calibration.gain + can.start_timeout

    open = LabMaster.open
    read = LabMaster.read
    write = LabMaster.write
    close = LabMaster.close

UPRIGHT = (0.0, 0.0, 0.5 ** 0.5, 0.5 ** 0.5)  # a quarter turn about z

class TurnedMaster(SimulatedMaster):
    Parameters = NoParameters
    description = DeviceDescription()

    def __init__(self, parameters, rate, seed):
        super().__init__(SimulatedMaster.Parameters(), rate, seed)

    def read(self, time):
        return super().read(time)._replace(orientation=UPRIGHT)

class TurnedArm(SimulatedSlave):
    def read(self, time):
        return super().read(time)._replace(orientation=UPRIGHT)

class Rattling(SimulatedSlave):
    sign = 1.0

    def read(self, time):
        self.sign = -self.sign
        return Sample(ZERO, ZERO, (self.sign, 0.0, 2 * self.sign))

class TurnedTool(CombinedTool):
    ArmDevice, HandleDevice = TurnedArm, Rattling

    def __init__(self, parameters, rate, seed):
        super().__init__(SimulatedSlave.Parameters(), SimulatedSlave.Parameters(), rate, seed)

class Wrong: ...

class WithoutParameters(LabMaster):
    Parameters = dict

class Undescribed(LabMaster):
    description = {"ahead": True}

class Endless(Device):
    __init__ = LabMaster.__init__
    open = LabMaster.open
    read = LabMaster.read
    write = LabMaster.write

class OfNobody(LabMaster):
    description = DeviceDescription(parameters_of=("can_serial",))

class Unchangeable(LabMaster):
    description = DeviceDescription(changeable=("gain",))

class Exiting(LabMaster):
    def __init__(self, parameters, rate, seed):
        raise SystemExit(3)
"""

Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a package: ``install({DRIVER NAME: OBJECT})``, or of another name or group."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "lab_arm.py").write_text(DRIVER)
    path = os.pathsep.join(filter(None, (str(site), os.environ.get("PYTHONPATH", ""))))
    monkeypatch.setenv("PYTHONPATH", path)

    def installed(
        drivers: dict[str, str], package: str = "lab_arm", group: str = "masters"
    ) -> None:
        declare(site, package, drivers, group)

    return installed


def run(*words: str) -> tuple[int, str]:
    done = python(*module_command("haptic_accel.cli.main")[1:], *words, timeout=PATIENCE)
    return done.returncode, done.stdout + done.stderr


def test_a_driver_is_offered_where_its_arm_is(install: Install) -> None:
    install({"lab": "lab_arm:LabMaster"})
    status, text = run("teleop", "--help")
    assert status == 0
    master, slave = text.partition("slave device, or")[::2]
    assert "crtk_serial, lab" in " ".join(master.split())
    assert "lab," not in slave
    status, text = run("teleop", "slave:=lab")
    assert status == 2
    assert "slave = 'lab': must be one of" in text


@pytest.mark.quiet
def test_drivers_have_the_parameters_that_they_are_described_to_have_and_to_change(
    install: Install, haptic_accel: Start, observer: Observer, tmp_path: Path
) -> None:
    def felt(topic: topics.Topic) -> float:
        found = observer.collect((topic,), 3)[topic.name]
        return float(found[-1].accel.linear.z)

    install({"lab": "lab_arm:Described"})
    install({"borrowing": "lab_arm:Borrowing"}, "lab_tool", "slaves")
    (tmp_path / "lab.yaml").write_text(
        "master_device: {ros__parameters: {lab.bias: 7.0}}\n"
        "slave_device: {ros__parameters: {serial.calibration.gain: 4.0, can.start_timeout: 3.0}}"
    )
    arms = "master:=lab", "slave:=borrowing", "params_file:=lab.yaml"
    graph = haptic_accel("teleop", *arms, "rate:=200.0", "record:=false")
    graph.wait_for("engaged")
    assert felt(topics.TOOL_ACCELERATION) == 7.0
    assert felt(topics.HANDLE_ACCELERATION) == 7.0
    value = Parameter("lab.bias", value=8.0).to_parameter_msg()
    request = SetParameters.Request(parameters=[value])
    (result,) = observer.call(SetParameters, "master_device/set_parameters", request).results
    assert result.successful, result.reason
    assert felt(topics.HANDLE_ACCELERATION) == 8.0
    assert graph.end(signal.SIGINT) == 0, graph.text


@pytest.mark.parametrize("composed", rest_slow(["true", "false"]))
def test_a_handle_turned_like_the_tool_has_its_vibration_in_the_same_axes(
    install: Install, haptic_accel: Start, tmp_path: Path, composed: str
) -> None:
    install({"turned": "lab_arm:TurnedMaster"})
    install({"tilted": "lab_arm:TurnedTool"}, "lab_tool", "slaves")
    (tmp_path / "lab.yaml").write_text("compensator: {ros__parameters: {axes: 'x, y, z'}}")
    arms = "master:=turned", "slave:=tilted", "params_file:=lab.yaml"
    graph = haptic_accel("teleop", *arms, f"composed:={composed}", "duration:=1", "bag:=bag")
    assert graph.end() == 0, graph.text
    signals = read_bag(tmp_path / "bag").signals
    both = (topics.TOOL_ACCELERATION, topics.DESIRED_ACCELERATION)
    tool, desired = (signals[topic.name].values for topic in both)
    assert tool[-1] == pytest.approx((0.0, tool[-1, 1], 2 * tool[-1, 1]))  # in the base's axes
    x, y, z = desired[len(desired) // 2 :].T
    assert np.abs(y).max() < 0.05 * np.abs(x).max()
    assert z == pytest.approx(2 * x, abs=0.05 * np.abs(x).max())


BROKEN = {
    "no_such:Arm": "ModuleNotFoundError: No module named 'no_such'",
    "lab_arm:Missing": "AttributeError: module 'lab_arm' has no attribute 'Missing'",
    "lab_arm:Wrong": "lab_arm:Wrong: must be a subclass of Device",
    "lab_arm:WithoutParameters": "lab_arm:WithoutParameters: Parameters must be a Checked",
    "lab_arm:Undescribed": "lab_arm:Undescribed: description must be a DeviceDescription",
    "lab_arm:Endless": "lab_arm:Endless: must define close",
    "lab_arm:OfNobody": (
        "lab_arm:OfNobody: description.parameters_of: can_serial: must be one of simulated,"
    ),
    "lab_arm:Unchangeable": (
        "lab_arm:Unchangeable: description.changeable: gain: must be one of bias"
    ),
    "lab_arm:Exiting": "lab_arm: SystemExit: 3",
}
"""Drivers that cannot be used, and why."""

ONE_BY_ONE = """
import sys
from haptic_accel.cli.main import main
for number in range(int(sys.argv[1])):
    try:
        main(["teleop", f"master:=lab{number}"])
    except SystemExit as end:
        assert end.code == 2
main("teleop master:=simulated rate:=0".split())
"""


def test_a_broken_driver_is_named_where_it_is_asked_for(install: Install) -> None:
    install({f"lab{number}": target for number, target in enumerate(BROKEN)})
    done = python("-c", ONE_BY_ONE, len(BROKEN))
    *lines, last = done.stderr.splitlines()
    for number, (line, reason) in enumerate(zip(lines, BROKEN.values(), strict=True)):
        assert line.startswith(f"haptic-accel: master = 'lab{number}': ")
        assert reason in line
    assert done.returncode == 2
    assert "rate = 0" in last, "the others work"


@pytest.mark.parametrize("name", ["serial", "safety", "My-Arm"])
def test_a_name_that_cannot_be_used_is_told(install: Install, name: str) -> None:
    install({name: "lab_arm:LabMaster"})
    status, text = run("teleop", "--help")
    assert status == 0
    assert f"haptic_accel.masters: '{name}' of package lab_arm: not used: its name" in text


def test_the_first_of_two_packages_has_the_name(install: Install) -> None:
    install({"lab": "lab_arm:LabMaster"})
    install({"lab": "lab_arm:Wrong"}, package="other_arm")
    _, text = run("teleop", "--help")
    assert "not used: its name is taken" in text


def test_no_other_part_of_a_node_can_be_hidden() -> None:
    parts = {part for node in ("master_device", "slave_device") for part in NODES[node][1]}
    assert {"audio", "safety", "servo_cp"} <= parts
    assert {"audio", "safety", "servo_cp", PLAYED_TOPICS} == set(RESERVED)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device made of two: any two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest

from haptic_accel.core.axes import along_actuator
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, ParameterError, from_flat, parameter
from haptic_accel.devices import MASTERS, SLAVES, Device, DeviceError, Sample
from haptic_accel.devices.interface import LATER, CombinedDevice, CombinedTool, combined
from haptic_accel.setup.node_parameters import build_parameters


@dataclass(frozen=True)
class NotedParameters(Checked):
    level: float = parameter(0.0, "that it tells")
    broken: bool = parameter(False, "whether it can be opened")
    silent: bool = parameter(False, "whether it has no samples")


class Noted(Device):
    """Notes what happens to it."""

    Parameters = NotedParameters
    name = ""
    log: list[tuple[Any, ...]]

    def __init__(self, parameters: NotedParameters, rate: float, seed: int) -> None:
        self.parameters = parameters

    def open(self) -> None:
        self.log.append((self.name, "open"))
        if self.parameters.broken:
            raise DeviceError(f"{self.name}: broken")

    def read(self, time: float) -> Sample | None:
        if self.parameters.silent:
            return None
        level = self.parameters.level
        return Sample((level, time, 0.0), (0.0, level, 0.0), along_actuator(level))

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        self.log.append((self.name, arm_force, actuator_force))

    def close(self) -> None:
        self.log.append((self.name, "close"))
        if self.parameters.broken:
            raise DeviceError(f"{self.name}: broken")

    def arm(self) -> bool | None:
        return not self.parameters.broken and (None if self.parameters.silent else True)

    @property
    def remark(self) -> str:
        return self.name

    @property
    def hang_warning(self) -> str:
        return self.name if self.parameters.silent else ""

    @property
    def problem(self) -> str:
        return f"{self.name} is silent" if self.parameters.silent else ""

    @property
    def late(self) -> int:
        return int(self.parameters.level)

    def counters(self) -> dict[str, int]:
        return {"count": int(self.parameters.level)}


class Arm(Noted):
    name = "the arm"


class Handle(Noted):
    name = "the handle"


Both = combined({"lab_arm": Arm, "lab_handle": Handle}, "lab_arm", "lab_handle")


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    events: list[tuple[Any, ...]] = []
    monkeypatch.setattr(Noted, "log", events, raising=False)
    return events


def built(**values: Any) -> CombinedDevice:
    """Build one whose parts have parameters ``arm__NAME`` and ``handle__NAME``."""
    flat = {name.replace("__", "."): value for name, value in values.items()}
    parts = ("arm", "handle")
    options = {f"lab_{part}": from_flat(NotedParameters, flat, f"{part}.") for part in parts}
    return Both.from_options("lab", options, 1000.0, 0)


def test_motion_is_the_arm_s_and_acceleration_the_handle_s() -> None:
    device = built(arm__level=1.0, handle__level=2.0)
    assert device.read(5.0) == Sample((1.0, 5.0, 0.0), (0.0, 1.0, 0.0), along_actuator(2.0))
    assert device.counters() == {"arm_count": 1, "handle_count": 2}
    assert device.late == 3
    assert device.remark == "the arm; the handle"
    assert device.hang_warning == ""
    assert built(arm__silent=True).hang_warning == "the arm"
    assert not device.ended


class Turned(Noted):
    """Arm whose tool is turned by a quarter about z."""

    def read(self, time: float) -> Sample | None:
        return Sample(ZERO, ZERO, ZERO, (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))


class Slanted(Noted):
    """Tool with three axes."""

    def read(self, time: float) -> Sample | None:
        return Sample(ZERO, ZERO, (1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("sensor", "kind", "felt"),
    [
        (Slanted, CombinedTool, (-2.0, 1.0, 3.0)),
        (Slanted, CombinedDevice, (1.0, 2.0, 3.0)),  # a handle stays in its own axes
        (Handle, CombinedTool, along_actuator(2.0)),  # one axis has no direction
    ],
)
def test_the_acceleration_of_a_turned_tool_has_the_axes_of_the_base(
    sensor: type[Noted], kind: type[CombinedDevice], felt: Vector
) -> None:
    device = combined({"arm": Turned, "tool": sensor}, "arm", "tool", kind)
    options = {"arm": NotedParameters(), "tool": NotedParameters(level=2.0)}
    sample = device.from_options("both", options, 1000.0, 0).read(0.0)
    assert isinstance(sample, Sample)
    assert sample.acceleration == pytest.approx(felt)


def test_a_sample_comes_later_while_either_part_s_does(monkeypatch: pytest.MonkeyPatch) -> None:
    device = built()
    with monkeypatch.context() as patched:
        patched.setattr(Handle, "read", lambda self, time: LATER)
        assert device.read(0.0) is LATER
    monkeypatch.setattr(Arm, "read", lambda self, time: LATER)
    # A handle gives each of its samples once: it must not be read before the arm has one.
    monkeypatch.setattr(Handle, "read", lambda self, time: pytest.fail("read too early"))
    assert device.read(0.0) is LATER


def test_without_a_part_there_is_no_sample() -> None:
    for part in ("arm", "handle"):
        device = built(**{f"{part}__silent": True})
        assert device.read(0.0) is None
        assert device.problem == f"the {part} is silent"
        assert device.arm() is None
        assert built(**{f"{part}__broken": True}).arm() is False
    assert built().arm() is True
    assert built().problem == ""


def test_each_gets_its_own_force(log: list[tuple[Any, ...]]) -> None:
    device = built()
    device.write(0.0, arm_force=ZERO)
    device.write(0.0, actuator_force=along_actuator(1.0))
    device.write(0.0, arm_force=ZERO, actuator_force=along_actuator(0.0))
    arm, handle = ("the arm", ZERO, None), ("the handle", None, along_actuator(1.0))
    assert log == [arm, handle, ("the handle", None, ZERO), arm]


def test_both_are_opened_or_none(log: list[tuple[Any, ...]]) -> None:
    built().open()
    assert log == [("the arm", "open"), ("the handle", "open")]
    log.clear()
    with pytest.raises(DeviceError, match="the handle"):
        built(handle__broken=True).open()
    assert log[-1] == ("the arm", "close")
    log.clear()
    with pytest.raises(DeviceError, match="the arm"):
        built(arm__broken=True).open()
    assert ("the handle", "open") not in log


@pytest.mark.parametrize("broken", ["arm", "handle"])
def test_one_is_closed_though_the_other_fails(log: list[tuple[Any, ...]], broken: str) -> None:
    with pytest.raises(DeviceError):
        built(**{f"{broken}__broken": True}).close()
    assert {event for event in log} == {("the arm", "close"), ("the handle", "close")}


@pytest.mark.parametrize("devices", [MASTERS, SLAVES])
def test_a_part_that_is_not_there_is_named_and_both_are_closed(devices: dict) -> None:
    side = "master_device" if devices is MASTERS else "slave_device"
    values = {"can.interface": "virtual", "can.channel": "nobody", "can.start_timeout": 0.1}
    values["serial.port"] = "/dev/none"
    _, options = build_parameters(side, values)
    device = devices["can_serial"].from_options("can_serial", options, 1000.0, 0)
    with pytest.raises((RuntimeError, ParameterError), match="can: virtual nobody: no heartbeat"):
        device.open()
    device.close()

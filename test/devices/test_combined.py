# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device made of two: any two."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, ParameterError, from_flat, parameter, schema
from haptic_accel.devices import MASTERS, SLAVES, Device, DeviceError, Sample
from haptic_accel.devices.combined import CombinedDevice
from haptic_accel.devices.interface import LATER


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
        return Sample((level, time, 0.0), (0.0, level, 0.0), level)

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: float | None = None
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
    def unguarded(self) -> str:
        return self.name if self.parameters.silent else ""

    @property
    def problem(self) -> str:
        return f"{self.name} is silent" if self.parameters.silent else ""

    @property
    def late(self) -> int:
        return int(self.parameters.level)

    def status(self) -> dict[str, int]:
        return {"count": int(self.parameters.level)}


class Arm(Noted):
    name = "the arm"


class Handle(Noted):
    name = "the handle"


@dataclass(frozen=True)
class BothParameters:
    arm: NotedParameters = field(default_factory=NotedParameters)
    handle: NotedParameters = field(default_factory=NotedParameters)


class Both(CombinedDevice):
    Parameters = BothParameters
    ArmDevice = Arm
    HandleDevice = Handle


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    events: list[tuple[Any, ...]] = []
    monkeypatch.setattr(Noted, "log", events, raising=False)
    return events


def built(**values: Any) -> Both:
    flat = {name.replace("__", "."): value for name, value in values.items()}
    return Both(from_flat(BothParameters, flat), 1000.0, 0)


def test_parameters_are_those_of_both_by_part() -> None:
    assert set(schema(Both.Parameters)) == {
        "arm.level",
        "arm.broken",
        "handle.level",
        "handle.broken",
        "arm.silent",
        "handle.silent",
    }


def test_motion_is_the_arm_s_and_acceleration_the_handle_s() -> None:
    device = built(arm__level=1.0, handle__level=2.0)
    assert device.read(5.0) == Sample((1.0, 5.0, 0.0), (0.0, 1.0, 0.0), 2.0)
    assert device.status() == {"arm_count": 1, "handle_count": 2}
    assert device.late == 3
    assert device.remark == "the arm; the handle"
    assert device.unguarded == ""
    assert built(arm__silent=True).unguarded == "the arm"
    assert not device.ended


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
    device.write(0.0, actuator_force=1.0)
    device.write(0.0, arm_force=ZERO, actuator_force=0.0)
    assert log == [
        ("the arm", ZERO, None),
        ("the handle", None, 1.0),
        ("the handle", None, 0.0),
        ("the arm", ZERO, None),
    ]


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


# Arms on CAN with boards on serial lines


@pytest.mark.parametrize("devices", [MASTERS, SLAVES])
def test_parameters_are_those_of_both_parts(devices: dict) -> None:
    names = set(schema(devices["can_serial"].Parameters))
    arm = set(schema(devices["can"].Parameters, "arm."))
    handle = set(schema(devices["serial"].Parameters, "handle."))
    assert names == arm | handle


@pytest.mark.parametrize("devices", [MASTERS, SLAVES])
def test_a_part_that_is_not_there_is_named_and_both_are_closed(devices: dict) -> None:
    kind = devices["can_serial"]
    parameters = from_flat(
        kind.Parameters,
        {
            "arm.interface": "virtual",
            "arm.channel": "nobody",
            "arm.start_timeout": 0.1,
            "handle.port": "/dev/none",
        },
    )
    device = kind(parameters, 1000.0, 0)
    with pytest.raises((RuntimeError, ParameterError), match="can: virtual nobody: no heartbeat"):
        device.open()
    device.close()

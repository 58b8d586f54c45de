# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Opening a bus as users of python-can expect it, and what stands in the way."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices.can.device import (
    DEFAULT_BITRATE,
    bitrate_of,
    bus_configuration,
    frame_of,
    message_of,
    open_bus,
)
from haptic_accel.devices.can.parameters import CanMasterParameters, CanParameters
from haptic_accel.devices.can.protocol import Frame
from haptic_accel.devices.interface import DeviceError
from running import python


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give python-can a home without its configuration, and no environment."""
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in [name for name in os.environ if name.startswith("CAN_")]:
        monkeypatch.delenv(name)
    return tmp_path


def test_parameters_are_enough() -> None:
    given = {"interface": "virtual", "channel": "a", "bitrate": 500_000}
    parameters = CanParameters(**given, options='{"rx_queue_size": 7}')
    configuration = bus_configuration(parameters)
    assert configuration == {**given, "rx_queue_size": 7}
    assert bitrate_of(configuration) == 500e3


def test_python_can_s_own_file_is_respected_with_a_section_for_each_arm(home: Path) -> None:
    shared = "[default]\ninterface = virtual\nchannel = shared\nbitrate = 250000\n"
    (home / ".canrc").write_text(f"{shared}[master]\nchannel = own\n")
    assert bus_configuration(CanParameters())["channel"] == "shared"
    configuration = bus_configuration(CanMasterParameters())
    assert configuration["channel"] == "own"
    assert configuration["interface"] == "virtual"
    assert bitrate_of(configuration) == 250e3
    # What is given goes over it.
    assert bus_configuration(CanMasterParameters(channel="given"))["channel"] == "given"


def test_so_is_its_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    monkeypatch.setenv("CAN_CHANNEL", "plain")
    monkeypatch.setenv("CAN_CHANNEL_master", "own")
    monkeypatch.setenv("CAN_CONFIG", json.dumps({"rx_queue_size": 5}))
    assert bus_configuration(CanParameters())["channel"] == "plain"
    configuration = bus_configuration(CanMasterParameters())
    assert configuration["channel"] == "own"
    assert configuration["rx_queue_size"] == 5
    assert bitrate_of(configuration) == DEFAULT_BITRATE


def bus(interface: str, channel: str) -> dict[str, str]:
    return {"interface": interface, "channel": channel}


WRONG: dict[str, tuple[dict[str, Any], type[Exception], str]] = {
    "none": ({}, ParameterError, "can.interface = '.*: must be one of .*virtual"),
    "unknown": ({"interface": "tin"}, ParameterError, "can.interface = 'tin': must be one of"),
    "no channel": ({"interface": "slcan"}, ParameterError, "can.channel = ''"),
    "missing channel": (bus("slcan", "/dev/none"), DeviceError, "can: slcan /dev/none: there is"),
    "no adapter": (
        bus("slcan", "/dev/null"),
        DeviceError,
        "can: slcan /dev/null: Could not configure port",
    ),
    "no driver": (bus("vector", "0"), DeviceError, "its driver is missing"),
    # Without CAN in the kernel the driver is what is missing, with it the channel.
    "no interface": (bus("socketcan", "can77"), DeviceError, "socketcan can77: (its dr|there is)"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_stands_in_the_way_is_said_in_one_line(what: str) -> None:
    values, kind, text = WRONG[what]
    with pytest.raises(kind, match=text) as error:
        open_bus(bus_configuration(CanParameters(**values)), [0])
    assert "\n" not in str(error.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="an administrator may open anything")
def test_no_permission_is_told_from_no_channel(tmp_path: Path) -> None:
    channel = tmp_path / "adapter"
    channel.touch(mode=0)
    with pytest.raises(DeviceError, match="no permission: join the group"):
        open_bus(bus_configuration(CanParameters(interface="slcan", channel=str(channel))), [0])


def test_ids_are_standard_and_only_an_arm_s_own_frames_come() -> None:
    configuration = bus_configuration(CanParameters(interface="virtual", channel="ids"))
    bus, arm = open_bus(configuration, []), open_bus(configuration, [2])
    try:
        for frame in (Frame(0x21, b"1"), Frame(0x41, b"2"), Frame(0x49, remote=True)):
            bus.send(message_of(frame))
        found = [arm.recv(1.0), arm.recv(1.0)]
        expected = [Frame(0x41, b"2"), Frame(0x49, remote=True)]
        assert [message and frame_of(message) for message in found] == expected
        assert not any(message.is_extended_id for message in found if message)
        assert arm.recv(0.0) is None
    finally:
        bus.shutdown()
        arm.shutdown()


def test_the_package_needs_no_python_can_until_a_bus_is_opened() -> None:
    script = (
        "import sys; sys.modules['can'] = None\n"
        "from haptic_accel.devices import MASTERS\n"
        "device = MASTERS['can'](MASTERS['can'].Parameters(), 1000.0, 0)\n"
        "try: device.open()\n"
        "except Exception as error: print(type(error).__name__, error)\n"
        "device.close()"
    )
    done = python("-c", script)
    assert done.stdout.startswith("DeviceError can: python-can is not installed: pip install")
    assert done.stderr == ""

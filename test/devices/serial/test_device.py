# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serial drivers without a board: what they are told wrongly, and what does not answer."""

from __future__ import annotations

import os
import re
import threading
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.parameters import ParameterError, from_flat
from haptic_accel.devices import DeviceError
from haptic_accel.devices.serial.device import SerialDevice, SerialMaster, SerialSlave
from haptic_accel.devices.serial.protocol import Decoder, Frame, encode
from running import python


def built(kind: type[SerialDevice], **values: Any) -> SerialDevice:
    flat = {name.replace("__", "."): value for name, value in values.items()}
    return kind(from_flat(kind.Parameters, flat), 1000.0, 0)


def test_the_package_does_without_the_libraries_until_a_port_is_opened() -> None:
    code = (
        "import sys; sys.modules['serial'] = sys.modules['cobs'] = None\n"
        "from haptic_accel.cli import bench, calibrate, main\n"
        "from haptic_accel.devices import SLAVES, DeviceError\n"
        "kind = SLAVES['serial']\n"
        "try: kind(kind.Parameters(port='/dev/null'), 1000.0, 0).open()\n"
        "except DeviceError as error: print(error)\n"
    )
    done = python("-c", code, check=True)
    assert done.stdout == "serial: needs pyserial and cobs: pip install 'haptic_accel[serial]'\n"


def test_a_missing_port_and_a_wrong_one_are_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no terminal")
    for name, told in (("none", "no such port; is it plugged in"), ("file", "serial port")):
        path = tmp_path / name
        with pytest.raises(DeviceError, match=f"^{re.escape(str(path))}: .*{told}"):
            built(SerialSlave, port=str(path)).open()


def test_an_unknown_usb_serial_number_is_told() -> None:
    with pytest.raises(DeviceError, match="^USB serial number none-such: not plugged in; "):
        built(SerialSlave, usb_serial="none-such").open()


def test_whoever_does_not_answer_is_no_board() -> None:
    master, terminal = os.openpty()
    try:
        with pytest.raises(DeviceError, match="no answer; is there a board with this firmware"):
            built(SerialSlave, port=os.ttyname(terminal)).open()
    finally:
        os.close(master)
        os.close(terminal)


def test_another_version_of_the_protocol_is_told_with_what_to_flash() -> None:
    def older(frame: Frame) -> bytes:
        return encode(frame._replace(version=1))

    master, terminal = os.openpty()
    device = built(SerialSlave, port=os.ttyname(terminal))
    decoder = Decoder()

    def answer() -> None:
        while True:
            try:
                heard = decoder.feed(os.read(master, 1000))
            except OSError:
                return
            for frame in heard:
                os.write(master, older(frame))

    thread = threading.Thread(target=answer)
    thread.start()
    with pytest.raises(DeviceError, match=": speaks version 1 .*, must be 3: flash firm"):
        device.open()
    os.close(terminal)
    thread.join()
    os.close(master)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"port": ""}, "serial.port"),
        ({"usb_serial": "1"}, "serial.port = 'none': must be .* serial.usb_serial .* not both"),
        ({"calibration__axis": "w"}, ".*axis"),
        ({"actuator__force_constant": 0.0}, ".*force_constant"),
        ({"axes": "z y"}, "axes = z, y: must be some of x, y, z"),
        ({"coil_mounting": "1 0 0"}, "serial.coil_mounting = '1 0 0': must be 9 finite numbers"),
        (
            {"coil_mounting": "1 0 0, 1 0 0, 0 0 1"},
            "serial.coil_mounting: axes that are not orthogonal enough",
        ),
        ({"calibration__mounting": "a"}, "serial.calibration.mounting = 'a': must be 9 finite"),
        ({"calibration__gains": "1 nan 1"}, "serial.calibration.gains = '1 nan 1': must be 3"),
        ({"calibration__offsets": "1"}, "serial.calibration.offsets = '1': must be 3 finite"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(values: dict[str, str], told: str) -> None:
    with pytest.raises(ParameterError, match=f"^{told}") as raised:
        built(SerialMaster, **{"port": "none", "axes": "x y z", **values})
    assert "\n" not in str(raised.value)

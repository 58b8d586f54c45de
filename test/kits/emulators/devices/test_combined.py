# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arms on CAN with boards on serial lines, as one device."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.devices import SLAVES, Sample
from haptic_accel.devices.serial.protocol import Identity
from haptic_accel.devices.simulated import SimulatedSlave, SimulatedSlaveParameters
from haptic_accel.kits.emulators.can_line import CanLine, EmulatedArm, SlcanPort
from haptic_accel.kits.emulators.ports import CAN_FAULTS, Faults, run
from haptic_accel.kits.emulators.serial_line import EmulatedBoard, SerialLines
from haptic_accel.setup.files import read_parameter_file
from haptic_accel.setup.node_parameters import build_parameters
from running import on_thread, wait_until

RATE = 100.0  # Hz
GIVEN = """
slave_device:
  ros__parameters:
    can: {{channel: {arm}, {can}}}
    serial: {{port: {board}}}
"""
CAN = (
    "interface: slcan, options: '{\"sleep_after_open\": 0}', heartbeat_timeout: 2.0,"
    " estimates_timeout: 1.0, start_timeout: 10.0"
)


@contextmanager
def plugged(options: dict[str, Any], board: Path) -> Iterator[None]:
    """Plug in the drives of an arm, and a board that is shaken by 5 m/s^2."""
    rig = SimulatedSlave(SimulatedSlaveParameters(), RATE, 0)
    arm = EmulatedArm(options["can"], rig, rate=RATE, watchdog=0.4)
    identity = Identity((1, 0, 0), 0b111, 10_000, 49.0, (0.0, 0.0, 0.0), "tool-1")
    emulated = EmulatedBoard(identity, board, lambda time: (0.0, 0.0, 5.0))
    port = SlcanPort(Path(options["can"].channel))
    line = CanLine(port, [arm], RATE, Faults("", CAN_FAULTS, 1.0))
    parts = [line, SerialLines([emulated])]
    with closing(emulated), closing(line), on_thread(partial(run, parts)):
        yield


@pytest.mark.smoke
def test_arm_and_board_are_given_as_when_either_is_alone(tmp_path: Path) -> None:
    file, arm, board = (tmp_path / name for name in ("mine.yaml", "arm", "board"))
    file.write_text(GIVEN.format(arm=arm, board=board, can=CAN))
    _, options = build_parameters("slave_device", read_parameter_file(file)["slave_device"])
    with plugged(options, board):
        device = SLAVES["can_serial"].from_options("can_serial", options, RATE, 0)
        with closing(device):
            device.open()

            def shaken() -> bool:
                sample = device.read(round((time.monotonic() - 0.05) * RATE) / RATE)
                return isinstance(sample, Sample) and sample.acceleration[
                    ACTUATOR_AXIS
                ] == pytest.approx(5.0, abs=0.01)

            wait_until(shaken, "a sample of both")
            assert "can: slcan" in device.remark
            assert "board tool-1" in device.remark

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drivers of boards with three coils and sensor axes, through real pseudo-terminals."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from haptic_accel.core.axes import ALL_AXES
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.devices.interface import DeviceError, Sample
from haptic_accel.devices.serial.device import SerialDevice, SerialSlave
from haptic_accel.devices.serial.protocol import FULL_SCALE, Identity
from running import wait_until

ONE = Identity((3, 0, 0), 0b111, 5000, 49.0, (0.0, 0.0, 2.75), "one-1")
THREE = replace(ONE, full_scale_currents=(2.75, 1.0, 2.75), serial_number="three-1")
RATE = 1000.0
TURNED = "0 1 0, -1 0 0, 0 0 1"
"""Axes of a sensor, or coils, that are turned by 90 degrees about z."""

DEFAULTS = {"axes": "x y z"}
"""Parameters of each device."""

Make = Callable[..., Any]


def feel(device: SerialDevice) -> Vector:
    """Return the acceleration at a tick that has just passed."""
    sample = device.read(round((time.monotonic() - 0.005) * RATE) / RATE)
    return sample.acceleration if isinstance(sample, Sample) else (math.nan,) * 3


def push(device: SerialDevice, board: Any, force: Vector, currents: Vector) -> None:
    """Command a force again and again, as a graph does, until its currents flow."""

    def flows() -> bool:
        for _ in range(25):
            device.write(time.monotonic(), actuator_force=force)
            if board.emulated.currents == pytest.approx(currents, abs=2e-4):
                return True
            time.sleep(0.002)
        return False

    wait_until(flows, f"{currents} A")


def test_three_axes_are_measured_and_driven_together(bench: Make, connect: Make) -> None:
    board = bench(THREE)
    device = connect(board)
    assert device.axes == ALL_AXES
    board.hold(10.0)
    wait_until(lambda: feel(device) == pytest.approx((1.0, 2.0, 10.0), abs=2e-3), "all three")
    wait_until(lambda: device.counters()["aligned"] == 1, "alignment")
    push(device, board, (1.2, -0.6, 2.4), (0.5, -0.25, 1.0))  # 2.4 N/A
    wait_until(lambda: board.emulated.currents == ZERO, "the time-out of all coils")


def test_a_force_beyond_a_coil_keeps_its_direction_and_one_that_is_no_number_is_not_felt(
    bench: Make, connect: Make
) -> None:
    board = bench(THREE)
    device = connect(board)
    # The coil along y reaches its own full scale of 1 A first.
    push(device, board, (2.4, 4.8, -2.4), (0.5, 1.0, -0.5))
    for wrong in (math.nan, math.inf):
        push(device, board, (1.2, 1.2, 1.2), (0.5, 0.5, 0.5))
        push(device, board, (wrong, 1.2, 1.2), ZERO)


def test_sensor_and_coils_are_turned_to_the_frame_of_the_handle(
    bench: Make, connect: Make
) -> None:
    board = bench(THREE)
    board.hold(10.0)
    count = 49.0 / FULL_SCALE
    device = connect(
        board,
        calibration__mounting=TURNED,
        calibration__gains=f"{2 * count} {count} {count}",
        calibration__offsets=f"{0.5 / count} 0 0",
        coil_mounting=TURNED,
    )
    # The sensor's x is the handle's y, with (1 - 0.5) * 2 m/s^2, and its y the handle's -x.
    wait_until(lambda: feel(device) == pytest.approx((-2.0, 1.0, 10.0), abs=4e-3), "turned ones")
    assert ", calibrated" in device.remark
    push(device, board, (1.2, 0.6, 2.4), (0.25, -0.5, 1.0))


def test_a_device_with_one_axis_uses_one_coil_of_three(bench: Make, connect: Make) -> None:
    board = bench(THREE)
    board.hold(10.0)
    device = connect(board, axes="z", coil_mounting=TURNED)
    wait_until(lambda: feel(device) == pytest.approx((0.0, 0.0, 10.0), abs=2e-3), "samples")
    push(device, board, (0.0, 0.0, 1.2), (0.0, 0.0, 0.5))


def test_a_sensor_at_an_angle_is_turned_for_a_single_coil(bench: Make, connect: Make) -> None:
    board = bench(ONE)
    board.hold(10.0)
    # The handle's z is the sensor's y.
    device = connect(board, axes="z", calibration__mounting="0 1 0, 0 0 1, 1 0 0")
    wait_until(lambda: feel(device) == pytest.approx((0.0, 0.0, 2.0), abs=2e-3), "samples")


@pytest.mark.usefixtures("older")
def test_a_board_with_protocol_2_is_refused_for_three_axes(bench: Make, connect: Make) -> None:
    with pytest.raises(DeviceError, match="board one-1 has a coil along z, must along x, y, z"):
        connect(bench(ONE))


def test_a_board_of_one_axis_is_refused_for_three_in_one_line(bench: Make, connect: Make) -> None:
    board = bench(ONE)
    with pytest.raises(DeviceError) as raised:
        connect(board)
    assert str(raised.value) == (
        f"{board.path}: board one-1 has a coil along z, must along x, y, z: set serial.axes, or"
        " flash firmware for three coils (firmware/README.md)"
    )
    # A tool needs no coils, but a sensor with all axes.
    connect(board, SerialSlave).close()
    tool = bench(replace(ONE, axes=0b100), name="tool")
    with pytest.raises(DeviceError, match="board one-1 does not have the requested axis"):
        connect(tool, SerialSlave)

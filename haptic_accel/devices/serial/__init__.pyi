# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.devices.serial.board_samples import BoardSamples as BoardSamples
from haptic_accel.devices.calibration import (STILL as STILL,
    CalibrationError as CalibrationError, calibrate as calibrate, rest as rest,
    vertical as vertical)
from haptic_accel.devices.serial.device import (HIGHEST_BOARD_RATE as HIGHEST_BOARD_RATE,
    MISSING_LIBRARY as MISSING_LIBRARY, PortParameters as PortParameters,
    SerialMaster as SerialMaster, SerialSlave as SerialSlave)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from haptic_accel.devices.interface import (
    Device as Device,
    DeviceDescription as DeviceDescription,
    DeviceError as DeviceError,
    Joints as Joints,
    Sample as Sample,
)
from haptic_accel.devices.registry import MASTERS as MASTERS, SLAVES as SLAVES

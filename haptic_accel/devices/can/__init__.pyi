# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.devices.can.arm import kinematics_of as kinematics_of
from haptic_accel.devices.can.device import (bus_configuration as bus_configuration,
    frame_of as frame_of, message_of as message_of, open_bus as open_bus)
from haptic_accel.devices.can.parameters import (KINEMATICS as KINEMATICS, STREAMED as STREAMED,
    CanParameters as CanParameters)

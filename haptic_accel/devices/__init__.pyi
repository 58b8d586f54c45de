# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.devices.audio import (AUDIO as AUDIO, read_channels as read_channels,
    recorded as recorded)
from haptic_accel.devices.interface import (CombinedTool as CombinedTool, Device as Device,
    DeviceDescription as DeviceDescription, DeviceError as DeviceError, Joints as Joints,
    Sample as Sample, combined as combined)
from haptic_accel.devices.observed import (ForceOverTime as ForceOverTime,
    Observation as Observation, ObservedDevice as ObservedDevice)
from haptic_accel.devices.playback import bag_track as bag_track, is_bag as is_bag
from haptic_accel.devices.registry import MASTERS as MASTERS, SLAVES as SLAVES
from haptic_accel.devices.simulated import (SimulatedDevice as SimulatedDevice,
    SimulatedMaster as SimulatedMaster, SimulatedSlave as SimulatedSlave)
from haptic_accel.devices.sound_bench import MOST_HEARD as MOST_HEARD, NO_ARM as NO_ARM
from haptic_accel.devices.calibration import (by_gravity as by_gravity,
    check_level as check_level)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.core.actuator import (ActuatorParameters as ActuatorParameters,
    SafetyParameters as SafetyParameters)
from haptic_accel.core.axes import ALL_AXES as ALL_AXES, VIBRATION as VIBRATION
from haptic_accel.core.files import (located as located, opened as opened, read_xml as read_xml,
    replace_file as replace_file, sync_folder as sync_folder, whole_folder as whole_folder)
from haptic_accel.core.control.channel import LARGEST_GAIN as LARGEST_GAIN, RAMP as RAMP
from haptic_accel.core.control.compensation import Compensation as Compensation
from haptic_accel.core.control.fallback import NO_CONTROLLER as NO_CONTROLLER
from haptic_accel.core.control.filters import (HIGH_PASS_FREQUENCY as HIGH_PASS_FREQUENCY,
    without_hand_motion as without_hand_motion)
from haptic_accel.core.coupling.engagement import (Engagement as Engagement,
    EngagementParameters as EngagementParameters)
from haptic_accel.core.model import (ACTUATOR as ACTUATOR, GRAVITY as GRAVITY, ZERO as ZERO,
    vector as vector)
from haptic_accel.core.network.endpoint import random_session as random_session
from haptic_accel.core.network.playout import PLAYED_KINDS as PLAYED_KINDS
from haptic_accel.core.axes import REDUCTIONS as REDUCTIONS
from haptic_accel.core.simulated_rig import (RigParameters as RigParameters,
    build_loop as build_loop)
from haptic_accel.core.surfaces.texture import (autocovariance as autocovariance,
    from_polynomial as from_polynomial, levinson as levinson)
from haptic_accel.core.tables import DASH as DASH, records as records
from haptic_accel.core.two_hosts import (ArmEndpoint as ArmEndpoint,
    HalfCouplingPart as HalfCouplingPart, HalfEngagement as HalfEngagement)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.core.actuator import (MANUAL as MANUAL, ActuatorParameters as ActuatorParameters,
    SafetyParameters as SafetyParameters)
from haptic_accel.core.axes import (ACTUATOR_AXES as ACTUATOR_AXES, ALL_AXES as ALL_AXES,
    NAMES as NAMES, Orientation as Orientation, REDUCTIONS as REDUCTIONS, VIBRATION as VIBRATION)
from haptic_accel.core.crtk import (CRTK_MESSAGES as CRTK_MESSAGES, ENABLE as ENABLE,
    ENABLED as ENABLED)
from haptic_accel.core.files import (located as located, opened as opened, read_xml as read_xml,
    replace_file as replace_file, sync_folder as sync_folder, whole_folder as whole_folder)
from haptic_accel.core.control.channel import LARGEST_GAIN as LARGEST_GAIN, RAMP as RAMP
from haptic_accel.core.control.compensation import Compensation as Compensation
from haptic_accel.core.control.fallback import NO_CONTROLLER as NO_CONTROLLER
from haptic_accel.core.control.filters import (HIGH_PASS_FREQUENCY as HIGH_PASS_FREQUENCY,
    without_hand_motion as without_hand_motion)
from haptic_accel.core.coupling.engagement import (STOPPED as STOPPED, Decision as Decision,
    Engagement as Engagement, EngagementParameters as EngagementParameters)
from haptic_accel.core.coupling.passive import (NONSENSE as NONSENSE, PassiveHalf as PassiveHalf,
    of_slave as of_slave, scaled as scaled)
from haptic_accel.core.model import (ACTUATOR as ACTUATOR, Force as Force, GRAVITY as GRAVITY,
    ZERO as ZERO, vector as vector)
from haptic_accel.core.network import (TRANSPORTS as TRANSPORTS, UDP as UDP, Channel as Channel,
    Crossing as Crossing, host_and_port as host_and_port, is_loopback as is_loopback)
from haptic_accel.core.simulated_rig import (RigParameters as RigParameters,
    build_loop as build_loop)
from haptic_accel.core.surfaces.texture import (autocovariance as autocovariance,
    from_polynomial as from_polynomial, levinson as levinson)
from haptic_accel.core.tables import DASH as DASH, records as records

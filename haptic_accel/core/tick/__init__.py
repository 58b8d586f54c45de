# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sections that run in every sample; import their names from here."""

from haptic_accel.core.tick._unit import COMPILED, PLAIN, TICK
from haptic_accel.core.tick.control import *
from haptic_accel.core.tick.coupling import *
from haptic_accel.core.tick.device_side import *
from haptic_accel.core.tick.guard import *
from haptic_accel.core.tick.limits import *
from haptic_accel.core.tick.loop import *
from haptic_accel.core.tick.loss_concealment import *
from haptic_accel.core.tick.rigs import *
from haptic_accel.core.tick.samples import *
from haptic_accel.core.tick.watching import *

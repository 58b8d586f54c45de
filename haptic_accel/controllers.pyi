# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from haptic_accel.core.control.controllers import CONTROLLERS as CONTROLLERS
from haptic_accel.core.control.controllers.interface import Controller as Controller, Loop as Loop

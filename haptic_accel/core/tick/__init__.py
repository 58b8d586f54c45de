# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What runs in every sample, to be imported from here."""

from __future__ import annotations

from haptic_accel.core.tick.guard import CUSHION as CUSHION
from haptic_accel.core.tick.guard import CUSHION_END as CUSHION_END
from haptic_accel.core.tick.guard import LARGEST_ACCELERATION as LARGEST_ACCELERATION
from haptic_accel.core.tick.guard import ActuatorGuard as ActuatorGuard
from haptic_accel.core.tick.guard import TravelEstimator as TravelEstimator
from haptic_accel.core.tick.guard import scale_within as scale_within
from haptic_accel.core.tick.kernels import add_scaled, dot, dots, peak, product, row_dot
from haptic_accel.core.tick.limits import STOPPED as STOPPED
from haptic_accel.core.tick.limits import SafetyLayer as SafetyLayer
from haptic_accel.core.tick.watching import Trace as Trace

__all__ = ["add_scaled", "dot", "dots", "peak", "product", "row_dot"]

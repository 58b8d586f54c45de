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

"""Inverse of the approximate handle model (the paper's third condition)."""

from __future__ import annotations

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.filters import inverse_of
from haptic_accel.core.model import ApproximateModel
from haptic_accel.core.tick.control import FilterForce


class DynamicController(FilterForce, Controller):
    """Inverse of the paper's approximate model, from a_hdes to f_a."""

    Parameters = ApproximateModel

    def __init__(self, parameters: ApproximateModel, loop: Loop) -> None:
        super().__init__(inverse_of(parameters, loop.rate))

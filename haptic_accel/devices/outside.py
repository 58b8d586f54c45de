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

"""Checks of drivers that other installed packages declare by entry points."""

from __future__ import annotations

from collections.abc import Mapping

from haptic_accel.core.outside import parameters_problem
from haptic_accel.core.parameters import schema
from haptic_accel.devices.interface import Device, DeviceDescription

MASTERS_GROUP, SLAVES_GROUP = "haptic_accel.masters", "haptic_accel.slaves"
"""Groups of entry points: drivers of the master's and of the slave's arm."""


def driver_problem(kind: type[Device], known: Mapping[str, type[Device]]) -> str:
    """Return the reason to refuse a class as a driver; empty for a driver."""
    described, parameters = kind.description, kind.Parameters
    if not isinstance(described, DeviceDescription):
        return "description must be a DeviceDescription"
    own = {name: each for name, each in known.items() if not each.description.parameters_of}
    for name in described.parameters_of:
        if name not in own:
            return f"description.parameters_of: {name}: must be one of {', '.join(own)}"
    if described.parameters_of:
        parameters = own[described.parameters_of[0]].Parameters
    if problem := parameters_problem(parameters):
        return problem
    names = schema(parameters)
    for name in described.changeable:
        if name not in names:
            return f"description.changeable: {name}: must be one of {', '.join(names)}"
    return ""

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

"""The verb ``haptic-accel bringup``: its heading and summary."""

from __future__ import annotations

from haptic_accel.commands import KitVerb

VERB = KitVerb(
    "Devices",
    "bring up a rig in five steps, and write its parameter file",
    "haptic_accel.kits.bringup.command_line",
)

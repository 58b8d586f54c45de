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

"""The verb ``haptic-accel emulate``: its verbs and their summaries."""

from __future__ import annotations

from haptic_accel.commands import KitVerb, LazyGroup

GROUP = LazyGroup(
    "emulate",
    {
        "Hardware": {
            "can": "two arms of ODrives on CAN",
            "serial": "boards of handle and tool on USB serial",
        },
        "Network": {"network": "delay, jitter and loss between two hosts"},
    },
    module="haptic_accel.kits.emulators.command_line",
    help="Emulate boards or arms to test the drivers without hardware, or a bad network.",
    examples=["haptic-accel emulate serial", "haptic-accel emulate can faults:=estimates@2"],
)

VERB = KitVerb("Devices", "emulate boards or arms without hardware, or a bad network", group=GROUP)

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

"""The verb ``haptic-accel texture``: its verbs and their summaries."""

from __future__ import annotations

from haptic_accel.commands import KitVerb, LazyGroup

GROUP = LazyGroup(
    "texture",
    {
        "Verbs": {
            "build": "build a model from recordings with speed, force and acceleration",
            "import": "make a model of another program's file",
            "show": "show a model's range and spectra",
            "render": "write a model's acceleration as a sound file",
        }
    },
    module="haptic_accel.kits.textures.command_line",
    help="Build, import, show and render models of textures.",
    examples=[
        "haptic-accel texture build drag.csv --rate 10000 --out wood.yaml",
        "haptic-accel texture render plywood --speed 80 --force 1 --out wood.wav",
    ],
)

VERB = KitVerb("Surfaces", "build, import, show and render models of textures", group=GROUP)

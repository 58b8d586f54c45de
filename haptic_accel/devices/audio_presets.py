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
"""Kinds of coils that people own, with what is assumed about them, for `audio.preset`."""

from __future__ import annotations

from typing import NamedTuple


class AudioPreset(NamedTuple):
    """Coils behind a sound card whose handle has not been identified.

    Attributes
    ----------
    device : str
        Part of the sound card's name; empty for the default card.
    channels : str
        Output channels of the coils, from 1.
    rate : float
        Samples per second, Hz; 0 for the card's default.
    assumed : str
        Assumptions, and their source.
    unknown : str
        Properties that must be identified before forces are in newtons and controllers know the
        handle.
    """

    device: str
    channels: str
    rate: float
    assumed: str
    unknown: str


PRESETS = {
    "dualsense": AudioPreset(
        *("DualSense", "3, 4", 48000.0),
        "a DualSense on USB, by its public descriptor: four channels of 16 bit at 48 kHz, of which"
        " 3 and 4 are the voice coils in the left and right grip",
        "force at full scale; the grips' dynamics: its own inertial sensor, at some 250 Hz, is too"
        " slow, so fix an accelerometer to a grip",
    ),
    "exciter": AudioPreset(
        *("", "1, 2", 0.0),
        "an exciter on either channel of a stereo amplifier, fixed to the handle",
        "force at full scale, which the amplifier's volume sets; resonance; mass of the handle",
    ),
    "bass_shaker": AudioPreset(
        *("", "1, 2", 0.0),
        "a bass shaker on either channel of a stereo amplifier, fixed to the handle",
        "force at full scale, which the amplifier's volume sets; resonance, often at some 40 Hz,"
        " above which the force falls; mass of the handle",
    ),
}
"""Presets by name."""

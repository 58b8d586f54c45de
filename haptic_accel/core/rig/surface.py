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

"""Surface parameters: contact, and the height profile of the texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, parameter

PROFILE_STEP = 5e-6
"""Spacing of the height profile, m: a sixtieth of the shortest wavelength allowed."""

PROFILE_POINTS = 2**16
"""Number of points in the profile, which repeats every 0.33 m; strokes are shorter."""


@dataclass(frozen=True)
class SurfaceParameters(Checked):
    """Parameters of a surface: contact, friction, and two kinds of texture."""

    name: str = parameter("plain", "name of the surface in results")
    stiffness: float = parameter(
        3e6, "contact force divided by penetration^1.5 (Hertz)", "N/m^1.5", 1e3, 1e8
    )
    contact_damping: float = parameter(
        1.5,
        "factor of the penetration velocity in the contact force (Hunt and Crossley 1975)",
        "s/m",
        0.0,
        1e3,
    )
    friction: float = parameter(
        0.3, "coefficient of sliding friction on the surface", low=0.0, high=2.0
    )
    roughness: float = parameter(0.0, "RMS height of the irregular texture", "m", 0.0, 1e-3)
    shortest_wavelength: float = parameter(
        0.4e-3,
        "shortest wavelength of the irregular texture; the tip's radius filters shorter ones",
        "m",
        0.3e-3,
        0.1,
    )
    longest_wavelength: float = parameter(
        4e-3, "longest wavelength of the irregular texture", "m", 0.3e-3, 0.1
    )
    roughness_exponent: float = parameter(
        1.0, "negative exponent of height power over spatial frequency", low=0.0, high=6.0
    )
    bump_height: float = parameter(0.0, "height of raised features; 0 for none", "m", 0.0, 1e-3)
    bump_width: float = parameter(
        0.6e-3, "width of a raised feature at half height", "m", 0.1e-3, 0.05
    )
    bump_pitch: float = parameter(2e-3, "mean distance between raised features", "m", 0.2e-3, 0.1)
    bump_irregularity: float = parameter(
        0.0, "standard deviation of the features' distance, divided by its mean", low=0.0, high=1.0
    )
    texture: str = parameter(
        "", "texture whose acceleration is added to that of the profile: its name or file; or none"
    )


def height_profile(surface: SurfaceParameters, seed: int | tuple[int, int]) -> FloatArray:
    """Return heights in m at multiples of `PROFILE_STEP`, periodic in `PROFILE_POINTS`.

    Parameters
    ----------
    surface : SurfaceParameters
    seed : int or tuple of int
        Seed of the texture; another seed gives another piece of the same material.
    """
    random = np.random.default_rng(seed)
    return _roughness(surface, random) + _bumps(surface, random)


def _roughness(surface: SurfaceParameters, random: np.random.Generator) -> FloatArray:
    """Return Gaussian noise with a power-law spectrum between two wavelengths."""
    turns = random.random(PROFILE_POINTS // 2 + 1)
    if surface.roughness == 0:
        return np.zeros(PROFILE_POINTS)
    frequency = np.fft.rfftfreq(PROFILE_POINTS, PROFILE_STEP)
    within = (frequency >= 1 / surface.longest_wavelength) & (
        frequency <= 1 / surface.shortest_wavelength
    )
    amplitude = frequency[within] ** (-surface.roughness_exponent / 2)
    spectrum = np.zeros(len(frequency), dtype=complex)
    spectrum[within] = amplitude * np.exp(2j * np.pi * turns[within])
    heights = np.fft.irfft(spectrum, PROFILE_POINTS)
    deviation = heights.std()
    # If no wavelength of a periodic profile lies between the two, the surface is smooth.
    return np.asarray(heights * (surface.roughness / deviation if deviation > 0 else 0.0))


def _bumps(surface: SurfaceParameters, random: np.random.Generator) -> FloatArray:
    """Return Gaussian ridges at more or less regular distances."""
    length = PROFILE_POINTS * PROFILE_STEP
    if surface.bump_height == 0:
        return np.zeros(PROFILE_POINTS)
    count = max(1, round(length / surface.bump_pitch))
    spread = surface.bump_irregularity * length / count
    centres = np.arange(count) * (length / count) + random.normal(0.0, 1.0, count) * spread
    impulses = np.bincount(
        np.round(centres / PROFILE_STEP).astype(int) % PROFILE_POINTS, minlength=PROFILE_POINTS
    )
    position = np.arange(PROFILE_POINTS) * PROFILE_STEP
    distance = np.minimum(position, length - position)
    # Full width at half height of a Gaussian: 2 sqrt(2 ln 2) standard deviations.
    sigma = surface.bump_width / (2 * np.sqrt(2 * np.log(2)))
    ridge = surface.bump_height * np.exp(-0.5 * (distance / sigma) ** 2)
    heights = np.fft.irfft(np.fft.rfft(impulses) * np.fft.rfft(ridge), PROFILE_POINTS)
    return np.asarray(heights)

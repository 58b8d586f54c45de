# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shipped textures against other drags over the surfaces that they are built from."""

from __future__ import annotations

import numpy as np
import pytest
from build_textures import RATE, SURFACES, drag
from scipy import signal

from haptic_accel.core.parameters import from_flat
from haptic_accel.core.rig.slave_rig import SurfaceParameters
from haptic_accel.materials.folders import config_folder
from haptic_accel.materials.texture_files import read_texture
from haptic_accel.setup.files import surface_parameters

OTHERS = ((0.055, 2.0), (0.09, 0.45), (0.13, 0.8), (0.19, 1.3))
"""Speeds, m/s, and forces, N, between those that the textures are built from."""


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize(("speed", "force"), OTHERS)
def test_a_drag_at_another_speed_and_force_has_the_shipped_spectrum(
    name: str, speed: float, force: float
) -> None:
    surface = from_flat(SurfaceParameters, surface_parameters(name), "simulated.surface.")
    acceleration = drag(surface, speed, force, seed=1000).acceleration
    model = read_texture(config_folder() / f"textures/{name}.yaml")
    frequency, measured = signal.welch(acceleration, RATE, nperseg=64)
    within = (frequency >= 20) & (frequency <= 450)
    ratio = model.spectrum(speed, force, frequency[within]) / measured[within]
    assert np.sqrt(np.mean((10 * np.log10(ratio)) ** 2)) <= 3.5
    lines, power = signal.periodogram(acceleration, RATE, scaling="spectrum")
    measured_rms = np.sqrt(power[(lines >= 20) & (lines <= 450)].sum())
    modelled_rms = np.sqrt(model.spectrum(speed, force, np.linspace(20, 450, 431)).mean() * 430)
    assert modelled_rms == pytest.approx(measured_rms, rel=0.15)

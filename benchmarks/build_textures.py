# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Build the shipped texture models from the simulated surfaces that they are named after.

``python benchmarks/build_textures.py [SURFACE ...]`` writes ``config/textures/SURFACE.yaml``.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from haptic_accel import Provenance
from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.parameters import from_flat
from haptic_accel.core.rig.slave_rig import SlaveRig, SlaveRigParameters, SurfaceParameters
from haptic_accel.kits.textures import Recording, build
from haptic_accel.materials import config_folder, write_texture
from haptic_accel.setup.files import surface_parameters

SURFACES = ("plywood", "text", "vinyl")

RATE = 1000.0
SPEEDS = (0.02, 0.03, 0.045, 0.07, 0.11, 0.16, 0.22)
"""Speeds of the tool, m/s: the paper's strokes reach 0.1 m/s, fast ones of a hand 0.2 m/s."""

FORCES = (0.3, 0.6, 1.0, 1.6, 2.4)
"""Forces with which the arm presses, N: a Phantom Omni's motors reach 3.3 N."""

SECONDS, LANDED = 2.0, 0.5
"""Duration of each drag, and the time before it in which the tool lands and gathers speed, s."""

GUIDE = 20.0
"""Force with which the arm keeps the speed, N s/m: stiff for a hand, soft beside the texture."""


def drag(surface: SurfaceParameters, speed: float, force: float, seed: int) -> Recording:
    """Return a recording of the tool, drawn over a surface at a speed in m/s and a force in N."""
    parameters = replace(SlaveRigParameters(), surface=surface)
    rig, tool = SlaveRig(parameters, RATE, seed), parameters.tool
    friction = surface.friction * force + tool.coulomb_friction + tool.viscous_friction * speed
    rows = []
    for tick in range(round((LANDED + SECONDS) * RATE)):
        rig.advance(tick / RATE)
        sample = rig.measure()
        velocity = sample.velocity[0]
        rows.append((abs(velocity), force, sample.acceleration[ACTUATOR_AXIS]))
        rig.apply_arm_force((friction + GUIDE * (speed - velocity), 0.0, -force))
    columns = np.array(rows[round(LANDED * RATE) :]).T
    return Recording(f"{speed:g} m/s, {force:g} N", RATE, *columns)


def main(surfaces: list[str]) -> None:
    """Build and write the models of some surfaces."""
    for name in surfaces:
        surface = from_flat(SurfaceParameters, surface_parameters(name), "simulated.surface.")
        conditions = [(speed, force) for force in FORCES for speed in SPEEDS]
        drags = [drag(surface, *each, seed) for seed, each in enumerate(conditions)]
        provenance = Provenance(
            source=f"simulated surface {name}: {len(drags)} drags by benchmarks/build_textures.py",
            licence="Apache-2.0",
            author="haptic_accel maintainers",
            calibration="simulated accelerometer of 500 Hz bandwidth, in m/s^2",
        )
        built = build(name, drags, provenance)
        write_texture(config_folder() / "textures" / f"{name}.yaml", built.model)
        rms = [each.modelled_rms / each.rms for each in built.held_out]
        print(
            f"{name}: order {built.order}, {built.measured} of {len(built.model.speeds)} nodes"
            f" measured, {built.distance:.2f} dB, RMS {min(rms):.2f} to {max(rms):.2f} of the"
            f" measured, coverage {built.coverage:.2f}"
        )


if __name__ == "__main__":
    main(sys.argv[1:] or list(SURFACES))

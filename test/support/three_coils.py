# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Handle with three coils for tests: a known plant, and its recorded motion."""

from __future__ import annotations

import numpy as np
from scipy import signal

from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.identification import sweep
from haptic_accel.core.identification.fit import Friction, Point
from haptic_accel.core.identification.motion import simulated
from haptic_accel.core.model import FloatArray, HandleParameters, MountParameters

RATE = 1000.0
RANGE = 49.0
BANDWIDTH = 500.0
SWEEP = sweep.SweepParameters(start_frequency=8.0, end_frequency=450.0, duration=1.0)
NOISE = 0.07
STEP = 2 * RANGE / 2.0**16

DIRECTIONS = np.array([[1.0, 0.2, -0.1], [0.25, 1.0, 0.15], [0.05, -0.3, 1.0]])


def plant(directions: FloatArray = DIRECTIONS, *, modes: bool = True) -> MatrixPlant:
    """Return a plant with unequal axes and a coupling of -12 to -20 dB that lasts some samples."""
    grips = ((0.11, 1200.0, 9.0), (0.128, 1500.0, 11.0), (0.14, 1700.0, 12.0))
    mounts = ((250.0, 0.15), (287.0, 0.15), (320.0, 0.2)) if modes else ((0.0, 0.2),) * 3
    handles = (HandleParameters(m_h=m_h, k_u=k_u, b_u=b_u) for m_h, k_u, b_u in grips)
    x, y, z = (
        Plant(handle=handle, mount=MountParameters(*mount), delay=3e-4)
        for handle, mount in zip(handles, mounts, strict=True)
    )
    coupling = np.zeros((3, 3, 6))
    coupling[:, :, 0] = directions
    coupling[0, 1, 1:] = 0.1 * 0.5 ** np.arange(5)
    coupling[2, 0, 1:] = -0.1 * 0.6 ** np.arange(5)
    return MatrixPlant((x, y, z), coupling, RATE)


def moved(handle: MatrixPlant, force: FloatArray, friction: float = 0.0) -> FloatArray:
    """Return the acceleration for coil forces from rest on, shape (n, 3), m/s^2."""
    bearing = Friction(friction)
    own = np.stack(
        [
            simulated([Point(p.handle, p.mount, p.delay, p.bandwidth, bearing)], each, RATE)[0]
            for p, each in zip(handle.axes, force.T, strict=True)
        ]
    )
    pairs = [zip(own, row, strict=True) for row in handle.coupling]
    caused = [[signal.fftconvolve(*each)[: len(force)] for each in pair] for pair in pairs]
    return np.asarray(np.sum(caused, axis=1).T)


def recorded(clean: FloatArray, force: FloatArray, seed: int = 0) -> sweep.IdentificationTrial:
    """Return a trial with sensor noise, offset and a converter of 16 bit."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, clean.shape)
    measured = np.round((clean + noise + (0.0, 0.1, 0.3)) / STEP) * STEP
    return sweep.IdentificationTrial(RATE, force, measured, {})


def trials(
    handle: MatrixPlant, count: int = 2, seed: int = 0, friction: float = 0.0
) -> list[sweep.IdentificationTrial]:
    """Return recorded trials of a handle."""
    force = sweep.orthogonal_excitation(SWEEP, RATE)
    clean = moved(handle, force, friction)
    return [recorded(clean, force, 1000 * seed + trial) for trial in range(count)]

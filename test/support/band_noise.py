# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Noise between two frequencies, which stands for textures."""

from __future__ import annotations

import numpy as np
from scipy import signal

from haptic_accel.core.model import FloatArray


def band_noise(
    low: float,
    high: float,
    seconds: float,
    rms: float,
    *,
    seed: int = 1,
    rate: float = 1000.0,
    axes: tuple[int, ...] = (),
) -> FloatArray:
    """Return noise between two frequencies, of an RMS in each axis, if there are several."""
    noise = np.random.default_rng(seed).standard_normal((round(seconds * rate), *axes))
    band = signal.butter(2, [low, high], "bandpass", fs=rate, output="sos")
    passed = signal.sosfilt(band, noise, axis=0)
    return np.asarray(rms * passed / passed.std(axis=0))

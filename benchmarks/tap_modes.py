# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fit of the modes of a simulated tap to a recorded one."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from haptic_accel import FloatArray, ParameterError
from haptic_accel.core.parameters import check_positive_rate
from haptic_accel.core.surfaces.taps import MOST_MODES, Mode

_PENCIL_SAMPLES = 400  # maximum for finding poles: the effort grows with their cube
_RANK_TOLERANCE = 1e-9  # relative singular value below which there is only rounding
_LOWEST_MODE = 10.0  # Hz: slower modes are the tool's motion, not vibration
_WEAKEST_MODE = 1e-3  # relative amplitude: weaker modes fit noise


def fitted_modes(acceleration: FloatArray, rate: float, count: int) -> tuple[Mode, ...]:
    """Fit decaying sinusoids by the matrix pencil (Hua and Sarkar 1990).

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        Acceleration after one impact, divided by its speed, 1/s; the first sample is one period
        after the impact.
    rate : float
        Samples per second.
    count : int
        Number of modes, at most `MOST_MODES`.

    Returns
    -------
    tuple of Mode
        Largest amplitude first; fewer than `count` if fewer modes oscillate above 10 Hz and decay.

    Raises
    ------
    ParameterError
        `count` or `rate` is out of range, or there are too few samples for `count` modes.
    """
    check_positive_rate(rate)
    if not 1 <= count <= MOST_MODES:
        raise ParameterError(f"count = {count}: must be from 1 to {MOST_MODES}")
    if len(acceleration) < 6 * count:
        raise ParameterError(
            f"{len(acceleration)} samples: must be at least {6 * count} for {count} modes"
        )
    poles = _poles(acceleration[:_PENCIL_SAMPLES], 2 * count)
    frequencies = np.angle(poles) * rate / (2 * np.pi)
    poles = poles[(frequencies > _LOWEST_MODE) & (np.abs(poles) < 1)]
    steps = np.arange(1, len(acceleration) + 1)
    powers = poles ** steps[:, np.newaxis]
    basis = np.hstack([powers.imag, powers.real])  # sine and cosine of each mode
    sines, cosines = np.linalg.lstsq(basis, acceleration, rcond=None)[0].reshape(2, -1)
    modes = [
        Mode(
            frequency=float(np.angle(pole)) * rate / (2 * math.pi),
            decay=-math.log(abs(pole)) * rate,
            amplitude=math.hypot(sine, cosine),
            phase=math.atan2(cosine, sine),
        )
        for pole, sine, cosine in zip(poles, sines, cosines, strict=True)
    ]
    modes.sort(key=lambda mode: -mode.amplitude)
    return tuple(mode for mode in modes if mode.amplitude > _WEAKEST_MODE * modes[0].amplitude)


def _poles(signal: FloatArray, count: int) -> npt.NDArray[np.complex128]:
    """Return the poles of a sum of `count` exponentials, from the shift of its signal space."""
    width = len(signal) // 2
    hankel = np.lib.stride_tricks.sliding_window_view(signal, width)
    _, strengths, rows = np.linalg.svd(hankel, full_matrices=False)
    space = rows[:count][strengths[:count] > _RANK_TOLERANCE * strengths[0]].T
    shift = np.linalg.lstsq(space[:-1], space[1:], rcond=None)[0]
    return np.asarray(np.linalg.eigvals(shift), dtype=np.complex128)

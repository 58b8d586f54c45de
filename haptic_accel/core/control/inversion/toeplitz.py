# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Iterative solution of Toeplitz equations in small steps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from haptic_accel.core.model import FloatArray


def improved(
    columns: FloatArray, right: FloatArray, starts: FloatArray
) -> Iterator[FloatArray | None]:
    """Yield improving solutions of symmetric positive definite Toeplitz equations.

    Method: conjugate gradients with products by fast Fourier transforms, and T. Chan's circulant
    as preconditioner (R. Chan and Ng, Conjugate gradient methods for Toeplitz systems, SIAM Review
    38, 1996). Each step reduces the quadratic form itself, the error of the filter; Levinson's
    recursion has no intermediate results. All matrices take a step together, as a call costs more
    than the transform of a short sequence.

    Parameters
    ----------
    columns : ndarray, shape (k, n)
        First column of each matrix.
    right : ndarray, shape (k, n) or (n,)
        Right sides, or one for all.
    starts : ndarray, shape (k, n)
        Initial solutions.

    Yields
    ------
    ndarray, shape (k, n), or None
        Solutions after another step; None between its parts, of one transform each. Ends when a
        step improves no solution.

    Examples
    --------
    >>> columns, right = np.array([[2.0, 1.0, 0.0]]), np.array([4.0, 8.0, 8.0])
    >>> *_, last = filter(lambda each: each is not None, improved(columns, right, 0.0 * columns))
    >>> np.round(last, 6).tolist()
    [[1.0, 2.0, 3.0]]
    """
    count, length = columns.shape
    size = 2 * length
    mirrored = np.concatenate([np.zeros((count, 1)), columns[:, :0:-1]], axis=1)
    matrices = np.fft.rfft(np.concatenate([columns, mirrored], axis=1)).real
    yield None
    index = np.arange(length)
    circulants = np.fft.rfft(((length - index) * columns + index * mirrored) / length).real
    yield None
    spectra = matrices * np.fft.rfft(starts, size)
    yield None
    residuals = right - np.fft.irfft(spectra, size)[:, :length]
    yield None
    spectra = np.fft.rfft(right) / circulants
    expected = np.fft.irfft(spectra, length)
    least = np.finfo(float).eps ** 2 * _products(expected, np.broadcast_to(right, columns.shape))
    yield None
    solutions, directions = starts, np.zeros_like(starts)
    before = np.full(count, np.inf)
    while True:
        spectra = np.fft.rfft(residuals) / circulants
        yield None
        corrected = np.fft.irfft(spectra, length)
        remaining = _products(residuals, corrected)
        # Solutions without improvement remain unchanged.
        going_on = remaining > least
        if not going_on.any():
            return
        directions = corrected + (remaining / before)[:, np.newaxis] * directions
        before = np.where(going_on, remaining, np.inf)
        yield None
        spectra = matrices * np.fft.rfft(directions, size)
        yield None
        moved = np.fft.irfft(spectra, size)[:, :length]
        yield None
        energy = np.where(going_on, _products(directions, moved), np.inf)
        steps = (remaining / energy)[:, np.newaxis]
        solutions = solutions + steps * directions
        residuals = residuals - steps * moved
        yield solutions


def _products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the scalar products of corresponding rows."""
    return np.asarray((one[:, np.newaxis] @ other[:, :, np.newaxis])[:, 0, 0])

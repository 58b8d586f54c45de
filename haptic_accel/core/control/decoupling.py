# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Decoupling of a handle with three coils into three independent plants.

Let the plant be G = K diag(p_x, p_y, p_z), let each force u_j follow its own desired acceleration,
and let D K = K D = I. After filtering by D, the handle's acceleration a and the desired
acceleration d are related axis by axis: (D a)_j = p_j u_j. D is thus placed before the
controllers. After them, it would have to commute with the p_j, which differ. Each controller's
force is that of its coil, with the coil's own heat, travel and friction.
"""

from __future__ import annotations

import numpy as np

from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass_response
from haptic_accel.core.control.inversion.spectrum import PRIOR, ToolSpectrum
from haptic_accel.core.handle.plant import MatrixPlant
from haptic_accel.core.handle.response import grid_for
from haptic_accel.core.model import FloatArray

DECOUPLING_LENGTH = 0.2
"""Length of a decoupling filter, s, as of an inverse: twenty times the decay time of a structural
mode at 100 Hz with a damping ratio of 0.15."""

MOST_TAPS = 512
"""Maximum length of a decoupling filter: its equations have three times as many unknowns."""

RIDGE = 1e-4
"""Penalty on the decoupling filter's gain relative to the mean weight: an error below 0.1 % in the
band, and no large gain above it, where hardly any texture is expected."""


def full_decoupling(
    plant: MatrixPlant,
    spectrum: ToolSpectrum = PRIOR,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
) -> FloatArray:
    """Design the causal inverse of a plant's coupling K.

    The integral over frequency of S |K D - I|^2 is minimised, where S is the spectrum of the
    desired acceleration. As K has no delay of its own, none is granted. Below the high-pass, where
    no identification shows K, D is unconstrained.

    Parameters
    ----------
    plant : MatrixPlant
    spectrum : callable
        Spectrum of the tool's acceleration.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.

    Returns
    -------
    ndarray, shape (3, 3, n)
        Impulse responses of D at the plant's rate.
    """
    from scipy.linalg import cho_factor, cho_solve

    if plant.coupling.shape[2] == 1:
        return np.asarray(np.linalg.inv(plant.directions)[:, :, np.newaxis])
    length = max(1, min(round(DECOUPLING_LENGTH * plant.rate), MOST_TAPS))
    grid = grid_for(plant.rate, max(length, plant.coupling.shape[2]))
    passed = high_pass_response(high_pass_frequency, grid.frequency, plant.rate)
    weights = spectrum(grid.frequency) * np.abs(passed) ** 2
    response = np.array([[grid.spectrum(each) for each in row] for row in plant.coupling])
    weighted = weights * response.conj()
    gram, sides = (
        np.array([[grid.sequence(each)[:length] for each in row] for row in spectra])
        for spectra in (np.einsum("iaf,ibf->abf", weighted, response), weighted.transpose(1, 0, 2))
    )
    later = np.arange(length)[:, np.newaxis] - np.arange(length)
    # Negative lags of the coils (a, b) are positive lags of (b, a).
    gram = np.where(later >= 0, gram[:, :, abs(later)], gram.transpose(1, 0, 2)[:, :, abs(later)])
    matrix = gram.transpose(0, 2, 1, 3).reshape(3 * length, 3 * length)
    matrix[np.diag_indices_from(matrix)] += RIDGE * matrix.diagonal().mean()
    # Each column of the identity has a right-hand side.
    columns = sides.transpose(0, 2, 1).reshape(3 * length, 3)
    taps = cho_solve(cho_factor(matrix, overwrite_a=True), columns).reshape(3, length, 3)
    return np.ascontiguousarray(taps.transpose(0, 2, 1))

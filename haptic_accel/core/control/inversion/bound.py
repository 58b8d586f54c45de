"""Smallest error of any causal linear filter on a known plant."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass_response
from haptic_accel.core.control.inversion.design import Goal
from haptic_accel.core.control.inversion.plant import Dynamics, Grid, grid_for
from haptic_accel.core.control.inversion.spectrum import PRIOR, ToolSpectrum
from haptic_accel.core.model import ComplexArray, FloatArray

STEP = 0.05
"""Distance of the frequencies that the bound is computed at, Hz: a memory of ten seconds."""


def causal_bound(
    plant: Dynamics,
    rate: float,
    spectrum: ToolSpectrum = PRIOR,
    *,
    granted_delay: int = 1,
    noise: float = 0.0,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
) -> float:
    """Smallest error that a causal linear filter of the desired acceleration can have.

    The Wiener filter without limits of memory, force and travel: with the spectral factor Q of
    the desired acceleration, and the plant P as an all-pass A times a minimum phase, the error
    is the part of A* z^-granted_delay Q before time zero (Wiener 1949; Doyle, Francis and
    Tannenbaum, Feedback Control Theory, 1992). It is an infimum: coming near it may take
    more travel than there is. `design_inverse` for the same spectrum and `predict` give the
    error within a limit of travel.

    Parameters
    ----------
    plant : Plant or IdentifiedPlant
    rate : float
        Samples per second.
    spectrum : callable
        Spectrum of the tool's acceleration; `measured_spectrum` makes it from a signal.
    granted_delay : int
        Number of samples by which the handle may lag.
    noise : float
        Standard deviation of a sample of the handle's accelerometer, m/s^2: all of it counts as
        error, whatever the filter.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz. It has no zero outside the unit circle, so that
        a filter of the tool's acceleration can do no better than one of the desired.

    Returns
    -------
    float
        Percent, as `Evaluation.nrmse_percent`.

    Raises
    ------
    ParameterError
        A number is out of range.
    """
    Goal(granted_delay, high_pass_frequency=high_pass_frequency).check(rate)
    grid = grid_for(rate, step=STEP)
    frequency = grid.frequency
    passed = np.abs(high_pass_response(high_pass_frequency, frequency, rate)) ** 2
    desired = spectrum(frequency) * passed
    response = plant.response(frequency, rate)
    all_pass = response / _minimum_phase(grid, np.abs(response))
    factor = _minimum_phase(grid, np.sqrt(desired))
    wanted = grid.sequence(all_pass.conj() * grid.delay(granted_delay) * factor)
    missed = float(np.sum(wanted[grid.points :] ** 2) / np.sum(wanted**2))
    noise_share = 2.0 * noise**2 / rate * len(frequency) / float(np.sum(desired))
    return 100.0 * float(np.sqrt(missed + noise_share))


def _minimum_phase(grid: Grid, magnitude: FloatArray) -> ComplexArray:
    """Return the response of minimum phase with a magnitude, by its cepstrum."""
    cepstrum = grid.sequence(np.log(magnitude))[: grid.points]
    cepstrum[1:] *= 2.0
    return np.asarray(np.exp(grid.spectrum(cepstrum)))

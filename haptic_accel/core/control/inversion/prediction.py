# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Prediction of a filter's error, force and travel from the tool's spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.filters import high_pass_response, section_response
from haptic_accel.core.control.inversion.design import LANDING_VELOCITY, InverseFilter
from haptic_accel.core.control.inversion.spectrum import PRIOR, ToolSpectrum
from haptic_accel.core.handle.plant import Dynamics
from haptic_accel.core.handle.response import grid_for, travel_response
from haptic_accel.core.model import ComplexArray, FloatArray


@dataclass(frozen=True)
class Prediction:
    """Predicted error, force and travel of a filter, and its tracking by frequency.

    Attributes
    ----------
    nrmse_percent : float
        Error after the granted delay, as in `Evaluation`.
    force_rms : float
        Root mean square of the force, N.
    travel_rms : float
        Root mean square of the actuator's displacement from the handle, m.
    landing_travel : float
        Maximum displacement after a change of the tool's velocity by `LANDING_VELOCITY`, m.
    frequency : ndarray, shape (n,)
        Frequencies, Hz, evenly spaced, without 0.
    tracking : ndarray, shape (n,)
        Handle over desired acceleration after the granted delay, complex; 1 is ideal.
    """

    nrmse_percent: float
    force_rms: float
    travel_rms: float
    landing_travel: float
    frequency: FloatArray
    tracking: ComplexArray

    @property
    def gain(self) -> FloatArray:
        """Magnitude of `tracking`."""
        return np.abs(self.tracking)

    @property
    def phase(self) -> FloatArray:
        """Angle of `tracking`, rad; positive if the handle leads."""
        return np.angle(self.tracking)


def predict(
    inverse: InverseFilter, plant: Dynamics, spectrum: ToolSpectrum = PRIOR, *, noise: float = 0.0
) -> Prediction:
    """Predict error, force and travel of a filter for a plant without limits and friction.

    Parameters
    ----------
    inverse : InverseFilter
    plant : Plant or IdentifiedPlant
        True plant, which may differ from the design plant.
    spectrum : callable
        Spectrum of the measured tool acceleration.
    noise : float
        Standard deviation of a sample of the handle's accelerometer, m/s^2; all of it counts as
        error.
    """
    rate = inverse.rate
    grid = grid_for(rate, len(inverse.taps))
    frequency = grid.frequency
    passed = high_pass_response(inverse.goal.high_pass_frequency, frequency, rate)
    extended = section_response(inverse.sections, frequency, rate) * grid.spectrum(inverse.taps)
    force = passed * extended
    tracking = plant.response(frequency, rate) * extended / grid.delay(inverse.goal.granted_delay)
    power = spectrum(frequency)
    desired = power * np.abs(passed) ** 2
    noise_density = 2.0 * noise**2 / rate
    error = desired * np.abs(tracking - 1.0) ** 2 + noise_density
    density = error / (float(np.sum(desired)) * grid.spacing)
    travel = travel_response(plant.handle, frequency)
    landing = np.abs(grid.sequence(force * travel)).max() * LANDING_VELOCITY * rate
    return Prediction(
        nrmse_percent=100.0 * _rms(density, grid.spacing),
        force_rms=_rms(power * np.abs(force) ** 2, grid.spacing),
        travel_rms=_rms(power * np.abs(force * travel) ** 2, grid.spacing),
        landing_travel=float(landing),
        frequency=frequency,
        tracking=tracking,
    )


def _rms(density: FloatArray, step: float) -> float:
    return float(np.sqrt(np.sum(density) * step))

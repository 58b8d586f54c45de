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
"""Smallest vector errors of causal linear filters on a known plant with three coils."""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass_response
from haptic_accel.core.control.inversion import bound
from haptic_accel.core.control.inversion.design import Goal
from haptic_accel.core.control.inversion.spectrum import SEGMENT_SECONDS, SENSOR_DENSITY
from haptic_accel.core.handle.plant import MatrixPlant
from haptic_accel.core.handle.response import Grid, grid_for, travel_response
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.tick import CUSHION_END

CONVERGED = 1e-6
"""Largest change of a spectral factor, relative to 1, that ends its iteration."""

MOST_ITERATIONS = 40
"""Limit of the iteration: it halves a deviation at first, and squares it at the end."""


def matrix_bounds(
    plant: MatrixPlant,
    rate: float,
    acceleration: FloatArray,
    *,
    granted_delay: int = 1,
    noise: float = 0.0,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
    actuator: ActuatorParameters | None = None,
) -> bound.Bounds:
    """Return the smallest errors of a vector by causal linear filters, as `bound.bounds`.

    These are Wiener filters from the three components of the tool's acceleration to the forces of
    the coils, without limits, and with costs of travel and force that are equal for all coils and
    just high enough for each coil to stay within its limits.

    Parameters
    ----------
    plant : MatrixPlant
        Plant with coupling and latency.
    rate : float
        Samples per second.
    acceleration : ndarray, shape (n, 3)
        Tool's acceleration, m/s^2. Its spectra and cross-spectra are fully known to the filters.
    granted_delay : int
        Permitted delay of the handle, in samples, with the plant's latency.
    noise : float
        Standard deviation of a sample of the handle's accelerometer in each axis, m/s^2.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    actuator : ActuatorParameters, optional
        Limits of each coil; default: Table I.

    Returns
    -------
    Bounds
        Root of the power of the error's vector over that of the desired one, percent.

    Raises
    ------
    ParameterError
        A parameter is out of range, or the rate is not that of the plant.
    """
    Goal(granted_delay, high_pass_frequency=high_pass_frequency).check(rate)
    grid = grid_for(rate, step=bound.STEP)
    frequency = grid.frequency
    tool = _tool_factor(grid, acceleration)
    passed = bound.minimum_phase(
        grid, np.abs(high_pass_response(high_pass_frequency, frequency, rate))
    )
    own = np.array([each.response(frequency, rate) for each in plant.axes])
    coupling = np.array([[grid.spectrum(each) for each in row] for row in plant.coupling])
    problem = _Problem(
        grid,
        coupling * own,
        tool,
        passed * tool,
        grid.delay(granted_delay),
        3 * 2.0 * noise**2 / rate * len(frequency),
    )
    actuator = actuator or ActuatorParameters()
    longest = CUSHION_END * actuator.travel
    travels = np.array([travel_response(each.handle, frequency) for each in plant.axes])
    travel = travels[:, np.newaxis]  # of each coil, for all inputs
    causal = problem.best(np.zeros(travel.shape)).error
    moved = bound.faded_in(acceleration, rate)
    return bound.Bounds(causal, problem.limited(travel, moved, longest, actuator.peak_force))


class _Problem(bound.Tracking):
    """Tracking of three spectra; all arrays of the plant have shape (3, 3, n)."""

    def best(self, cost: FloatArray) -> bound.Optimum:
        """Return the filter of least error for costs of each coil's power, shape (3, 1, n)."""
        response, target = self.response, self.delay * self.desired
        gram = _product(_adjoint(response), response)
        for coil in range(3):
            gram[coil, coil] += cost[coil, 0]
        factor = _right_factor(self.grid, gram)
        inverse = _inverse(factor)
        aimed = _product(_adjoint(inverse), _product(_adjoint(response), target))
        driven = _product(inverse, _causal(self.grid, aimed))
        missed = float(np.sum(np.abs(_product(response, driven) - target) ** 2))
        share = (missed + self.noise) / float(np.sum(np.abs(self.desired) ** 2))
        return bound.Optimum(_product(driven, _inverse(self.tool)), 100.0 * math.sqrt(share))

    def peak(self, response: ComplexArray, acceleration: FloatArray) -> float:
        """Return the largest magnitude of three causal responses to a tool's acceleration."""
        from scipy import signal

        points, samples = self.grid.points, len(acceleration)
        pulses = np.array([[self.grid.sequence(each) for each in row] for row in response])
        moved = signal.oaconvolve(acceleration.T[np.newaxis], pulses[..., :points], axes=-1)
        return float(np.abs(moved[..., :samples].sum(axis=1)).max())


def _tool_factor(grid: Grid, acceleration: FloatArray) -> ComplexArray:
    """Return the spectral factor Q of a tool's acceleration, whose spectrum is Q Q^H."""
    from scipy import signal

    segment = min(len(acceleration), round(SEGMENT_SECONDS * grid.rate))
    x, y = acceleration.T[:, np.newaxis], acceleration.T[np.newaxis, :]
    lines, cross = signal.csd(y, x, grid.rate, nperseg=segment)
    # At least the noise of the tool's accelerometer. The mean was removed: no line at 0 Hz.
    powers, vectors = np.linalg.eigh(np.moveaxis(cross[..., 1:], -1, 0))
    powers = np.maximum(powers, SENSOR_DENSITY**2)
    cross = np.moveaxis((vectors * powers[:, np.newaxis]) @ vectors.conj().swapaxes(1, 2), 0, -1)
    spectrum = np.array(
        [[np.interp(grid.frequency, lines[1:], each) for each in row] for row in cross]
    )
    # Q Q^H = S where Q^T is the right factor of S^T.
    return _right_factor(grid, spectrum.swapaxes(0, 1)).swapaxes(0, 1)


def _right_factor(grid: Grid, spectrum: ComplexArray) -> ComplexArray:
    """Return the causal F with a causal inverse for which F^H F is a given spectrum.

    A diagonal factor with the given powers makes most of it (by the cepstrum); Wilson's iteration
    finds the rest (SIAM J. Appl. Math. 23, 1972).
    """
    own = np.array([bound.minimum_phase(grid, np.sqrt(spectrum[j, j].real)) for j in range(3)])
    rest = spectrum / (own.conj()[:, np.newaxis] * own)
    factor = np.zeros_like(rest)
    unity = np.eye(3)[:, :, np.newaxis]
    factor += unity
    for _ in range(MOST_ITERATIONS):
        inverse = _inverse(factor)
        change = _product(_adjoint(inverse), _product(rest, inverse)) - unity
        factor = _product(unity + _causal(grid, change, first=0.5), factor)
        if float(np.abs(change).max()) < CONVERGED:
            break
    return np.asarray(factor * own)


def _causal(grid: Grid, spectrum: ComplexArray, first: float = 1.0) -> ComplexArray:
    """Return the part of a spectrum from time zero on, with a factor of the value at zero."""

    def part(each: ComplexArray) -> ComplexArray:
        sequence = grid.sequence(each)
        sequence[grid.points :] = 0.0
        sequence[0] *= first
        return grid.spectrum(sequence)

    return np.array([[part(each) for each in row] for row in spectrum])


def _product(a: ComplexArray, b: ComplexArray) -> ComplexArray:
    return np.asarray(np.einsum("ijf,jkf->ikf", a, b))


def _adjoint(a: ComplexArray) -> ComplexArray:
    return a.conj().swapaxes(0, 1)


def _inverse(a: ComplexArray) -> ComplexArray:
    return np.asarray(np.linalg.inv(a.transpose(2, 0, 1)).transpose(1, 2, 0))

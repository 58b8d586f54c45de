# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Smallest errors of causal linear filters on a known plant, with and without limits.

A plant with one coil is one with n coils where n = 1: responses have shape (n, n, lines).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass_response
from haptic_accel.core.control.inversion import (
    PRIOR,
    SEGMENT_SECONDS,
    SENSOR_DENSITY,
    Goal,
    ToolSpectrum,
    measured_spectrum,
    nearest,
)
from haptic_accel.core.handle.mechanics import Grid, grid_for, travel_response
from haptic_accel.core.handle.plant import Dynamics, MatrixPlant
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.tick import CUSHION_END

STEP = 0.05
"""Frequency resolution of the bounds, Hz: a memory of ten seconds."""

FADING_IN = 0.5
"""Duration of the fade-in of the input for a limited bound, s."""

TRAVEL_COSTS = [10.0**power for power in range(13)]
"""Costs of travel, s^-4: the smallest one allows all perceptible motion, the largest no travel.
Without this cost, the filter for a non-invertible plant integrates twice, for which no memory is
long enough."""

FORCE_COSTS = [10.0**power for power in range(-6, 9)]
"""Costs of force, (m/s^2 per N)^2: from less than the smallest response of a plant to a cost that
allows no force."""

_HALVINGS = 5  # bisections of the log distance of two costs: to 7 %

CONVERGED = 1e-6
"""Maximum change of a spectral factor, relative to 1, at which its iteration ends."""

MOST_ITERATIONS = 40
"""Maximum number of iterations: each halves a deviation at first, and squares it at the end."""


def causal_bound(
    plant: Dynamics,
    rate: float,
    spectrum: ToolSpectrum = PRIOR,
    *,
    granted_delay: int = 1,
    noise: float = 0.0,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
) -> float:
    """Return the smallest error of a causal linear filter of the desired acceleration.

    This is the Wiener filter without limits of memory, force and travel. Q is the spectral factor
    of the desired acceleration, and the plant P is an all-pass A times a minimum phase. The error
    is the part of A* z^-granted_delay Q before time zero (Wiener 1949; Doyle, Francis and
    Tannenbaum, Feedback Control Theory, 1992). It is an infimum: errors close to it may need more
    than the available travel, see `bounds`.

    Parameters
    ----------
    plant : Plant or IdentifiedPlant
    rate : float
        Samples per second.
    spectrum : callable
        Spectrum of the tool's acceleration; `measured_spectrum` computes it from a signal.
    granted_delay : int
        Permitted delay of the handle, in samples.
    noise : float
        Standard deviation of a sample of the handle's accelerometer, m/s^2; it adds to the error
        of any filter.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz. It has no zero outside the unit circle, so a
        filter of the tool's acceleration cannot be better than one of the desired acceleration.

    Returns
    -------
    float
        Percent, as `Evaluation.nrmse_percent`.

    Raises
    ------
    ParameterError
        A parameter is out of range.
    """
    grid = grid_for(rate, step=STEP)
    tool = minimum_phase(grid, np.sqrt(spectrum(grid.frequency)))[np.newaxis, np.newaxis]
    return _problem(plant, grid, tool, granted_delay, noise, high_pass_frequency).causal_error()


class Bounds(NamedTuple):
    """Least errors of causal linear filters for an input, percent, as `Evaluation.nrmse_percent`.

    Attributes
    ----------
    causal : float
        `causal_bound` of the input's spectrum.
    limited : float
        Least error with limited travel and force; never below `causal`.
    """

    causal: float
    limited: float


def bounds(
    plant: Dynamics | MatrixPlant,
    rate: float,
    acceleration: FloatArray,
    *,
    granted_delay: int = 1,
    noise: float = 0.0,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
    actuator: ActuatorParameters | None = None,
) -> Bounds:
    """Return the least errors of causal linear filters, without and with limits.

    The limited filters are the Wiener filters that minimise error^2 + c travel^2 + e force^2 for
    the input's own spectrum. The costs c and e are constant, the memory is unlimited, and plant
    and spectrum are fully known. The costs are the smallest for which the maximum travel, up to
    the cushion, and the maximum force for this input stay within the actuator's limits. The
    result thus bounds time-invariant filters with constant weights. A filter that reduces travel
    only when needed, such as excursion control, can have a smaller error if an input is large
    only briefly. Friction, heat and the travel due to gravity are neglected.

    With three coils these are the errors of a vector: the square root of the error's power over
    the power of the desired vector. The filters know the components' spectra and cross-
    The costs are equal for all coils, and just high enough for each coil to stay within its
    limits.

    Parameters
    ----------
    plant, rate, granted_delay, noise, high_pass_frequency
        As in `causal_bound`.
    acceleration : ndarray, shape (n,), or (n, 3) with three coils
        Tool's acceleration, m/s^2. It is faded in over `FADING_IN`, as a section of a longer
        signal would otherwise start with a jump that needs travel.
    actuator : ActuatorParameters, optional
        Actuator with the limits; default: Table I.

    Raises
    ------
    ParameterError
        A parameter is out of range.
    """
    actuator = actuator or ActuatorParameters()
    grid, tool = _tool_factor(acceleration, rate)
    problem = _problem(plant, grid, tool, granted_delay, noise, high_pass_frequency)
    longest = CUSHION_END * actuator.travel
    limited = problem.limited_error(acceleration, longest, actuator.peak_force)
    return Bounds(problem.causal_error(), limited)


def least_cost(costs: Sequence[float], keeps: Callable[[float], bool]) -> float:
    """Return the least cost that satisfies a limit: the first of a list, refined by bisection.

    A higher cost does not always lower a peak, as the phase changes too.
    """
    first = next((number for number, cost in enumerate(costs) if keeps(cost)), len(costs) - 1)
    if first == 0:
        return costs[0]
    low, high = map(math.log, costs[first - 1 : first + 1])
    return math.exp(nearest(lambda cost: keeps(math.exp(cost)), low, high, _HALVINGS))


def faded_in(acceleration: FloatArray, rate: float) -> FloatArray:
    """Return an acceleration, shape (n,) or (n, 3), without mean and initial jump."""
    fading = np.minimum(np.arange(len(acceleration)) / (FADING_IN * rate), 1.0)
    return np.asarray(((acceleration - acceleration.mean(axis=0)).T * fading).T)


class Optimum(NamedTuple):
    """Best filter: response from tool acceleration to the forces, and its error, %."""

    force: ComplexArray
    error: float


@dataclass(frozen=True)
class Tracking:
    """Tracking of the spectra of n axes by a plant with n coils, on a grid of frequencies.

    Attributes
    ----------
    grid : Grid
    response : ndarray, shape (n, n, lines)
        Response of the plant.
    travel : ndarray, shape (n, 1, lines)
        Travel of each coil over its force, m per N.
    tool, desired : ndarray, shape (n, n, lines)
        Spectral factors of the tool's acceleration and of its high-passed version, with the
        granted delay in the latter.
    noise : float
        Power of the sensors' noise in the unit of the grid's lines.
    """

    grid: Grid
    response: ComplexArray
    travel: ComplexArray
    tool: ComplexArray
    desired: ComplexArray
    noise: float

    def causal_error(self) -> float:
        """Return the least error of a causal filter, %."""
        return self.best(np.zeros(self.travel.shape)).error

    def limited_error(self, acceleration: FloatArray, longest: float, peak_force: float) -> float:
        """Return the least error, %, with costs that limit travel and force for an input.

        Parameters
        ----------
        acceleration : ndarray, shape (samples,) or (samples, n)
            Tool's acceleration, m/s^2.
        longest : float
            Maximum travel, m.
        peak_force : float
            Maximum force, N.
        """
        moved = faded_in(acceleration, self.grid.rate).reshape(len(acceleration), -1)

        @cache
        def best(of_travel: float, of_force: float = 0.0) -> Optimum:
            return self.best(of_travel * np.abs(self.travel) ** 2 + of_force)

        def keeps_travel(of_travel: float) -> bool:
            return self.peak(best(of_travel).force * self.travel, moved) <= longest

        def keeps_force(of_force: float) -> bool:
            return self.peak(best(of_travel, of_force).force, moved) <= peak_force

        of_travel = least_cost(TRAVEL_COSTS, keeps_travel)
        of_force = least_cost(FORCE_COSTS, keeps_force)
        return best(of_travel, of_force).error

    def best(self, cost: FloatArray) -> Optimum:
        """Return the filter of least error for costs of each coil's power, shape (n, 1, lines)."""
        response, target = self.response, self.desired
        gram = _product(_adjoint(response), response)
        for coil in range(len(gram)):
            gram[coil, coil] += cost[coil, 0]
        inverse = _inverse(_right_factor(self.grid, gram))
        aimed = _product(_adjoint(inverse), _product(_adjoint(response), target))
        driven = _product(inverse, _causal(self.grid, aimed))
        missed = float(np.sum(np.abs(_product(response, driven) - target) ** 2))
        share = (missed + self.noise) / float(np.sum(np.abs(target) ** 2))
        return Optimum(_product(driven, _inverse(self.tool)), 100.0 * math.sqrt(share))

    def peak(self, response: ComplexArray, acceleration: FloatArray) -> float:
        """Return the largest magnitude of causal responses to an acceleration (samples, n)."""
        from scipy import signal

        points, samples = self.grid.points, len(acceleration)
        pulses = np.array([[self.grid.sequence(each) for each in row] for row in response])
        moved = signal.oaconvolve(acceleration.T[np.newaxis], pulses[..., :points], axes=-1)
        return float(np.abs(moved[..., :samples].sum(axis=1)).max())


def _problem(
    plant: Dynamics | MatrixPlant,
    grid: Grid,
    tool: ComplexArray,
    granted_delay: int,
    noise: float,
    high_pass_frequency: float,
) -> Tracking:
    frequency, rate = grid.frequency, grid.rate
    Goal(granted_delay, high_pass_frequency=high_pass_frequency).check(rate)
    passed = minimum_phase(grid, np.abs(high_pass_response(high_pass_frequency, frequency, rate)))
    axes: Sequence[Dynamics] = plant.axes if isinstance(plant, MatrixPlant) else [plant]
    response = np.array([each.response(frequency, rate) for each in axes])
    if isinstance(plant, MatrixPlant):
        coupling = np.array([[grid.spectrum(each) for each in row] for row in plant.coupling])
        response = coupling * response
    travels = np.array([travel_response(each.handle, frequency) for each in axes])
    return Tracking(
        grid,
        response.reshape(len(axes), len(axes), -1),
        travels[:, np.newaxis],
        tool,
        grid.delay(granted_delay) * passed * tool,
        len(axes) * 2.0 * noise**2 / rate * len(frequency),
    )


def minimum_phase(grid: Grid, magnitude: FloatArray) -> ComplexArray:
    """Return the minimum-phase response with a specified magnitude, computed from its cepstrum."""
    cepstrum = grid.sequence(np.log(magnitude))[: grid.points]
    cepstrum[1:] *= 2.0
    return np.asarray(np.exp(grid.spectrum(cepstrum)))


def _tool_factor(acceleration: FloatArray, rate: float) -> tuple[Grid, ComplexArray]:
    """Return a grid, and the spectral factor Q of an acceleration, whose spectrum is Q Q^H."""
    from scipy import signal

    grid = grid_for(rate, step=STEP)
    if acceleration.ndim == 1:
        power = measured_spectrum(acceleration, rate)(grid.frequency)
        return grid, minimum_phase(grid, np.sqrt(power))[np.newaxis, np.newaxis]
    segment = min(len(acceleration), round(SEGMENT_SECONDS * grid.rate))
    x, y = acceleration.T[:, np.newaxis], acceleration.T[np.newaxis, :]
    lines, cross = signal.csd(y, x, grid.rate, nperseg=segment)
    # The power is at least the noise of the tool's accelerometer. There is no line at 0 Hz, as the
    # mean was removed.
    powers, vectors = np.linalg.eigh(np.moveaxis(cross[..., 1:], -1, 0))
    powers = np.maximum(powers, SENSOR_DENSITY**2)
    cross = np.moveaxis((vectors * powers[:, np.newaxis]) @ vectors.conj().swapaxes(1, 2), 0, -1)
    spectrum: ComplexArray = np.array(
        [[np.interp(grid.frequency, lines[1:], each) for each in row] for row in cross]
    )
    # Q Q^H = S where Q^T is the right factor of S^T.
    return grid, _right_factor(grid, spectrum.swapaxes(0, 1)).swapaxes(0, 1)


def _right_factor(grid: Grid, spectrum: ComplexArray) -> ComplexArray:
    """Return the causal F with a causal inverse for which F^H F equals a spectrum.

    A diagonal factor with the spectrum's powers is the first approximation (by the cepstrum);
    Wilson's iteration finds the rest (SIAM J. Appl. Math. 23, 1972).
    """
    count = len(spectrum)
    own = np.array([minimum_phase(grid, np.sqrt(spectrum[j, j].real)) for j in range(count)])
    if count == 1:
        return own[np.newaxis]
    rest = spectrum / (own.conj()[:, np.newaxis] * own)
    unity = np.eye(count)[:, :, np.newaxis]
    factor = np.zeros_like(rest) + unity
    for _ in range(MOST_ITERATIONS):
        inverse = _inverse(factor)
        change = _product(_adjoint(inverse), _product(rest, inverse)) - unity
        factor = _product(unity + _causal(grid, change, first=0.5), factor)
        if float(np.abs(change).max()) < CONVERGED:
            break
    return np.asarray(factor * own)


def _causal(grid: Grid, spectrum: ComplexArray, first: float = 1.0) -> ComplexArray:
    """Return the causal part of a spectrum, with a factor for the value at time zero."""

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

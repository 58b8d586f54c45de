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

"""Smallest errors of causal linear filters on a known plant, with and without limits."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass_response
from haptic_accel.core.control.inversion.design import Goal, nearest
from haptic_accel.core.control.inversion.spectrum import PRIOR, ToolSpectrum, measured_spectrum
from haptic_accel.core.handle.plant import Dynamics
from haptic_accel.core.handle.response import Grid, grid_for, travel_response
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.tick import CUSHION_END

STEP = 0.05
"""Frequency resolution of the bounds, Hz: a memory of ten seconds."""

FADING_IN = 0.5
"""Time in which the input of a limited bound is faded in, s."""

TRAVEL_COSTS = [10.0**power for power in range(13)]
"""Costs of travel, s^-4, from less than all felt motion to no travel. Without this cost, the
filter for a non-invertible plant integrates twice, for which no memory is long enough."""

FORCE_COSTS = [10.0**power for power in range(-6, 9)]
"""Costs of force, (m/s^2 per N)^2: from less than the smallest response of a plant to no force."""

_HALVINGS = 5  # bisections of the log distance of two costs: to 7 %


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
    than the available travel, see `limited_bound`.

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
    problem = _problem(plant, rate, spectrum, granted_delay, noise, high_pass_frequency)
    return problem.best().error


def limited_bound(
    plant: Dynamics,
    rate: float,
    acceleration: FloatArray,
    *,
    granted_delay: int = 1,
    noise: float = 0.0,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
    actuator: ActuatorParameters | None = None,
    travel_limit: float | None = None,
) -> float:
    """Return the smallest error of causal linear filters with limited travel and force.

    These Wiener filters minimise error^2 + c travel^2 + e force^2 for the input's own spectrum.
    The costs c and e are constant, the memory is unlimited, and plant and spectrum are fully
    known. The costs c and e are the smallest for which the maximum travel and force for this input
    stay within their limits. The result thus bounds time-invariant filters with constant weights.
    A filter that reduces travel only when needed, such as excursion control, can have a smaller
    error if an input is large only briefly. Friction, heat and the travel due to gravity are
    neglected.

    Parameters
    ----------
    plant, rate, granted_delay, noise, high_pass_frequency
        As in `causal_bound`; for small inputs both results are equal.
    acceleration : ndarray, shape (n,)
        Tool's acceleration, m/s^2. It is faded in over `FADING_IN`, as a section of a longer
        signal would otherwise start with a jump that needs travel.
    actuator : ActuatorParameters, optional
        Actuator with the limits; default: Table I.
    travel_limit : float, optional
        Maximum travel, m; default: where the cushion stops the actuator.

    Returns
    -------
    float
        Percent, as `Evaluation.nrmse_percent`; never below `causal_bound`.

    Raises
    ------
    ParameterError
        A parameter is out of range.
    """
    problem = _problem(
        *(plant, rate, measured_spectrum(acceleration, rate), granted_delay, noise),
        high_pass_frequency,
    )
    actuator = actuator or ActuatorParameters()
    longest = CUSHION_END * actuator.travel if travel_limit is None else travel_limit
    travel = travel_response(plant.handle, problem.grid.frequency)
    return problem.limited(travel, faded_in(acceleration, rate), longest, actuator.peak_force)


class Bounds(NamedTuple):
    """`causal_bound` of an input's spectrum and `limited_bound` of the input, percent."""

    causal: float
    limited: float


def bounds(
    plant: Dynamics,
    rate: float,
    acceleration: FloatArray,
    *,
    granted_delay: int,
    noise: float,
    high_pass_frequency: float,
    actuator: ActuatorParameters,
) -> Bounds:
    """Return both bounds of an input; parameters and errors as for `limited_bound`."""
    causal = causal_bound(
        plant,
        rate,
        measured_spectrum(acceleration, rate),
        granted_delay=granted_delay,
        noise=noise,
        high_pass_frequency=high_pass_frequency,
    )
    limited = limited_bound(
        plant,
        rate,
        acceleration,
        granted_delay=granted_delay,
        noise=noise,
        high_pass_frequency=high_pass_frequency,
        actuator=actuator,
    )
    return Bounds(causal, limited)


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
    """Return the moving part of an acceleration, shape (n,) or (n, 3), without an initial jump."""
    fading = np.minimum(np.arange(len(acceleration)) / (FADING_IN * rate), 1.0)
    return np.asarray(((acceleration - acceleration.mean(axis=0)).T * fading).T)


class Optimum(NamedTuple):
    """Best filter: response from tool acceleration to the forces, and its error, %."""

    force: ComplexArray
    error: float


@dataclass(frozen=True)
class Tracking(ABC):
    """Tracking of spectra by a plant, on a grid of frequencies.

    Attributes
    ----------
    grid : Grid
    response : ndarray, shape (..., n)
        Response of the plant: (n,) for one axis, (3, 3, n) for three.
    tool, desired : ndarray, shape (..., n)
        Spectral factors of the tool's acceleration and of its high-passed version.
    delay : ndarray, shape (n,)
        Response of the granted delay.
    noise : float
        Power of the sensor's noise in the unit of the grid's lines.
    """

    grid: Grid
    response: ComplexArray
    tool: ComplexArray
    desired: ComplexArray
    delay: ComplexArray
    noise: float

    @abstractmethod
    def best(self, cost: Any) -> Optimum:
        """Return the filter of least error for a cost of the forces' power, by frequency."""

    @abstractmethod
    def peak(self, response: ComplexArray, acceleration: FloatArray) -> float:
        """Return the largest magnitude of causal responses to a tool's acceleration."""

    def limited(
        self, travel: ComplexArray, acceleration: FloatArray, longest: float, peak_force: float
    ) -> float:
        """Return the least error, %, with costs for which an input keeps travel and force.

        Parameters
        ----------
        travel : ndarray
            Travel over force, m per N, to be multiplied by a filter's response.
        acceleration : ndarray, shape (n,) or (n, 3)
            Tool's acceleration, m/s^2.
        longest : float
            Maximum travel, m.
        peak_force : float
            Maximum force, N.
        """

        @cache
        def best(of_travel: float, of_force: float = 0.0) -> Optimum:
            return self.best(of_travel * np.abs(travel) ** 2 + of_force)

        def keeps_travel(of_travel: float) -> bool:
            return self.peak(best(of_travel).force * travel, acceleration) <= longest

        def keeps_force(of_force: float) -> bool:
            return self.peak(best(of_travel, of_force).force, acceleration) <= peak_force

        of_travel = least_cost(TRAVEL_COSTS, keeps_travel)
        of_force = least_cost(FORCE_COSTS, keeps_force)
        return best(of_travel, of_force).error


class _Problem(Tracking):
    """Tracking along one axis."""

    def best(self, cost: FloatArray | float = 0.0) -> Optimum:
        """Return the filter of least error for a frequency-dependent cost of the force's power."""
        desired = self.desired
        factor = minimum_phase(self.grid, np.sqrt(np.abs(self.response) ** 2 + cost))
        target = self.grid.sequence(self.delay * desired * (self.response / factor).conj())
        target[self.grid.points :] = 0.0  # times before zero
        driven = self.grid.spectrum(target) / factor
        missed = float(np.sum(np.abs(self.response * driven - self.delay * desired) ** 2))
        share = (missed + self.noise) / float(np.sum(np.abs(desired) ** 2))
        return Optimum(driven / self.tool, 100.0 * math.sqrt(share))

    def peak(self, response: ComplexArray, acceleration: FloatArray) -> float:
        """Return the maximum magnitude of a causal response to a tool's acceleration."""
        from scipy import signal

        pulse = self.grid.sequence(response)[: self.grid.points]
        return float(np.abs(signal.oaconvolve(acceleration, pulse)[: len(acceleration)]).max())


def _problem(
    plant: Dynamics,
    rate: float,
    spectrum: ToolSpectrum,
    granted_delay: int,
    noise: float,
    high_pass_frequency: float,
) -> _Problem:
    Goal(granted_delay, high_pass_frequency=high_pass_frequency).check(rate)
    grid = grid_for(rate, step=STEP)
    frequency = grid.frequency
    tool = np.sqrt(spectrum(frequency))
    passed = np.abs(high_pass_response(high_pass_frequency, frequency, rate))
    return _Problem(
        grid,
        plant.response(frequency, rate),
        minimum_phase(grid, tool),
        minimum_phase(grid, tool * passed),
        grid.delay(granted_delay),
        2.0 * noise**2 / rate * len(frequency),
    )


def minimum_phase(grid: Grid, magnitude: FloatArray) -> ComplexArray:
    """Return the minimum-phase response with a given magnitude, by its cepstrum."""
    cepstrum = grid.sequence(np.log(magnitude))[: grid.points]
    cepstrum[1:] *= 2.0
    return np.asarray(np.exp(grid.spectrum(cepstrum)))

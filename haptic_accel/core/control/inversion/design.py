# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Least-squares design of the inverse, and of its parts that are linear in the user's grip."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptic_accel.core.control import filters
from haptic_accel.core.control.inversion.spectrum import PRIOR, ToolSpectrum
from haptic_accel.core.handle.plant import Dynamics, Plant
from haptic_accel.core.handle.response import grid_for, inverse_terms, travel_response
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import HIGHEST_LATENCY

# scipy.signal and scipy.linalg are slow to import: only the design of a filter needs them.

EXTENDED_CORNER = 1.0
"""Corner of the high-pass after the extension, Hz: below all perceptible vibration, above drift
and tilt."""

CONVOLUTION_LENGTH = 0.2
"""Length of the convolution, s; twice this length reduces the error by less than 2 %."""

TRAVEL_CORNERS = (1.3, 2.3, 4.0, 7.5, 14.0, 24.0)
"""Travel corners for which inverses are designed, Hz. The first removes only the slow motion of
the hand, whose travel would be missing at contact; the last leaves hardly any travel."""

LANDING_VELOCITY = 0.05
"""Change of the tool's velocity at contact with a surface, m/s: a hand moves 15 mm in 0.6 s."""

FORCE_COST = 0.1
"""Error with the same cost as a newton of force, m/s^2 per N: about a hundredth of the
acceleration due to a newton."""

UNEXPECTED_DENSITY = 0.03
"""White tool acceleration in the cost of force only, m/s^2/sqrt(Hz). It keeps the gain of the
inverse small at frequencies with a small plant response and little expected texture."""

GRANTED_TIME = 1e-3
"""Granted delay in addition to the latency, s: a sample of the paper's loop."""

LONGEST_GRANTED_TIME = 0.1
"""Maximum granted delay in addition to the latency, s."""

MOST_TAPS = 8192
"""Maximum length of the convolution: 0.4 s at 20 kHz."""

RIDGE = 1e-10
"""Relative increase of the normal equations' diagonal, against rounding."""


def granted_samples(time: float, rate: float) -> int:
    """Return a granted delay in samples: at least one, after which a force is first visible.

    Parameters
    ----------
    time : float
        Granted delay, s.
    rate : float
        Samples per second.

    Examples
    --------
    >>> [granted_samples(1e-3, rate) for rate in (500.0, 1000.0, 4000.0)]
    [1, 1, 4]
    """
    return max(1, round(time * rate))


@dataclass(frozen=True)
class Goal:
    """Design goal of a filter.

    Attributes
    ----------
    granted_delay : int
        Permitted delay of the handle behind the tool, in samples, latency included; one in the
        paper.
    memory : float
        Length of the convolution, s.
    travel_corner : float
        Frequency at which travel costs as much as the acceleration error that it avoids, Hz. Far
        below it the filter's gain goes to zero.
    spectrum : callable
        Spectrum of the tool acceleration.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    """

    granted_delay: int = 1
    memory: float = CONVOLUTION_LENGTH
    travel_corner: float = TRAVEL_CORNERS[0]
    spectrum: ToolSpectrum = PRIOR
    high_pass_frequency: float = filters.HIGH_PASS_FREQUENCY

    def check(self, rate: float) -> None:
        """Reject values for which no filter can be designed at a rate in Hz.

        Raises
        ------
        ParameterError
            The message contains the parameter, its value and the allowed range.
        """
        filters.check_corner(rate, self.high_pass_frequency)
        longest = granted_samples(LONGEST_GRANTED_TIME, rate) + HIGHEST_LATENCY
        if not 0 <= self.granted_delay <= longest:
            raise ParameterError(
                f"granted_delay = {self.granted_delay}: must be from 0 to {longest}"
            )
        if not (math.isfinite(self.memory) and 1 <= round(self.memory * rate) <= MOST_TAPS):
            raise ParameterError(
                f"memory = {self.memory:g}: must be from {1 / rate:g} to {MOST_TAPS / rate:g} s"
                f" at {rate:g} Hz"
            )
        if not (math.isfinite(self.travel_corner) and self.travel_corner > 0):
            raise ParameterError(f"travel_corner = {self.travel_corner:g}: must be above 0 Hz")


DEFAULT_GOAL = Goal()
"""Goal for an unknown surface."""


@dataclass(frozen=True)
class InverseFilter:
    """Filter from desired acceleration to force: the extension, then a convolution.

    Attributes
    ----------
    sections : ndarray, shape (2, 6)
        Extension as second-order sections with a0 = 1.
    taps : ndarray, shape (n,)
        Impulse response of the convolution, N per m/s^2.
    rate : float
        Samples per second.
    goal : Goal
        Goal of the design, with granted delay and high-pass.
    """

    sections: FloatArray
    taps: FloatArray
    rate: float
    goal: Goal

    def response(self, frequency: npt.ArrayLike) -> ComplexArray:
        """Return force over desired acceleration at frequencies in Hz, N per m/s^2."""
        frequency = np.asarray(frequency, dtype=np.float64)
        turned = np.exp(-2j * np.pi * frequency / self.rate)
        convolved = np.polynomial.polynomial.polyval(turned, self.taps)
        recursive = filters.section_response(self.sections, frequency, self.rate)
        return np.asarray(recursive * convolved)


@dataclass(frozen=True)
class InverseBank:
    """Inverses with different amounts of travel and a common extension.

    Attributes
    ----------
    sections : ndarray, shape (2, 6)
        The extension.
    taps : ndarray, shape (k, n)
        Impulse response of the convolution for each of `TRAVEL_CORNERS`, N per m/s^2.
    motion : ndarray, shape (k, n)
        Acceleration of the handle after a unit sample at their input, m/s^2. With any grip the
        handle approximately follows the filter's goal, so no better model is needed.
    """

    sections: FloatArray
    taps: FloatArray
    motion: FloatArray


def extension(high_pass_frequency: float, rate: float) -> FloatArray:
    """Return sections that move the compensator's high-pass corner to `EXTENDED_CORNER`.

    At low frequencies the handle's response and the high-pass both fall with the fourth power of
    frequency. After the high-pass, a tracking controller thus needs four integrations. The
    extension integrates down to its corner. Its zeros are the poles of the high-pass, its poles
    the poles of the lower high-pass. The zeros of both at 0 Hz cancel.

    Returns
    -------
    ndarray, shape (2, 6)
        The gain is one at half the rate.
    """
    sections = filters.high_pass(high_pass_frequency, rate)
    lower = filters.high_pass(min(EXTENDED_CORNER, high_pass_frequency), rate)
    extended = np.empty_like(sections)
    extended[:, :3], extended[:, 3:] = sections[:, 3:], lower[:, 3:]
    gain, lower_gain = np.prod(sections[:, 0]), np.prod(lower[:, 0])
    extended[:, :3] *= float(lower_gain / gain) ** (2 / filters.HIGH_PASS_ORDER)
    return extended


def design_inverse(plant: Dynamics, rate: float, goal: Goal = DEFAULT_GOAL) -> InverseFilter:
    """Design the causal filter for which the handle moves as desired.

    With the tool's spectrum S, the high-pass B, the plant P, the travel D per force, and the
    filter C, the integral over frequency of ::

        S |P C B - z^-granted_delay B|^2 + c S |C B D|^2 + FORCE_COST^2 (S + U) |C B|^2

    is minimised. The terms are the power of the error, and the costs of travel and of force. The
    latter includes an unexpected input; U is the square of `UNEXPECTED_DENSITY`.
    The cost of travel, c, is the fourth power of 2 pi times the travel corner.

    This is a Wiener filter; for a convolution C its normal equations have a Toeplitz matrix. C
    follows the fixed `extension`. Without the extension, C would be seconds long to cancel the
    four zeros of P at 0 Hz. B has the same zeros, so that they cancel in the product, den_H(s) /
    (m_a B_4(s)) for eq. (3) alone.

    Parameters
    ----------
    plant : Plant or IdentifiedPlant
    rate : float
        Samples per second, above twice the high-pass corner.
    goal : Goal

    Returns
    -------
    InverseFilter

    Raises
    ------
    ParameterError
        A parameter is out of range, or the plant does not allow the rate.
    """
    ((taps,),) = _Problem(plant, rate, goal).solutions((goal.travel_corner,))
    return InverseFilter(extension(goal.high_pass_frequency, rate), taps, rate, goal)


def design_bank(plant: Plant, rate: float, goal: Goal = DEFAULT_GOAL) -> InverseBank:
    """Design the inverse for all `TRAVEL_CORNERS`.

    Parameters, errors
        As for `design_inverse`; the goal's own corner is not used.

    Returns
    -------
    InverseBank
    """
    taps = _Problem(plant, rate, goal).solutions(TRAVEL_CORNERS)[:, 0]
    sections = extension(goal.high_pass_frequency, rate)
    return InverseBank(sections, taps, tap_responses(plant, rate, taps))


def expected_input(rate: float, goal: Goal, lags: int) -> FloatArray:
    """Return the autocorrelations of the convolution's input for the expected tool.

    Parameters
    ----------
    rate : float
        Samples per second.
    goal : Goal
        Spectrum of the tool, and high-pass.
    lags : int
        Number of lags, from zero on.

    Returns
    -------
    ndarray, shape (2, lags)
        For the tool's spectrum, and for the unexpected input in the cost of force.
    """
    grid = grid_for(rate, lags)
    return np.stack([grid.sequence(each)[:lags] for each in _inputs(grid.frequency, rate, goal)])


def _inputs(frequency: FloatArray, rate: float, goal: Goal) -> tuple[FloatArray, FloatArray]:
    """Return the spectra of the convolution's input, expected and unexpected, (m/s^2)^2/Hz."""
    squared = np.abs(extended_response(goal.high_pass_frequency, frequency, rate)) ** 2
    return goal.spectrum(frequency) * squared, UNEXPECTED_DENSITY**2 * squared


def tap_responses(plant: Plant, rate: float, taps: FloatArray) -> FloatArray:
    """Return the handle's acceleration after a unit sample at the input of taps.

    Parameters
    ----------
    plant : Plant
    rate : float
        Samples per second.
    taps : ndarray, shape (k, n)

    Returns
    -------
    ndarray, shape (k, n)
        m/s^2; time starts when the force is due, one latency after the sample that causes it.
    """
    length = taps.shape[1]
    grid = grid_for(rate, length)
    response = plant.response(grid.frequency, rate) * grid.delay(-plant.latency)
    return np.stack([grid.sequence(response * grid.spectrum(each))[:length] for each in taps])


def design_basis(plant: Plant, rate: float, goal: Goal = DEFAULT_GOAL) -> FloatArray:
    """Design the inverse for all grips of one actuator at once.

    1/H is linear in m_h, b_u and k_u (`inverse_terms`). The least-squares solution is linear in
    its target if the weights are those of `plant`. The rest of the chain (hold, delay, mount,
    low-pass, aliases) is the ratio P/H of `plant`. The result equals that of `design_inverse` for
    this plant, and is close to it for similar plants.

    Parameters
    ----------
    plant : Plant
        Actuator, mount, delay, low-pass, and the middle of the expected grips.
    rate, goal
        As in `design_inverse`.

    Returns
    -------
    ndarray, shape (k, 4, n)
        For each of `TRAVEL_CORNERS` the taps to multiply by m_h, b_u, k_u and 1, and to add.

    Raises
    ------
    ParameterError
        A parameter is out of range.
    """
    problem = _Problem(plant, rate, goal)
    frequency = problem.grid.frequency
    model = handle_model(plant.handle).response(frequency)
    terms = inverse_terms(plant.handle, frequency) * model
    return problem.solutions(TRAVEL_CORNERS, terms)


def nearest(keeps: Callable[[float], bool], start: float, end: float, halvings: int) -> float:
    """Return the number nearest to a start that satisfies a limit, found by bisection.

    Parameters
    ----------
    keeps : callable
        True if a number satisfies the limit; assumed true at the end, false at the start.
    start, end : float
        Ends of the range; the end may be smaller than the start.
    halvings : int
        Number of bisection steps.
    """
    for _ in range(halvings):
        middle = (start + end) / 2
        if keeps(middle):
            end = middle
        else:
            start = middle
    return end


def extended_response(
    high_pass_frequency: float, frequency: FloatArray, rate: float
) -> ComplexArray:
    """Return the response of high-pass and extension, from tool to the convolution's input."""
    passed = filters.high_pass_response(high_pass_frequency, frequency, rate)
    return passed * filters.section_response(extension(high_pass_frequency, rate), frequency, rate)


class NormalEquations:
    """Spectra of the normal equations of `design_inverse` at specified frequencies.

    Parameters
    ----------
    handle : HandleParameters
        Actuator, for its travel.
    frequency : ndarray, shape (n,)
        Frequencies, Hz, above 0.
    rate : float
        Samples per second.
    goal : Goal
        Granted delay and high-pass; its spectrum is not used.
    """

    def __init__(
        self, handle: HandleParameters, frequency: FloatArray, rate: float, goal: Goal
    ) -> None:
        sections = extension(goal.high_pass_frequency, rate)
        self._moved = np.abs(travel_response(handle, frequency)) ** 2
        delay = np.exp(-2j * np.pi * goal.granted_delay / rate * frequency)
        # From the convolution's input back to the desired acceleration.
        self._target_response = delay / filters.section_response(sections, frequency, rate)

    def spectra(
        self,
        driven: FloatArray,
        unexpected: FloatArray,
        response: ComplexArray,
        target: ComplexArray | float = 1.0,
    ) -> ComplexArray:
        """Return the spectra of tracking and force, of travel, and of the right-hand side.

        Parameters
        ----------
        driven : ndarray, shape (n,)
            Spectrum of the convolution's input for the tool's acceleration, (m/s^2)^2/Hz.
        unexpected : ndarray, shape (n,)
            Spectrum of additional input in the cost of force, (m/s^2)^2/Hz.
        response : ndarray, shape (n,)
            Response of the plant, m/s^2 per N.
        target : ndarray, shape (n,)
            Handle over desired acceleration, without the granted delay.

        Returns
        -------
        ndarray, shape (3, n)
            The matrix is built from the first sequence plus the cost of travel times the second;
            the right-hand side from the third.
        """
        force = FORCE_COST**2 * (driven + unexpected)
        cross = driven * response.conj() * self._target_response * target
        return np.stack([driven * np.abs(response) ** 2 + force, driven * self._moved, cross])


def travel_cost(corner: float) -> float:
    """Return the cost of travel in terms of acceleration, s^-4, for a corner in Hz."""
    return float((2.0 * math.pi * corner) ** 4)


class _Problem:
    """The normal equations on a fine grid."""

    def __init__(self, plant: Dynamics, rate: float, goal: Goal) -> None:
        goal.check(rate)
        self._length = round(goal.memory * rate)
        self.grid = grid_for(rate, self._length)
        frequency = self.grid.frequency
        self._equations = NormalEquations(plant.handle, frequency, rate, goal)
        self._inputs = _inputs(frequency, rate, goal)
        self._response = plant.response(frequency, rate)

    def sequences(self, target: ComplexArray | float = 1.0) -> FloatArray:
        """Return the sequences of the three spectra, shape (3, n)."""
        spectra = self._equations.spectra(*self._inputs, self._response, target)
        return np.stack([self.grid.sequence(each)[: self._length] for each in spectra])

    def solutions(
        self, travel_corners: Sequence[float], targets: Iterable[ComplexArray | float] = (1.0,)
    ) -> FloatArray:
        """Return the taps for each corner and each target of handle over desired acceleration.

        Returns
        -------
        ndarray, shape (corners, targets, n)
        """
        from scipy.linalg import solve_toeplitz

        sequences = np.stack([self.sequences(target) for target in targets])
        tracking, travel = sequences[0, :2]
        found = []
        for corner in travel_corners:
            column = tracking + travel_cost(corner) * travel
            column[0] *= 1.0 + RIDGE
            found.append(solve_toeplitz(column, sequences[:, 2].T).T)
        return np.ascontiguousarray(found, dtype=np.float64)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exact inverse of an identified handle as one causal filter: tool spectrum, design, prediction.

`design_inverse` designs the filter by least squares, from parts that are linear in the user's
grip; a filter per grip is designed in the controller `adaptive`, by `improved`. `predict` returns
error, force and travel. The smallest error of any causal filter is in `error_bound`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptic_accel.core.control import filters
from haptic_accel.core.control.filters import high_pass_response, section_response
from haptic_accel.core.handle.mechanics import grid_for, inverse_terms, travel_response
from haptic_accel.core.handle.plant import Dynamics, Plant
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.sampling import HIGHEST_LATENCY

# scipy.signal and scipy.linalg are slow to import: only the design of a filter and the measurement
# of a spectrum need them.

ToolSpectrum = Callable[[FloatArray], FloatArray]
"""One-sided power spectral density of tool acceleration, (m/s^2)^2/Hz, at frequencies in Hz."""

TEXTURE_DENSITY = 0.15
"""Density in the middle of the texture, m/s^2/sqrt(Hz): 1.4 m/s^2 RMS in total, as for rough
wood."""

HAND_DENSITY = 0.02
"""Density of slow motion of hand and arm below the texture, m/s^2/sqrt(Hz)."""

SENSOR_DENSITY = 0.0025
"""Noise density of the tool's accelerometer, m/s^2/sqrt(Hz) (ADXL320 data sheet: 250
ug/sqrt(Hz))."""

SEGMENT_SECONDS = 0.5
"""Length of the segments of a measured spectrum, s: lines 2 Hz apart."""


@dataclass(frozen=True)
class TexturePrior(Checked):
    """Spectrum of an unknown surface: broadband texture, slow motion and noise.

    Its power rises with the fourth power of frequency and falls with the sixth. A narrower prior
    gives smaller errors on textures within it, and larger errors elsewhere.
    """

    # Assumed, as the surface is not known.
    rise: float = parameter(
        20.0, "lower corner of the expected texture spectrum", "Hz", 1.0, 1000.0
    )
    # Waves shorter than 0.5 mm: 200 Hz at 0.1 m/s.
    fall: float = parameter(
        200.0, "upper corner of the expected texture spectrum", "Hz", 10.0, 10e3
    )

    def __call__(self, frequency: FloatArray) -> FloatArray:
        """Return the one-sided density, (m/s^2)^2/Hz, at frequencies in Hz, shape (n,)."""
        squared = (frequency / self.rise) ** 2
        texture = TEXTURE_DENSITY**2 * (squared / (1.0 + squared)) ** 2
        falling = (1.0 + (frequency / self.fall) ** 2) ** 3
        return np.asarray((texture + HAND_DENSITY**2) / falling + SENSOR_DENSITY**2)


PRIOR = TexturePrior()
"""Spectrum of an unknown surface."""


def measured_spectrum(acceleration: FloatArray, rate: float) -> ToolSpectrum:
    """Return the spectrum of a recorded tool acceleration by Welch's method.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        Recorded tool acceleration, m/s^2; at least two samples.
    rate : float
        Samples per second.

    Returns
    -------
    callable
        Linear between the lines, and at least the noise of the tool's accelerometer.
    """
    from scipy import signal

    segment = min(len(acceleration), round(SEGMENT_SECONDS * rate))
    lines, power = signal.welch(acceleration, rate, nperseg=segment)
    floor = SENSOR_DENSITY**2

    def spectrum(frequency: FloatArray) -> FloatArray:
        # The mean was removed, so the line at 0 Hz is meaningless.
        return np.maximum(np.interp(frequency, lines[1:], power[1:]), floor)

    return spectrum


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

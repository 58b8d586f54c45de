# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Online estimation of the user's grip from force and acceleration of the handle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.response_estimation import Evaluation, latest
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick import FORCE, MEASURED, Trace

GRIP = {"m_h": "kg", "b_u": "N s/m", "k_u": "N/m"}
"""Parameters of the grip and their units, in the order of all arrays."""

HOP = 0.016
"""Time between evaluations, s: enough for several independent values of a texture."""

LENGTH = 0.192
"""Length of the filters' impulse responses, s; they have decayed by then."""

AHEAD = 0.012
"""Length of the filter's non-causal part, s. It delays the estimate, and is needed for the upper
band edge."""

THINNED_RATE = 1000.0
"""Maximum rate for evaluating the equation, Hz; faster signals are decimated."""

LOWEST, HIGHEST = 15.0, 250.0
"""Frequency band of the estimate, Hz: above the hand's own motion, below the mount's mode."""

STEEPNESS = 4
"""Order of the lower band edge: two for the integrations, two for the hand's own motion."""

SMALLEST = (0.35, 0.1, 0.05)
LARGEST_FACTORS = (3.5, 8.0, 9.0)
"""Upper bounds of the estimate as factors of the assumed m_h, b_u and k_u; wider than hands
vary."""

INSIDE = 0.95
"""Fraction of a bound below which a parameter no longer counts as at the bound."""

PERSISTENT = 20
"""Number of successive evaluations at a bound after which it is reported."""

LEAST_FORCE = 0.02
"""Minimum root mean square of the actuator's force within the band for an update, N."""

PULL = 16.0
"""Ratio of excitation to noise at which the equation and the assumed grip have equal weight. A
spectral line determines two of three parameters, and the third would be determined by noise alone.
With half this ratio, weak lines change the grip; with four times this ratio, hands that differ
much from the assumed one are not found."""

ARM = 40.0
"""Frequency below which the motion with the arm exceeds the sensor's noise, Hz; its level is
inversely proportional to frequency."""

SURPRISE = 3.0
"""Ratio above which the past is discarded: squared error of the latest hop with the present grip
over the smallest error with any grip. Three parameters fitted to some ten independent values
reduce the smallest error by a third, and a ratio of a few can occur by chance."""

NEGLIGIBLE = 3e-4
"""Squared error, relative to the squared force, that always counts as noise: 2 % of the force."""

FEWEST = 6
"""Minimum number of evaluations before the first change of the grip; they cover the onset of the
first contact."""

NOTICEABLE = 0.01
"""Minimum relative change of a parameter for a change of the grip, as new taps take computing
time."""


Factors = list[float]
"""m_h, b_u and k_u relative to the assumed values."""


@dataclass(frozen=True)
class AdaptationParameters(Checked):
    """Parameters of the grip estimator."""

    memory: float = parameter(
        0.4, "time constant of the forgetting, while the handle is excited", "s", 0.05, 100.0
    )


class GripEstimator(Evaluation):
    """Recursive least squares for m_h, b_u and k_u, hop by hop.

    Eq. (2) of the paper is linear in them. Eq. (1) describes the actuator with known mass, spring
    and bearing. The path between command and sample (hold, delay, mount, low-pass) is the ratio
    P/H of the assumed plant: m_a s^2/A F' - m_a (b_s s + k_s)/A A_h = (m_h + b_u/s + k_u/s^2) A_h,
    A = m_a s^2 + b_s s + k_s, F' = (P/H) F. All terms pass the same band-pass, in which
    integrations are harmless, and are compared at its output.

    Each hop is weighted by the inverse of its smallest error with any grip. A hop in which a
    loaded grip suddenly changes fits no grip, and thus has little weight. If the error with the
    present grip is much larger than the smallest, the hand has changed, and the past is discarded.
    Where noise of this size could explain the estimate as well, the estimate is pulled towards the
    assumed grip.

    `update` returns True when the grip has changed.

    Parameters
    ----------
    trace : Trace
        Force, and acceleration measured at the same tick.
    plant : Plant
        Assumed plant; the estimate starts with its grip.
    rate : float
        Samples per second.
    parameters : AdaptationParameters

    Attributes
    ----------
    grip : ndarray, shape (3,)
        Estimated m_h, b_u and k_u: kg, N s/m, N/m.
    estimates : int
        Number of evaluations of an excited handle.
    """

    def __init__(
        self, trace: Trace, plant: Plant, rate: float, parameters: AdaptationParameters
    ) -> None:
        handle = plant.handle
        self._assumed = np.array([getattr(handle, name) for name in GRIP])
        thinning = max(1, math.floor(rate / THINNED_RATE))
        rows = max(8, round(HOP * rate / thinning))
        kernels = _kernels(plant, rate)
        kernels[:3] *= self._assumed[:, np.newaxis]
        filters = np.stack([_sliding(kernel, rows, thinning) for kernel in kernels])
        super().__init__(trace, filters.shape[-1], rows * thinning)
        self._of_acceleration = filters[:4].reshape(-1, self._length)
        self._of_force = filters[4]
        # Moments of the noise in each term, and in the deviations from the assumed grip.
        lines = np.fft.rfftfreq(kernels.shape[1], 1.0 / rate)[1:]
        noise = np.fft.rfft(kernels[:4])[:, 1:] * np.hypot(1.0, ARM / lines)
        deviating = np.vstack([noise[:3], noise[:3].sum(axis=0)])
        self._noise, self._deviating = ((each @ each.conj().T).real for each in (noise, deviating))
        self._kept = math.exp(-self._hop / rate / parameters.memory)
        self._least_energy = rows * LEAST_FORCE**2
        self.reset()

    @property
    def at_end(self) -> dict[str, str]:
        """Parameters that remain at a bound of their range, each with "upper" or "lower"."""
        return {
            name: "upper" if count > 0 else "lower"
            for name, count in zip(GRIP, self._beyond, strict=True)
            if abs(count) >= PERSISTENT
        }

    def reset(self) -> None:
        """Return to the assumed grip."""
        self.grip = self._assumed.copy()
        self._present: Factors = [1.0, 1.0, 1.0]
        self._moments = np.zeros((4, 4))
        self._energy = 0.0
        self._beyond = [0, 0, 0]  # evaluations in a row at the upper bound; negative: lower
        self.estimates = 0
        self.restart()

    def _look(self, late: int) -> Iterator[bool | None]:
        # Newest sample first, as in the filters.
        force, motion = (
            latest(self.trace, each, self._length)[::-1].copy() for each in (FORCE, MEASURED)
        )
        driving = self._of_force @ force
        terms = (self._of_acceleration @ motion).reshape(4, -1)
        yield None
        energy = float(driving.dot(driving))
        if energy > self._least_energy:
            terms[3] += driving
            yield self._learn(terms @ terms.T, energy)

    def _learn(self, moments: FloatArray, energy: float) -> bool:
        """Add the second moments and energy of a hop; return True if the grip changed.

        The terms are those of m_h, b_u and k_u at their assumed values, and the measured sum.
        """
        self.estimates += 1
        self._energy = self._kept * self._energy + (1.0 - self._kept) * energy
        error = _error(moments, self._present)
        pull = self._deviating / _error(self._noise, self._present)
        negligible = NEGLIGIBLE * max(energy, self._energy)
        noise = _error(moments, _solution(moments + negligible * pull)) + negligible
        trust = min(1.0, SURPRISE * noise / error) if error > 0.0 else 1.0
        self._moments = self._kept * trust**2 * self._moments + moments / noise + PULL * pull
        found = self._within_bounds(_solution(self._moments))
        moved = max(abs(1.0 - old / new) for old, new in zip(self._present, found, strict=True))
        if self.estimates < FEWEST or moved < NOTICEABLE:
            return False
        self._present = found
        self.grip = self._assumed * found
        return True

    def _within_bounds(self, factors: Factors) -> Factors:
        """Return the nearest factors within bounds, and count evaluations beyond each bound."""
        found = []
        limits = zip(factors, SMALLEST, LARGEST_FACTORS, strict=True)
        for index, (factor, low, high) in enumerate(limits):
            count = self._beyond[index]
            if factor >= (INSIDE * high if count >= PERSISTENT else high):
                self._beyond[index] = max(0, count) + 1
            elif factor <= (low / INSIDE if count <= -PERSISTENT else low):
                self._beyond[index] = min(0, count) - 1
            else:
                self._beyond[index] = 0
            found.append(min(max(factor, low), high))
        return found


def _error(moments: FloatArray, factors: Factors) -> float:
    """Return the squared error of the equation, N^2."""
    weights = np.array([*factors, -1.0])
    return max(0.0, float(weights.dot(moments.dot(weights))))


def _solution(moments: FloatArray) -> Factors:
    """Return the factors with the smallest error."""
    (a, b, c, x), (_, d, e, y), (_, _, f, z), _ = moments.tolist()
    # Cramer's rule takes a tenth of the time of numpy.linalg for three unknowns.
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    rows = ((aa, ab, ac), (ab, bb, bc), (ac, bc, cc))
    determinant = a * aa + b * ab + c * ac
    return [(p * x + q * y + r * z) / determinant for p, q, r in rows]


def _sliding(kernel: FloatArray, rows: int, step: int) -> FloatArray:
    """Return a filter matrix for a window: each row is the kernel, shifted by one more step."""
    length = len(kernel)
    filters = np.zeros((rows, length + (rows - 1) * step))
    for row in range(rows):
        filters[row, row * step : row * step + length] = kernel
    return filters


def _kernels(plant: Plant, rate: float) -> FloatArray:
    """Return the impulse responses of the regression's terms, newest sample first.

    Returns
    -------
    ndarray, shape (5, n)
        Impulse responses for m_h, b_u and k_u, for the acceleration in eq. (1), and for the force.
    """
    length, ahead = round(LENGTH * rate), max(1, round(AHEAD * rate))
    fine = 16 * length
    frequency: FloatArray = np.fft.rfftfreq(fine, 1.0 / rate)[1:].astype(np.float64)
    s = 2j * np.pi * frequency
    # The lower band edge is causal and decays within a few hops; the upper one has zero phase.
    lower = (s / (s + 2 * np.pi * LOWEST)) ** STEEPNESS
    band = lower / (1.0 + (frequency / min(HIGHEST, 0.4 * rate)) ** 8)
    handle: HandleParameters = plant.handle
    bearing = handle.b_s * s + handle.k_s
    actuator = handle.m_a * s**2 + bearing
    chain = plant.response(frequency, rate) / handle_model(handle).response(frequency)
    responses = np.zeros((5, len(frequency) + 1), dtype=np.complex128)
    responses[:, 1:] = band * np.stack(
        [
            np.ones_like(s),
            1.0 / s,
            1.0 / s**2,
            -handle.m_a * bearing / actuator,
            chain * handle.m_a * s**2 / actuator,
        ]
    )
    kernels = np.roll(np.fft.irfft(responses, fine), ahead, axis=1)[:, :length]
    # Fade out at both ends, where the response is small.
    kernels *= np.minimum(1.0, (np.arange(length) + 1) / (ahead / 2))
    kernels *= np.minimum(1.0, np.arange(length, 0, -1) / (length / 4))
    # Gravity is not part of the response.
    return np.asarray(kernels - kernels.mean(axis=1, keepdims=True))

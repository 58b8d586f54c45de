"""The inverse for every grip, within the actuator's travel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from haptic_accel.core.control.filters import high_pass_response, section_response
from haptic_accel.core.control.inversion.design import (
    DEFAULT_GOAL,
    LANDING_VELOCITY,
    Goal,
    design_basis,
    extension,
    nearest,
)
from haptic_accel.core.control.inversion.plant import Plant, grid_for
from haptic_accel.core.model import FloatArray

CAUTION = 0.5
"""Fraction of the travel that the second basis is designed for: soft grips take more travel."""

LANDING = 0.3
"""Time after a landing in which the travel is computed, s: its oscillation has decayed by then."""

LANDING_RATE = 1000.0
"""Sampling rate of that travel, Hz."""

_HALVINGS = 6


@dataclass(frozen=True)
class InverseFamily:
    """Two bases of the inverse, mixed so that a landing keeps the travel limit.

    Attributes
    ----------
    sections : ndarray, shape (2, 6)
        The extension, which no grip changes.
    free, cautious : ndarray, shape (4, n)
        Taps to multiply by m_h, b_u, k_u and 1, then to add.
    landing_free, landing_cautious : ndarray, shape (4, n)
        Travel after a landing by term of a basis, m.
    landing_handle : ndarray, shape (n,)
        The part of it that the handle's own motion causes, m.
    travel_limit : float
        Maximum travel after a landing, m.
    """

    sections: FloatArray
    free: FloatArray
    cautious: FloatArray
    landing_free: FloatArray
    landing_cautious: FloatArray
    landing_handle: FloatArray
    travel_limit: float

    def taps(self, grip: FloatArray) -> FloatArray:
        """Return the taps for a grip.

        Parameters
        ----------
        grip : ndarray, shape (3,)
            m_h, b_u and k_u: kg, N s/m, N/m.
        """
        factors = np.append(grip, 1.0)
        caution = self._caution(factors)
        return np.asarray(factors @ ((1.0 - caution) * self.free + caution * self.cautious))

    def _caution(self, factors: FloatArray) -> float:
        """Return the smallest fraction of the cautious basis that keeps the travel limit."""
        travel = factors @ self.landing_free + self.landing_handle
        change = factors @ (self.landing_cautious - self.landing_free)

        def keeps(caution: float) -> bool:
            return float(np.abs(travel + caution * change).max()) <= self.travel_limit

        return 0.0 if keeps(0.0) else nearest(keeps, 0.0, 1.0, _HALVINGS)


def design_family(plant: Plant, rate: float, goal: Goal = DEFAULT_GOAL) -> InverseFamily:
    """Design the inverse for all grips of one actuator, such that a landing keeps the travel.

    Parameters, errors
        Those of `design_inverse`; the plant has the grip in the middle of those expected.

    Returns
    -------
    InverseFamily
    """
    free = design_basis(plant, rate, goal)
    cautious = design_basis(plant, rate, replace(goal, travel_limit=CAUTION * goal.travel_limit))
    grid = grid_for(rate, free.shape[1])
    frequency = grid.frequency
    s = 2j * np.pi * frequency
    handle = plant.handle
    actuator = handle.m_a * s**2 + handle.b_s * s + handle.k_s
    passed = high_pass_response(goal.high_pass_frequency, frequency, rate)
    sections = extension(goal.high_pass_frequency, rate)
    extended = passed * section_response(sections, frequency, rate)
    every = max(1, round(rate / LANDING_RATE))
    seen = slice(0, round(LANDING * rate), every)

    def landing(basis: FloatArray) -> FloatArray:
        spectra = (-extended / actuator * grid.spectrum(taps) for taps in basis)
        return np.stack([LANDING_VELOCITY * rate * grid.sequence(x)[seen] for x in spectra])

    # The handle does as desired, whatever the grip: that is what the filter is for. Time counts
    # from where the force is due.
    moved = -handle.m_a * passed * grid.delay(goal.granted_delay - plant.latency) / actuator
    following = LANDING_VELOCITY * rate * grid.sequence(moved)[seen]
    return InverseFamily(
        sections, free, cautious, landing(free), landing(cautious), following, goal.travel_limit
    )

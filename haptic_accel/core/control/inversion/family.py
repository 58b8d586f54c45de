"""The inverse for every grip, within the actuator's travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.control.inversion.design import (
    LANDING_VELOCITY,
    MEMORY,
    TRAVEL_LIMIT,
    InverseBasis,
    design_basis,
)
from haptic_accel.core.control.inversion.plant import (
    Plant,
    grid_for,
    high_pass_response,
    section_response,
)
from haptic_accel.core.control.inversion.spectrum import PRIOR, ToolSpectrum
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
    free, cautious : InverseBasis
    landing_free, landing_cautious : ndarray, shape (4, n)
        Travel after a landing by term of a basis, m.
    landing_handle : ndarray, shape (n,)
        The part of it that the handle's own motion causes, m.
    travel_limit : float
        Maximum travel after a landing, m.
    """

    free: InverseBasis
    cautious: InverseBasis
    landing_free: FloatArray
    landing_cautious: FloatArray
    landing_handle: FloatArray
    travel_limit: float

    @property
    def sections(self) -> FloatArray:
        """The extension, which no grip changes."""
        return self.free.sections

    def taps(self, grip: FloatArray) -> FloatArray:
        """Return the taps for a grip.

        Parameters
        ----------
        grip : ndarray, shape (3,)
            m_h, b_u and k_u: kg, N s/m, N/m.
        """
        factors = np.append(grip, 1.0)
        caution = self._caution(factors)
        return np.asarray(
            factors @ ((1.0 - caution) * self.free.terms + caution * self.cautious.terms)
        )

    def _caution(self, factors: FloatArray) -> float:
        """Return the smallest fraction of the cautious basis that keeps the travel limit."""
        travel = factors @ self.landing_free + self.landing_handle
        change = factors @ (self.landing_cautious - self.landing_free)
        low, high = 0.0, 1.0
        if float(np.abs(travel).max()) <= self.travel_limit:
            return low
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if float(np.abs(travel + middle * change).max()) <= self.travel_limit:
                high = middle
            else:
                low = middle
        return high


def design_family(
    plant: Plant,
    rate: float,
    *,
    granted_delay: int = 1,
    memory: float = MEMORY,
    travel_limit: float = TRAVEL_LIMIT,
    spectrum: ToolSpectrum = PRIOR,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
) -> InverseFamily:
    """Design the inverse for all grips of one actuator, such that a landing keeps the travel.

    Parameters, errors
        Those of `design_inverse`; the plant has the grip in the middle of those expected.

    Returns
    -------
    InverseFamily
    """
    free, cautious = (
        design_basis(
            plant,
            rate,
            granted_delay=granted_delay,
            memory=memory,
            travel_limit=limit,
            spectrum=spectrum,
            high_pass_frequency=high_pass_frequency,
        )
        for limit in (travel_limit, CAUTION * travel_limit)
    )
    grid = grid_for(rate, free.terms.shape[1])
    frequency = grid.frequency
    s = 2j * np.pi * frequency
    handle = plant.handle
    actuator = handle.m_a * s**2 + handle.b_s * s + handle.k_s
    passed = high_pass_response(high_pass_frequency, rate)(frequency)
    extended = passed * section_response(free.sections, frequency, rate)
    every = max(1, round(rate / LANDING_RATE))
    seen = slice(0, round(LANDING * rate), every)

    def landing(basis: InverseBasis) -> FloatArray:
        spectra = (-extended / actuator * grid.spectrum(taps) for taps in basis.terms)
        return np.stack([LANDING_VELOCITY * rate * grid.sequence(x)[seen] for x in spectra])

    # The handle does as desired, whatever the grip: that is what the filter is for.
    moved = -handle.m_a * passed * grid.delay(granted_delay) / actuator
    return InverseFamily(
        free,
        cautious,
        landing(free),
        landing(cautious),
        LANDING_VELOCITY * rate * grid.sequence(moved)[seen],
        travel_limit,
    )

# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plant to be inverted: from a force at one tick to the handle's acceleration at later ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from haptic_accel.core.identification.discrete import DiscreteModel, read_discrete_model
from haptic_accel.core.identification.fit import sampled_response
from haptic_accel.core.model import (
    AccelerometerParameters,
    ComplexArray,
    FloatArray,
    HandleParameters,
    MountParameters,
    handle_model,
)
from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.core.sampling import check_latency


class Dynamics(Protocol):
    """Properties of a plant that a design needs."""

    @property
    def handle(self) -> HandleParameters:
        """Parameters of the handle, as far as known: for the actuator's travel."""

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz."""


@dataclass(frozen=True)
class Plant(Checked):
    """The handle of eq. (3) with everything between a command and a sample."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    mount: MountParameters = field(default_factory=MountParameters)
    delay: float = parameter(
        0.0,
        "delay from command to force in addition to the hold: converter, amplifier, transport",
        "s",
        0.0,
        0.02,
    )
    bandwidth: float = like(AccelerometerParameters, "bandwidth")
    friction: float = parameter(0.0, "dry friction of the actuator's bearing", "N", 0.0, 1.0)
    coupling: float = parameter(
        250.0,
        "stiffness of the coupling to the slave, which adds to that of the grip (paper)",
        "N/m",
        0.0,
        1e5,
    )
    model: str = parameter(
        "",
        "JSON file of an identification, whose discrete model gives the response in place of"
        " mount, delay and bandwidth; empty for none",
    )

    doubt: str = parameter(
        "", "reason to doubt this description, of which the compensator warns; empty for none"
    )

    @property
    def latency(self) -> int:
        """Samples from the one that caused a force to the tick at which the force is due."""
        return 0

    def coupled(self) -> Plant:
        """Return the plant with the coupling as a part of the grip.

        The slave hardly moves at the frequencies that are felt, so that the coupling's spring is
        parallel to that of the grip.
        """
        handle = replace(self.handle, k_u=self.handle.k_u + self.coupling)
        return replace(self, handle=handle, coupling=0.0)

    def delayed(self, latency: int) -> DelayedPlant:
        """Return the plant of a loop whose forces are due so many samples after their cause.

        Raises
        ------
        ParameterError
            The latency is not allowed.
        """
        check_latency(latency)
        return DelayedPlant(**vars(self) | {"latency": latency})

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz.

        It begins one sample after the force. See `sampled_response`.

        Raises
        ------
        ParameterError
            The file of the model is not usable, or the model was identified at another rate.
        """
        if self.model:
            return IdentifiedPlant(_model(self.model), self.handle).response(frequency, rate)
        return sampled_response(
            self.handle, frequency, rate, self.delay, self.bandwidth, mount=self.mount
        )


@dataclass(frozen=True)
class DelayedPlant(Plant):
    """A plant in a loop whose forces are due some samples after their cause: `latency`."""

    latency: int = 0

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return the response of the plant, m/s^2 per N, one sample after the latency."""
        turns = np.asarray(frequency) * (self.latency / rate)
        return np.asarray(super().response(frequency, rate) * np.exp(-2j * np.pi * turns))


@lru_cache(maxsize=8)
def _model(path: str) -> DiscreteModel:
    return read_discrete_model(Path(path))


@dataclass(frozen=True)
class IdentifiedPlant:
    """A discrete model of the handle that was identified without its physics.

    Attributes
    ----------
    model : DiscreteModel
        Discrete model at the rate of the design.
    handle : HandleParameters
        Handle parameters, for the actuator's travel only, which the model does not contain.
    """

    model: DiscreteModel
    handle: HandleParameters = field(default_factory=HandleParameters)

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return the model's response, m/s^2 per N, at frequencies in Hz.

        Raises
        ------
        ParameterError
            The model was identified at another rate.
        """
        if rate != self.model.rate:
            raise ParameterError(
                f"rate = {rate:g}: must be that of the identified model, {self.model.rate:g} Hz"
            )
        return self.model.response(frequency)


def travel_response(handle: HandleParameters, frequency: FloatArray) -> ComplexArray:
    """Return the actuator's displacement from the handle over its force, m per N.

    From eq. (1) for the difference y = y_a - y_h:
    (m_a s^2 + b_s s + k_s) Y = -F_a - m_a A_h with A_h = H F_a.

    Parameters
    ----------
    handle : HandleParameters
    frequency : ndarray, shape (n,)
        Frequencies, Hz, above 0.
    """
    s = 2j * np.pi * frequency
    actuator = handle.m_a * s**2 + handle.b_s * s + handle.k_s
    return np.asarray(-(1.0 + handle.m_a * handle_model(handle).response(frequency)) / actuator)


def inverse_terms(handle: HandleParameters, frequency: FloatArray) -> ComplexArray:
    """Terms of 1/H, which is linear in mass, damping and stiffness of handle and grip.

    With A = m_a s^2 + b_s s + k_s and B = b_s s + k_s, eq. (3) turned over is
    1/H = A (m_h s^2 + b_u s + k_u) / (m_a s^4) + B / s^2, as A B - B^2 = m_a s^2 B.

    Parameters
    ----------
    handle : HandleParameters
        Only the actuator's m_a, b_s and k_s are used.
    frequency : ndarray, shape (n,)
        Frequencies, Hz, above 0.

    Returns
    -------
    ndarray, shape (4, n)
        Factors of m_h, b_u, k_u and 1; the sum of the products is 1/H in N per m/s^2.
    """
    s = 2j * np.pi * frequency
    bearing = handle.b_s * s + handle.k_s
    shared = (handle.m_a * s**2 + bearing) / (handle.m_a * s**2)
    return np.stack([shared, shared / s, shared / s**2, bearing / s**2])


@dataclass(frozen=True)
class Grid:
    """Frequencies between lines of a discrete Fourier transform, which leave out 0 Hz.

    Handle and high-pass have zeros at 0 Hz, so that nothing can be divided by them there.

    Attributes
    ----------
    rate : float
        Samples per second.
    points : int
        Number of frequencies, evenly spaced up to half the rate.
    """

    rate: float
    points: int

    @property
    def frequency(self) -> FloatArray:
        """Frequencies, Hz, shape (points,)."""
        return np.asarray((np.arange(self.points) + 0.5) * self.step, dtype=np.float64)

    @property
    def step(self) -> float:
        """Distance of two frequencies, Hz."""
        return self.rate / (2 * self.points)

    def delay(self, samples: float) -> ComplexArray:
        """Return the response of a delay."""
        turns = self.frequency / self.rate * samples
        return np.asarray(np.exp(-2j * np.pi * turns))

    def spectrum(self, sequence: FloatArray) -> ComplexArray:
        """Return the Fourier transform of a real sequence that starts at time zero.

        Parameters
        ----------
        sequence : ndarray, shape (n,)
            Real sequence; n at most twice `points`.
        """
        shift = np.exp(-1j * np.pi * np.arange(len(sequence)) / (2 * self.points))
        return np.asarray(np.fft.fft(sequence * shift, 2 * self.points)[: self.points])

    def sequence(self, spectrum: ComplexArray | FloatArray) -> FloatArray:
        """Return the real sequence of a Fourier transform, shape (2 points,).

        It is antiperiodic: its second half, with the sign turned, are the times before zero.
        """
        both = np.concatenate([spectrum, np.zeros(self.points)])
        shift = np.exp(1j * np.pi * np.arange(2 * self.points) / (2 * self.points))
        return np.asarray(2.0 * (np.fft.ifft(both) * shift).real)


FINEST_STEP = 0.2
"""Distance of a grid's frequencies, Hz: a fifth of the lowest corner in a filter."""


def grid_for(rate: float, taps: int = 0, step: float = FINEST_STEP) -> Grid:
    """Return a grid fine enough for a step in Hz, long enough for a filter of so many taps."""
    needed = max(rate / (2 * step), 4 * taps)
    return Grid(rate, 1 << int(np.ceil(np.log2(needed))))

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Handle model of McMahan and Kuchenbecker (IROS 2009): parameters and transfer functions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from haptic_accel.core.parameters import Checked, parameter

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

Vector = tuple[float, float, float]
"""x, y, z in the arm's base frame."""

Force = Vector | None
"""Force to apply, N; None leaves the present force unchanged."""


def vector(values: FloatArray) -> Vector:
    """Return three numbers as a vector."""
    x, y, z = values.tolist()
    return x, y, z


ZERO: Vector = (0.0, 0.0, 0.0)

Quaternion = tuple[float, float, float, float]
"""Components x, y, z, w of the rotation from rotated axes to those of the base, as in ROS."""

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
"""Rotation of axes that are parallel to those of the base."""

GRAVITY = 9.80665
"""Standard gravity, m/s^2 (ISO 80000-3)."""


ACTUATOR = "actuator"
"""Block of a node's parameters for the actuator, shared by all parts of the node."""


actuator_parameter = partial(parameter, block=ACTUATOR)
"""Declare a dataclass field as a parameter of that block."""


@dataclass(frozen=True)
class Suspension(Checked):
    """Moving mass of the actuator, spring and bearing: eq. (1), Table I of the paper."""

    m_a: float = actuator_parameter(
        0.018, "moving mass of the actuator", unit="kg", low=0, above=True
    )
    k_s: float = actuator_parameter(
        266.0, "stiffness of the actuator's centring spring", unit="N/m", low=0
    )
    b_s: float = actuator_parameter(2.0, "damping of the actuator's bearing", unit="N s/m", low=0)


@dataclass(frozen=True)
class HandleParameters(Suspension):
    """Actuator on its suspension, handle and hand: eq. (1) and (2), Table I of the paper."""

    m_h: float = parameter(0.128, "mass of handle and hand", unit="kg", low=0, above=True)
    k_u: float = parameter(1500.0, "stiffness of the user's grip", unit="N/m", low=0)
    b_u: float = parameter(11.0, "damping of the user's grip", unit="N s/m", low=0)


@dataclass(frozen=True)
class RationalModel:
    """Transfer function in s, defined by numerator and denominator polynomials.

    Attributes
    ----------
    numerator, denominator : ndarray
        Coefficients of s, highest power first.
    """

    numerator: FloatArray
    denominator: FloatArray

    def response(self, frequency: npt.ArrayLike) -> ComplexArray:
        """Return the complex response at frequencies in Hz."""
        s = 2j * np.pi * np.asarray(frequency, dtype=float)
        return np.asarray(np.polyval(self.numerator, s) / np.polyval(self.denominator, s))


def handle_model(handle: HandleParameters) -> RationalModel:
    """Return handle acceleration over actuator force, H(s) = A_h/F_a, eq. (3) of the paper.

    Returns
    -------
    RationalModel
        In m/s^2 per N; four zeros at the origin, 1/m_h at high frequency.
    """
    denominator = grip_denominator(handle, handle.m_h, handle.b_u, handle.k_u)
    return RationalModel(np.array([handle.m_a, 0.0, 0.0, 0.0, 0.0]), denominator)


def grip_denominator(handle: HandleParameters, m_h: float, b_u: float, k_u: float) -> FloatArray:
    """Return the denominator of `handle_model` for another grip."""
    actuator = np.array([handle.m_a, handle.b_s, handle.k_s])
    grip = np.array([m_h, handle.b_s + b_u, handle.k_s + k_u])
    bearing = np.array([handle.b_s, handle.k_s])
    # numpy.polymul and polysub take ten times longer, and a controller needs the result at once.
    denominator: FloatArray = np.convolve(actuator, grip)
    denominator[2:] -= np.convolve(bearing, bearing)
    return denominator


def _frequency(default: float, pair: str) -> Any:
    return parameter(default, f"frequency of the {pair}", unit="Hz", low=0, above=True)


def _damping(default: float, pair: str) -> Any:
    return parameter(default, f"damping ratio of the {pair}", low=0, above=True)


@dataclass(frozen=True)
class ApproximateModel(Checked):
    """Invertible handle model of the paper: two zero pairs, two pole pairs, unit DC gain.

    The defaults are the numbers below eq. (3) of the paper.
    """

    zero_1_frequency: float = _frequency(9.0, "model's first zero pair")
    zero_1_damping: float = _damping(0.5, "model's first zero pair")
    zero_2_frequency: float = _frequency(12.0, "model's second zero pair")
    zero_2_damping: float = _damping(0.3, "model's second zero pair")
    pole_1_frequency: float = _frequency(15.0, "model's first pole pair")
    pole_1_damping: float = _damping(0.35, "model's first pole pair")
    pole_2_frequency: float = _frequency(20.0, "model's second pole pair")
    pole_2_damping: float = _damping(0.4, "model's second pole pair")
    gain: float = parameter(
        1.0, "gain of the model at zero frequency", unit="m/s^2/N", low=0, above=True
    )

    def sections(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return the model's two second-order factors as (numerator, denominator) in s.

        Each factor has unit gain at s = 0; `gain` is not included.
        """
        zeros = (
            _pair(self.zero_1_frequency, self.zero_1_damping),
            _pair(self.zero_2_frequency, self.zero_2_damping),
        )
        poles = (
            _pair(self.pole_1_frequency, self.pole_1_damping),
            _pair(self.pole_2_frequency, self.pole_2_damping),
        )
        return list(zip(zeros, poles, strict=True))

    def model(self) -> RationalModel:
        """Return the transfer function, in m/s^2 per N."""
        (zeros_1, poles_1), (zeros_2, poles_2) = self.sections()
        numerator = self.gain * np.asarray(np.polymul(zeros_1, zeros_2), dtype=np.float64)
        return RationalModel(numerator, np.asarray(np.polymul(poles_1, poles_2), np.float64))


def _pair(frequency: float, damping: float) -> FloatArray:
    """Return the polynomial of a complex pair with unit value at s = 0."""
    omega = 2 * np.pi * frequency
    return np.array([1 / omega**2, 2 * damping / omega, 1.0])


@dataclass(frozen=True)
class AccelerometerParameters(Checked):
    """Accelerometer Analog Devices ADXL320J with a 16-bit converter, as in the paper."""

    range: float = parameter(
        5 * GRAVITY, "accelerometer range in each direction (5 g)", unit="m/s^2", low=0, above=True
    )
    bandwidth: float = parameter(
        500.0, "corner of the accelerometer's first-order low-pass (paper)", "Hz", 1.0, 100e3
    )
    noise_density: float = parameter(
        250e-6 * GRAVITY, "noise density (ADXL320: 250 ug/sqrt(Hz))", "m/s^2/sqrt(Hz)", 0, 1.0
    )
    bits: int = parameter(
        16, "resolution of the accelerometer's converter over its range", "bit", 4, 32
    )

    @property
    def noise(self) -> float:
        """Standard deviation of a sample, m/s^2: white noise after the first-order low-pass."""
        # The noise bandwidth of a first-order low-pass is pi/2 times its corner frequency.
        return self.noise_density * math.sqrt(math.pi / 2 * self.bandwidth)


class Sample(NamedTuple):
    """Readings of an arm and its accelerometer.

    Attributes
    ----------
    position : tuple of float
        Position of tip or handle in the arm's base frame, m.
    velocity : tuple of float
        Velocity of the same point, m/s.
    acceleration : tuple of float
        Acceleration in the tool or handle frame, m/s^2; zero along axes that are not measured.
    orientation : tuple of float
        Orientation of tool or handle in the arm's base frame, a quaternion of unit length.
    """

    position: Vector
    velocity: Vector
    acceleration: Vector
    orientation: Quaternion = IDENTITY


class _Answer(Enum):
    """Answer of a device without a sample."""

    LATER = "later"


LATER: Final = _Answer.LATER
"""The sample may still arrive."""

Reading: TypeAlias = Sample | Literal[_Answer.LATER] | None
"""A sample, `LATER`, or None for a sample that is lost or was never taken."""

GRIP_STREAM = 3
"""Random stream of the user's grip, independent of sensor noise with the same seed."""

POSTURES: dict[str, tuple[float, float, float]] = {
    "average": (1.0, 1.0, 1.0),
    "pinch": (0.92, 0.75, 0.8),
    "hook": (1 / 0.92, 1 / 0.75, 1 / 0.8),
}
"""Factors of m_h, k_u and b_u by posture. The paper fitted Table I to pinch and hook grips
together. A pinch grip is assumed to be softer and to involve less of the hand, with Table I in the
middle."""


@dataclass(frozen=True)
class MountParameters(Checked):
    """Light, elastic mount of the accelerometer on the handle."""

    frequency: float = parameter(0.0, "resonance of the mount; 0 for a rigid one", "Hz", 0, 2000.0)
    damping: float = parameter(0.2, "damping ratio of the mount", low=0.01, high=2.0)


@dataclass(frozen=True)
class ModeParameters(Checked):
    """Second structural mode between handle and accelerometer, in series or parallel to the mount.

    The accelerometer measures the share of the mode plus the rest of the mount: 1 in series with
    the mount is a fourth-order low-pass; a share in parallel is a sum of two modes with an
    antiresonance, or a resonance next to an antiresonance if the mount is rigid.
    """

    frequency: float = parameter(0.0, "resonance of a second mode; 0 for none", "Hz", 0, 2000.0)
    damping: float = parameter(0.2, "damping ratio of the second mode", low=0.01, high=2.0)
    share: float = parameter(
        1.0, "fraction of the acceleration that passes the second mode", low=0.0, high=1.0
    )
    on_mount: bool = parameter(
        True,
        "excite the second mode by the mount (in series) in place of the handle (in parallel)",
    )


@dataclass(frozen=True)
class GripParameters(Checked):
    """Variation between users, posture of the hand, and gravity."""

    variation: float = parameter(
        0.0, "standard deviation of ln m_h, k_u and b_u from seed to seed", low=0, high=1.0
    )
    posture: str = parameter(
        "average", "posture of the hand; average: Table I of the paper", choices=tuple(POSTURES)
    )
    gravity: float = parameter(0.0, "gravity along the actuator's axis", "m/s^2", -9.81, 9.81)


def held(handle: HandleParameters, grip: GripParameters, seed: int) -> HandleParameters:
    """Return the handle parameters for one user's posture and individual variation.

    Parameters
    ----------
    handle : HandleParameters
        Parameters of the average user.
    grip : GripParameters
    seed : int
        Seed of the user's individual variation.
    """
    m_h, k_u, b_u = POSTURES[grip.posture]
    if grip.variation:
        drawn = np.random.default_rng((seed, GRIP_STREAM)).normal(0.0, grip.variation, 3)
        # Mass, stiffness and damping vary together: mass least, stiffness most.
        factors = np.exp(drawn * (0.3, 1.0, 0.7)).tolist()
        m_h, k_u, b_u = m_h * factors[0], k_u * factors[1], b_u * factors[2]
    return replace(handle, m_h=handle.m_h * m_h, k_u=handle.k_u * k_u, b_u=handle.b_u * b_u)

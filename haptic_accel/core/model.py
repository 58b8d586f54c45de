"""The handle model of McMahan and Kuchenbecker (IROS 2009): parameters and transfer functions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptic_accel.core.parameters import Checked, parameter

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class HandleParameters(Checked):
    """Actuator on its spring, handle and hand: eq. (1) and (2), Table I of the paper."""

    m_a: float = parameter(0.018, "moving mass of the actuator", unit="kg", low=0, above=True)
    k_s: float = parameter(266.0, "centring spring of the actuator", unit="N/m", low=0)
    b_s: float = parameter(2.0, "damping of the actuator's bearing", unit="N s/m", low=0)
    m_h: float = parameter(0.128, "mass of handle and hand", unit="kg", low=0, above=True)
    k_u: float = parameter(1500.0, "stiffness of the user's grip", unit="N/m", low=0)
    b_u: float = parameter(11.0, "damping of the user's grip", unit="N s/m", low=0)


@dataclass(frozen=True)
class RationalModel:
    """A transfer function in s by its polynomials.

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
    """Handle acceleration over actuator force, H(s) = A_h/F_a, eq. (3) of the paper.

    Returns
    -------
    RationalModel
        In m/s^2 per N; four zeros at the origin, 1/m_h at high frequency.
    """
    actuator = np.array([handle.m_a, handle.b_s, handle.k_s])
    b_su, k_su = handle.b_s + handle.b_u, handle.k_s + handle.k_u
    grip = np.array([handle.m_h, b_su, k_su])
    bearing = np.array([handle.b_s, handle.k_s])
    denominator: FloatArray = np.polysub(np.polymul(actuator, grip), np.polymul(bearing, bearing))
    return RationalModel(np.array([handle.m_a, 0.0, 0.0, 0.0, 0.0]), denominator)


@dataclass(frozen=True)
class ApproximateModel(Checked):
    """The paper's invertible model of the handle: two zero pairs, two pole pairs, unit DC gain.

    Its defaults are the numbers below eq. (3) of the paper.
    """

    zero_1_frequency: float = parameter(9.0, "first zero pair", unit="Hz", low=0, above=True)
    zero_1_damping: float = parameter(0.5, "its damping ratio", low=0, above=True)
    zero_2_frequency: float = parameter(12.0, "second zero pair", unit="Hz", low=0, above=True)
    zero_2_damping: float = parameter(0.3, "its damping ratio", low=0, above=True)
    pole_1_frequency: float = parameter(15.0, "first pole pair", unit="Hz", low=0, above=True)
    pole_1_damping: float = parameter(0.35, "its damping ratio", low=0, above=True)
    pole_2_frequency: float = parameter(20.0, "second pole pair", unit="Hz", low=0, above=True)
    pole_2_damping: float = parameter(0.4, "its damping ratio", low=0, above=True)
    gain: float = parameter(1.0, "gain at zero frequency", unit="m/s^2/N", low=0, above=True)

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

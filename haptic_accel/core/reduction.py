# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reduction of vibration in three axes to one signal for a single actuator.

People distinguish every such signal from the original in three axes; spectrum, course in time and
direction may all contribute (Lee, Tombak, Park, Kuchenbecker, IEEE Transactions on Haptics 15(3),
2022).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import itemgetter

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXES
from haptic_accel.core.model import FloatArray, Vector

# Whole recordings


def coil_component(acceleration: FloatArray) -> FloatArray:
    """Return the component along the axis of a single coil; the others are lost.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
    """
    (index,) = ACTUATOR_AXES.indices
    return np.asarray(acceleration[:, index])


def total(acceleration: FloatArray) -> FloatArray:
    """Return the sum of the components; opposite ones cancel.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
    """
    return np.asarray(acceleration.sum(axis=1))


def principal(acceleration: FloatArray) -> FloatArray:
    """Return the component along the direction of the largest variance.

    The direction has a positive largest component, so that the sign does not depend on the method.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)

    Examples
    --------
    >>> import numpy as np
    >>> principal(np.outer([5.0, -5.0, 0.0], [0.6, 0.0, 0.8])).round(9)
    array([ 5., -5.,  0.])
    """
    moving = acceleration - acceleration.mean(axis=0)
    direction = np.linalg.eigh(moving.T @ moving)[1][:, -1]
    return np.asarray(acceleration @ (direction * np.sign(direction[np.abs(direction).argmax()])))


def magnitude(acceleration: FloatArray) -> FloatArray:
    """Return the length of the vector, never negative: the frequency of an oscillation doubles.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
    """
    return np.asarray(np.linalg.norm(acceleration, axis=1))


def dft321(acceleration: FloatArray) -> FloatArray:
    """Return a signal with the spectral power of all axes together, and the phase of their sum.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
        The whole recording: the method is not causal.

    Notes
    -----
    Landin, Romano, McMahan, Kuchenbecker, "Dimensional reduction of high-frequency accelerations
    for haptic rendering", EuroHaptics 2010. The inverse transform is real: using its magnitude
    instead would rectify the signal.

    Examples
    --------
    >>> import numpy as np
    >>> dft321(np.array([[3.0, 0.0, 4.0], [-3.0, 0.0, -4.0]])).round(9)
    array([ 5., -5.])
    """
    spectra = np.fft.rfft(acceleration, axis=0)
    phase = np.angle(spectra.sum(axis=1))
    combined = np.linalg.norm(spectra, axis=1) * np.exp(1j * phase)
    return np.asarray(np.fft.irfft(combined, len(acceleration)))


REDUCTIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "dft321": dft321,
    "principal": principal,
    "sum": total,
    "magnitude": magnitude,
    "axis": coil_component,
}
"""Reductions of a whole recording by name; each takes shape (n, 3) and returns shape (n,)."""

# Sample by sample

Reduction = Callable[[Vector], float]
"""Causal reduction: it is called with each sample in order."""

LEARNING = 2.0
"""Time in contact after which a principal direction is known, s: hundreds of periods (assumed)."""

CONTACT = 0.5
"""Vibration above which a tool counts as in contact, m/s^2: assumed, four times the noise of three
ADXL320."""

CORNER = 15.0
"""Frequency below which an acceleration is motion or gravity, Hz: the compensation's high-pass."""

FIRST_TURN, LATER_TURN = math.radians(90.0), math.radians(5.0)
"""Maximum rotation rate of a principal direction while it is being determined, and afterwards,
rad/s (assumed): the first one reaches any direction within a second; the second one changes a
component by less than a tenth per second."""

SEARCH = 0.05
"""Interval between computations of the principal direction, s of contact; each takes 20 us."""


class PrincipalDirection:
    """Component along the direction of the tool's strongest vibration, which rotates slowly.

    The direction starts along the coil. In the first `LEARNING` seconds of contact it rotates to
    the eigenvector of the largest eigenvalue of the vibration's covariance, and then follows it
    slowly. Of the two opposite directions the nearer one is used, and the rotation in each sample
    is limited, so that the signal neither jumps nor changes its sign. The less the largest
    eigenvalue exceeds the next one, the slower is the rotation: a circular vibration has no
    principal direction.

    This is principal component analysis with exponential forgetting. It assumes that the direction
    changes less often than every few seconds, as in strokes over one surface.

    Parameters
    ----------
    rate : float
        Samples per second.

    Attributes
    ----------
    direction : tuple of float
        Present direction, of unit length.

    Examples
    --------
    >>> reduced = PrincipalDirection(1000.0)
    >>> for sample in range(3000):
    ...     x = 5.0 * math.sin(0.3 * sample)
    ...     found = reduced((0.6 * x, 0.0, 0.8 * x))
    >>> [round(each, 3) for each in reduced.direction]
    [0.6, 0.0, 0.8]
    """

    def __init__(self, rate: float) -> None:
        self.direction = ACTUATOR_AXES.vector([1.0])
        self._principal, self._distinct = np.array(self.direction), 0.0
        self._resting = -math.expm1(-2 * math.pi * CORNER / rate)
        self._rest: Vector | None = None
        self._products = np.zeros((3, 3))
        self._waiting: list[Vector] = []
        self._block = max(1, round(SEARCH * rate))
        self._learning = LEARNING * rate
        self._contact = 0  # samples
        self._turns = FIRST_TURN / rate, LATER_TURN / rate

    def __call__(self, acceleration: Vector) -> float:
        """Return the component of a sample, m/s^2."""
        self._learn(acceleration)
        x, y, z = acceleration
        d_x, d_y, d_z = self.direction
        return x * d_x + y * d_y + z * d_z

    def _learn(self, acceleration: Vector) -> None:
        """Add a sample of contact to the covariance, and rotate; ignore missing samples."""
        if not math.isfinite(sum(acceleration)):
            return
        x, y, z = acceleration
        r_x, r_y, r_z = self._rest or acceleration
        moving = x - r_x, y - r_y, z - r_z
        a = self._resting
        self._rest = r_x + a * moving[0], r_y + a * moving[1], r_z + a * moving[2]
        if math.hypot(*moving) < CONTACT:
            return
        self._contact += 1
        self._waiting.append(moving)
        if len(self._waiting) == self._block:
            self._search()
        if self._distinct:
            self._turn()

    def _search(self) -> None:
        """Compute the principal direction, and how distinct it is, 0 to 1."""
        block = np.array(self._waiting)
        self._waiting.clear()
        self._products *= math.exp(-self._block / self._learning)
        self._products += block.T @ block
        values, vectors = np.linalg.eigh(self._products)
        self._principal = vectors[:, -1]
        self._distinct = float(1.0 - values[1] / values[2])

    def _turn(self) -> None:
        """Rotate the direction towards the nearer principal direction by at most a step."""
        now = np.array(self.direction)
        along = float(now @ self._principal)
        across = self._principal * math.copysign(1.0, along) - now * abs(along)
        sine = float(np.linalg.norm(across))
        step = self._distinct * self._turns[self._contact > self._learning]
        if sine > 0.0:
            now += across * min(1.0, step / sine)
            x, y, z = (now / np.linalg.norm(now)).tolist()
            self.direction = x, y, z


def live_reduction(name: str, rate: float) -> Reduction:
    """Return a causal reduction for a handle with one coil along z.

    Parameters
    ----------
    name : str
        One of `LIVE_REDUCTIONS`.
    rate : float
        Samples per second.

    Examples
    --------
    >>> live_reduction("axis", 1000.0)((1.0, 2.0, 4.0))
    4.0
    >>> live_reduction("sum", 1000.0)((1.0, 2.0, 4.0))
    7.0
    """
    if name == "principal":
        return PrincipalDirection(rate)
    if name == "sum":
        return sum
    return itemgetter(*ACTUATOR_AXES.indices)


NO_REDUCTION = "none"
"""Name for all axes of the handle, without a reduction."""

LIVE_REDUCTIONS = ("axis", "sum", "principal")
"""Names of causal reductions: component along the coil, sum of the components, component along a
slowly rotating principal direction."""

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Axes of a device's vibration: components, orientation, and reduction to one signal.

By the orientation, vibration has the same direction at both: a tool's acceleration is rotated from
the tool's axes to those of its base, and from the base of the handle to the handle's axes.
Positions are coupled along the axes of both bases, so that a direction is the same in both. CRTK's
`measured_cp` contains the orientation of tool or handle relative to its base.

People distinguish every such signal from the original in three axes; spectrum, course in time and
direction may all contribute (Lee, Tombak, Park, Kuchenbecker, IEEE Transactions on Haptics 15(3),
2022).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from haptic_accel.core.model import IDENTITY, FloatArray, Quaternion, Vector
from haptic_accel.core.parameters import ParameterError, read_decimal, shown

NAMES = ("x", "y", "z")
"""Components of a vector, in order."""

VIBRATION = "vibration"
"""First part of the names of a learning set's samples, in m/s^2; axis and number follow."""

HIGHEST_CONDITION = 10.0
"""Maximum condition number of the directions of coils or of a sensor's axes: above it, a force
along one axis needs ten times the force of another, and sensor noise is amplified as much
(assumed)."""


@dataclass(frozen=True)
class Axes:
    """Components of a vector that a device has; the others are zero.

    Attributes
    ----------
    names : tuple of str
        Names of the axes, in the order x, y, z.

    Raises
    ------
    ParameterError
        There is no axis, or they are not x, y, z in this order.

    Examples
    --------
    >>> Axes(("x", "z")).components((1.0, 2.0, 3.0))
    [1.0, 3.0]
    >>> Axes(("z",)).vector([3.0])
    (0.0, 0.0, 3.0)
    """

    names: tuple[str, ...] = ("z",)

    def __post_init__(self) -> None:
        """Check the names."""
        if not self.names or self.names != tuple(n for n in NAMES if n in self.names):
            raise ParameterError(
                f"axes = {', '.join(self.names) or 'none'}: must be some of x, y, z, in this order"
            )

    @cached_property
    def indices(self) -> tuple[int, ...]:
        """Indices of the axes in a vector."""
        return tuple(map(NAMES.index, self.names))

    def components(self, vector: Vector) -> list[float]:
        """Return the components of a vector along the axes."""
        return [vector[index] for index in self.indices]

    def vector(self, components: Sequence[float]) -> Vector:
        """Return the vector with components along the axes; the others are zero."""
        values = [0.0, 0.0, 0.0]
        for index, value in zip(self.indices, components, strict=True):
            values[index] = value
        x, y, z = values
        return x, y, z

    def signals(self, vectors: FloatArray) -> FloatArray:
        """Return the components of vectors (n, 3): shape (n,) for one axis, (n, axes) for more."""
        values = np.ascontiguousarray(vectors[:, self.indices])
        return values[:, 0] if len(self.names) == 1 else values

    def sample_names(self, size: int) -> list[str]:
        """Return the names of a window's samples in learning sets, axis by axis, oldest first."""
        return [f"{VIBRATION}.{axis}.{sample}" for axis in self.names for sample in range(size)]

    @classmethod
    def parsed(cls, text: str) -> Axes:
        """Return the axes that a text such as "x, y, z" specifies.

        Raises
        ------
        ParameterError
            The text contains no axes.
        """
        return cls(tuple(filter(None, text.replace(",", " ").split())))


ACTUATOR_AXES = Axes()
"""Axes of a handle with a single coil: the actuator's axis is z."""

ALL_AXES = Axes(NAMES)
"""Axes of a handle with three coils."""

ACTUATOR_AXIS = NAMES.index("z")
"""Index of the axis of a single coil in a vector."""


def along_actuator(value: float) -> Vector:
    """Return a vector along the axis of a single coil."""
    return (0.0, 0.0, value)


def read_numbers(name: str, text: str, count: int) -> list[float]:
    """Return the numbers of a parameter, separated by commas or spaces.

    Raises
    ------
    ParameterError
        The text contains something else, or another number of values.

    Examples
    --------
    >>> read_numbers("offsets", "1, -2.5 3", 3)
    [1.0, -2.5, 3.0]
    """
    try:
        numbers = [read_decimal(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ParameterError(f"{name} = {shown(repr(text))}: must be {count} finite numbers")
    return numbers


class Mounting:
    """Directions of three coils, or of three axes of a sensor, in the frame of handle or tool.

    Parameters
    ----------
    directions : array_like, shape (3, 3)
        Direction of each coil or axis in a row; lengths do not matter.
    name : str
        Name of the parameter, for the error message.

    Raises
    ------
    ParameterError
        The directions are too close to a plane to be inverted.

    Examples
    --------
    >>> turned = Mounting([[0, 2, 0], [-1, 0, 0], [0, 0, 1]])
    >>> turned.acceleration((1.0, 2.0, 3.0))
    (-2.0, 1.0, 3.0)
    >>> turned.coil_forces((1.0, 2.0, 3.0))
    (2.0, -1.0, 3.0)
    """

    def __init__(self, directions: npt.ArrayLike, name: str = "directions") -> None:
        rows = np.asarray(directions, dtype=float)
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        rows = np.asarray(rows / np.where(lengths, lengths, 1.0))
        condition = np.linalg.cond(rows)
        if not condition <= HIGHEST_CONDITION:
            raise ParameterError(
                f"{name}: axes that are not orthogonal enough to be inverted: their condition"
                f" number is {condition:.3g}, must be at most {HIGHEST_CONDITION:g}"
            )
        inverse = np.asarray(np.linalg.inv(rows), dtype=np.float64)
        self._to_handle, self._to_coils = inverse.tolist(), inverse.T.tolist()

    def acceleration(self, measured: Vector) -> Vector:
        """Return the acceleration for the components measured along the axes of a sensor."""
        return product(self._to_handle, *measured)

    def coil_forces(self, force: Vector) -> Vector:
        """Return the forces of the coils whose vector sum is a force."""
        return product(self._to_coils, *force)


def read_mounting(name: str, text: str, axes: Axes) -> Mounting | None:
    """Return the mounting that nine numbers specify, such as "1 0 0, 0 1 0, 0 0 1".

    Returns
    -------
    Mounting or None
        None for an empty text, and for a device without all axes.

    Raises
    ------
    ParameterError
        The text does not contain nine finite numbers, or the directions cannot be inverted.
    """
    if not text or axes != ALL_AXES:
        return None
    return Mounting(np.reshape(read_numbers(name, text, 9), (3, 3)), name)


def product(rows: Sequence[Sequence[float]], x: float, y: float, z: float) -> Vector:
    """Return the product of a 3x3 matrix with a vector; numpy would take ten times as long."""
    a, b, c = rows
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


UNIT_ERROR = 0.01
"""Maximum deviation of a quaternion's length from 1: far above rounding errors, also of float32,
and far below the deviation of an unset quaternion."""


def unit_quaternion(values: Sequence[float]) -> Quaternion | None:
    """Return a quaternion of unit length; None for values that are not a rotation.

    Examples
    --------
    >>> unit_quaternion([0.0, 0.0, 0.0, 1.001])
    (0.0, 0.0, 0.0, 1.0)
    >>> unit_quaternion([0.0, 0.0, 0.0, 0.0])
    """
    length = math.hypot(*values)
    if len(values) != len(IDENTITY) or not abs(length - 1.0) <= UNIT_ERROR:
        return None
    x, y, z, w = (value / length for value in values)
    return x, y, z, w


def to_base(orientation: Quaternion, vector: Vector) -> Vector:
    """Convert a vector from rotated axes to those of the base.

    Examples
    --------
    >>> upright = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # a quarter turn about z
    >>> [round(abs(each), 9) for each in to_base(upright, (1.0, 0.0, 0.0))]
    [0.0, 1.0, 0.0]
    """
    x, y, z, w = orientation
    if not (x or y or z):
        return vector
    v_x, v_y, v_z = vector
    # v + 2 w (q x v) + 2 q x (q x v), with the vector part q.
    t_x, t_y, t_z = 2 * (y * v_z - z * v_y), 2 * (z * v_x - x * v_z), 2 * (x * v_y - y * v_x)
    return (
        v_x + w * t_x + y * t_z - z * t_y,
        v_y + w * t_y + z * t_x - x * t_z,
        v_z + w * t_z + x * t_y - y * t_x,
    )


def from_base(orientation: Quaternion, vector: Vector) -> Vector:
    """Convert a vector from the base's axes to rotated axes, the inverse of `to_base`."""
    x, y, z, w = orientation
    return to_base((-x, -y, -z, w), vector)


def is_turned(orientation: Quaternion, acceleration: Vector) -> bool:
    """Return True if a vibration has to be rotated.

    A single-axis sensor has no direction: its other components are zero, and its vibration is
    reproduced along the coil, regardless of the orientation.

    Examples
    --------
    >>> is_turned((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    False
    >>> is_turned((1.0, 0.0, 0.0, 0.0), (0.1, 0.0, 2.0))
    True
    """
    return orientation is not IDENTITY and acceleration.count(0.0) < len(acceleration) - 1


class Orientation:
    """Newest orientation of a tool or handle, from values that may not be a rotation.

    The last valid orientation is kept, as a change to another one would suddenly rotate the
    vibration. Before the first one, the axes are those of the base.

    Attributes
    ----------
    newest : tuple of float
    problem : str
        One-line warning while the values are not a rotation; empty otherwise.

    Examples
    --------
    >>> tool = Orientation()
    >>> tool.put([0.0, 0.0, 0.0, 0.0])
    >>> tool.newest == IDENTITY, tool.problem
    (True, 'the orientation is not a unit quaternion: the last valid one is kept')
    """

    def __init__(self) -> None:
        self.newest = IDENTITY
        self.problem = ""

    def put(self, values: Sequence[float]) -> None:
        """Add the orientation of a pose."""
        if found := unit_quaternion(values):
            self.newest, self.problem = found, ""
        else:
            self.problem = "the orientation is not a unit quaternion: the last valid one is kept"


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

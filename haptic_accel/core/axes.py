# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Axes of a device's vibration: components of a vector that it measures and drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from haptic_accel.core.model import Vector
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

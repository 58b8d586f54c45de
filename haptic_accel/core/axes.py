# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Axes of a device's vibration: components of a vector that it measures and drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError

NAMES = ("x", "y", "z")
"""Components of a vector, in order."""


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

    @property
    def indices(self) -> tuple[int, ...]:
        """Positions of the axes in a vector."""
        return tuple(map(NAMES.index, self.names))

    def components(self, vector: Vector) -> list[float]:
        """Return the components of a vector along the axes."""
        return [vector[index] for index in self.indices]

    def vector(self, components: Sequence[float]) -> Vector:
        """Return the vector with the given components along the axes."""
        values = dict(zip(self.names, components, strict=True))
        x, y, z = (values.get(name, 0.0) for name in NAMES)
        return x, y, z

    @classmethod
    def parsed(cls, text: str) -> Axes:
        """Return the axes given by a text such as "x, y, z".

        Raises
        ------
        ParameterError
            The text names no axes.
        """
        return cls(tuple(filter(None, text.replace(",", " ").split())))


ACTUATOR_AXES = Axes()
"""Axes of a handle with a single coil: the actuator's axis is z."""

ALL_AXES = Axes(NAMES)
"""Axes of a handle with three coils."""

ACTUATOR_AXIS = NAMES.index("z")
"""Position of the axis of a single coil in a vector."""


def along_actuator(value: float) -> Vector:
    """Return a vector along the axis of a single coil."""
    return (0.0, 0.0, value)

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Switch between reductions of three axes to one while a compensation runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from haptic_accel.core.axes import along_actuator
from haptic_accel.core.control.channel import FADING, LISTENING, RESTING
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.reduction import NO_REDUCTION, live_reduction
from haptic_accel.core.tick import LARGEST_ACCELERATION, InputReduction

Shaping: TypeAlias = Callable[[Vector], Vector]
"""Function from the tool's acceleration to the input of each coil's compensation, m/s^2."""


class ReductionSwitch(InputReduction):
    """Input of the coils' compensations: the tool's vibration in all axes, or reduced to one.

    A change affects the controllers' input, not the controllers. Like a new controller, a new
    reduction first only receives samples for `LISTENING`, and is then crossfaded over `FADING`.
    Gravity has another component in each reduction. The mean difference is kept as an offset, so
    that the following high-pass sees no step. A running crossfade is completed before another
    starts.

    Parameters
    ----------
    name : str
        `NO_REDUCTION` or one of `LIVE_REDUCTIONS`.
    rate : float
        Samples per second.
    unreduced : callable
        Function that returns the input without reduction.

    Attributes
    ----------
    name : str
        Name of the reduction in use, or of the last selected one.
    active : str
        Name of the reduction in use, also while another one is prepared.

    Examples
    --------
    >>> switch = ReductionSwitch("none", 1000.0, unreduced=lambda tool: tool)
    >>> switch.process((1.0, 2.0, 3.0)), switch.alone
    ((1.0, 2.0, 3.0), 0.0)
    >>> switch.select("sum")
    >>> switch.settle()
    >>> switch.process((1.0, 2.0, 3.0)), switch.alone
    ((0.0, 0.0, 6.0), 1.0)
    """

    def __init__(self, name: str, rate: float, unreduced: Shaping) -> None:
        super().__init__()
        self._rate = rate
        self._shapings: dict[str, Shaping] = {NO_REDUCTION: unreduced}
        self._listening, self._fading = round(LISTENING * rate), max(1, round(FADING * rate))
        self._resting = -math.expm1(-1.0 / (RESTING * rate))
        self._following: str | None = None
        self._difference: Vector | None = None
        self._listened = 0
        self.name = name
        self.settle()

    def select(self, name: str) -> None:
        """Change to another reduction without a jump."""
        self.name, self.reduces = name, {name, self.active} != {NO_REDUCTION}
        if self._following is None or self._listened <= self._listening:
            self._listen()

    def settle(self) -> None:
        """Use the selected reduction at once, before the first sample."""
        self._offset = ZERO
        self._take_over(self.name)

    def process(self, tool: Vector) -> Vector:
        """Return the input for a sample of the tool, m/s^2."""
        if self._unused:
            self._unused(tool)
        value = self._shaped(tool)
        if self._offset is not ZERO:
            value = _plus(value, self._offset)
        return value if self._following is None else self._mixed(value, tool)

    def _mixed(self, value: Vector, tool: Vector) -> Vector:
        """Return the input; crossfade it after the next reduction has received enough samples."""
        assert self._following is not None
        following = self._shapings[self._following](tool)
        self._listened += 1
        if self._listened <= self._listening:
            if all(abs(each) <= LARGEST_ACCELERATION for each in tool):  # also false for NaN
                self._follow(value, following)
            return value
        following = _plus(following, self._difference or ZERO)
        share = (self._listened - self._listening) / self._fading
        if share >= 1.0:
            self._offset = self._difference or ZERO
            self._take_over(self._following)
            return following
        before, after = self._active_alone, float(self._following != NO_REDUCTION)
        self.alone = before + share * (after - before)
        x, y, z = ((1.0 - share) * a + share * b for a, b in zip(value, following, strict=True))
        return x, y, z

    def _follow(self, value: Vector, following: Vector) -> None:
        """Update the mean difference of both inputs, mostly gravity."""
        x, y, z = (a - b for a, b in zip(value, following, strict=True))
        if self._difference is None:
            self._difference = x, y, z
        m_x, m_y, m_z = self._difference
        a = self._resting
        self._difference = m_x + a * (x - m_x), m_y + a * (y - m_y), m_z + a * (z - m_z)

    def _listen(self) -> None:
        """Prepare the selected reduction, unless it is in use."""
        self._following = None if self.name == self.active else self.name
        self._listened, self._difference = 0, None
        self._prepare()

    def _take_over(self, name: str) -> None:
        self.active = name
        self.alone = self._active_alone = float(name != NO_REDUCTION)
        self._listen()

    def _prepare(self) -> None:
        """Build the reductions in use; keep updating a principal direction once it was used."""
        for name in filter(None, (self.active, self._following)):
            if name not in self._shapings:
                self._shapings[name] = _along_z(name, self._rate)
        self._shaped = self._shapings[self.active]
        self.reduces = {self.name, self.active} != {NO_REDUCTION}
        used = self.active, self._following
        self._unused = None if PRINCIPAL in used else self._shapings.get(PRINCIPAL)
        self.idle = used == (NO_REDUCTION, None) and not self._unused and self._offset is ZERO


PRINCIPAL = "principal"
"""Name of the only adaptive reduction."""


def _along_z(name: str, rate: float) -> Shaping:
    """Return the input of a single coil along z."""
    reduced = live_reduction(name, rate)
    return lambda tool: along_actuator(reduced(tool))


def _plus(one: Vector, other: Vector) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]

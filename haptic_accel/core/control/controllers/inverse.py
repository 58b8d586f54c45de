"""Inverse of the whole identified handle, with hold, delay, mount and sensor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypedDict

from haptic_accel.core.actuator.friction import FrictionCompensation
from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.filters import SampleFilter
from haptic_accel.core.control.inversion.convolution import SampleConvolution
from haptic_accel.core.control.inversion.design import (
    LONGEST_GRANTED_DELAY,
    MEMORY,
    TRAVEL_LIMIT,
    InverseFilter,
    design_inverse,
)
from haptic_accel.core.control.inversion.spectrum import TexturePrior, ToolSpectrum
from haptic_accel.core.parameters import Checked, parameter


class DesignTerms(TypedDict):
    """Keyword arguments of `design_inverse` and `design_family`."""

    granted_delay: int
    memory: float
    travel_limit: float
    spectrum: ToolSpectrum
    high_pass_frequency: float


@dataclass(frozen=True)
class InverseParameters(Checked):
    """Delay, travel and texture for which the inverse is designed."""

    granted_delay: int = parameter(
        1,
        "samples by which the handle may lag behind the tool (the paper's delay of 1 ms)",
        low=0,
        high=LONGEST_GRANTED_DELAY,
    )
    travel_limit: float = parameter(
        TRAVEL_LIMIT,
        "maximum travel of the actuator as the tool lands on a surface",
        unit="m",
        low=1e-5,
        high=0.1,
    )
    texture: TexturePrior = field(default_factory=TexturePrior)
    memory: float = parameter(
        MEMORY, "length of the impulse response", unit="s", low=0.05, high=0.4
    )

    def filter(self, loop: Loop) -> InverseFilter:
        """Return the inverse for a loop; takes a fraction of a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        return design_inverse(loop.plant, loop.rate, **self.terms(loop))

    def terms(self, loop: Loop) -> DesignTerms:
        """Return the arguments of the design of the inverse, or of a family of inverses."""
        return {
            "granted_delay": self.granted_delay,
            "memory": self.memory,
            "travel_limit": self.travel_limit,
            "spectrum": self.texture,
            "high_pass_frequency": loop.high_pass_frequency,
        }


class InverseController(Controller):
    """f_a = a_hdes through the causal inverse of eq. (3), hold, delay, mount and sensor.

    Attributes
    ----------
    friction_force : float
        Part of the last force that compensates dry friction, N.
    """

    Parameters = InverseParameters

    def __init__(self, parameters: InverseParameters, loop: Loop) -> None:
        inverse = parameters.filter(loop)
        self._extension = SampleFilter(inverse.sections)
        self._convolution = SampleConvolution(inverse.taps)
        self._friction = FrictionCompensation(loop.plant.handle, loop.plant.friction, loop.rate)
        self.friction_force = 0.0

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force after which the handle moves as desired."""
        force = self._convolution.sample(self._extension.sample(desired_acceleration))
        self.friction_force = self._friction.force(force, desired_acceleration)
        return force + self.friction_force

    def reset(self) -> None:
        """Clear both filters."""
        self._extension.reset()
        self._convolution.reset()
        self._friction.reset()
        self.friction_force = 0.0

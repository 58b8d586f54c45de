"""Inverse of the whole identified handle, with hold, delay, mount and sensor."""

from __future__ import annotations

from dataclasses import dataclass, field

from haptic_accel.core.actuator.friction import FrictionCompensation
from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.filters import SampleFilter
from haptic_accel.core.control.inversion.convolution import SampleConvolution
from haptic_accel.core.control.inversion.design import (
    LONGEST_GRANTED_DELAY,
    MEMORY,
    TRAVEL_LIMIT,
    Goal,
    InverseFilter,
    design_inverse,
)
from haptic_accel.core.control.inversion.spectrum import TexturePrior
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, parameter


@dataclass(frozen=True)
class InverseParameters(Checked):
    """Delay, travel and texture for which the inverse is designed."""

    granted_delay: int = parameter(
        1,
        "number of samples by which the handle may lag behind the tool beside the latency (the"
        " paper's delay of 1 ms)",
        low=0,
        high=LONGEST_GRANTED_DELAY,
    )
    travel_limit: float = parameter(
        TRAVEL_LIMIT,
        "maximum travel of the actuator as the tool lands on a surface",
        "m",
        1e-5,
        0.1,
    )
    texture: TexturePrior = field(default_factory=TexturePrior)
    memory: float = parameter(
        MEMORY, "length of the controller's impulse response", "s", 0.05, 0.4
    )

    def filter(self, loop: Loop) -> InverseFilter:
        """Return the inverse for a loop; takes a fraction of a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        return design_inverse(loop.plant, loop.rate, self.goal(loop))

    def goal(self, loop: Loop) -> Goal:
        """Return the goal of the design of the inverse, or of a family of inverses."""
        granted = loop.latency + self.granted_delay
        corner = loop.high_pass_frequency
        return Goal(granted, self.memory, self.travel_limit, self.texture, corner)


class InverseController(Controller):
    """f_a = a_hdes through the causal inverse of eq. (3), hold, delay, mount and sensor.

    Attributes
    ----------
    response : callable
        Force over desired acceleration, N per m/s^2, at frequencies in Hz.
    friction_force : float
        Part of the last force that compensates dry friction, N.
    """

    Parameters = InverseParameters

    def __init__(self, parameters: InverseParameters, loop: Loop) -> None:
        inverse = parameters.filter(loop)
        self.response = inverse.response
        self._invert_by(inverse.sections, inverse.taps, loop)

    def _invert_by(self, sections: FloatArray, taps: FloatArray, loop: Loop) -> None:
        self._extension = SampleFilter(sections)
        self._convolution = SampleConvolution(taps)
        self._friction = FrictionCompensation(loop.plant.handle, loop.plant.friction, loop.rate)
        self.friction_force = 0.0

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force after which the handle moves as desired."""
        force = self._convolution.sample(self._extension.sample(desired_acceleration))
        self.friction_force = self._friction.force(force, desired_acceleration)
        return force + self.friction_force

    def reset(self) -> None:
        """Clear the filters."""
        self._extension.reset()
        self._convolution.reset()
        self._friction.reset()
        self.friction_force = 0.0

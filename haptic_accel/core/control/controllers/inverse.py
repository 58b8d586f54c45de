# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse of the complete identified handle, including hold, delay, mount and sensor."""

from __future__ import annotations

from dataclasses import dataclass, field

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.inversion import design
from haptic_accel.core.control.inversion.spectrum import TexturePrior
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick.control import ExcursionControl, FrictionCompensation, InverseForce


@dataclass(frozen=True)
class InverseParameters(Checked):
    """Delay and texture for the design of the inverse."""

    granted_time: float = parameter(
        design.GRANTED_TIME,
        "allowed delay of the handle behind the tool in addition to the latency, rounded to"
        " samples, at least one (paper: one at 1 kHz)",
        unit="s",
        low=0.0,
        high=design.LONGEST_GRANTED_TIME,
    )
    texture: TexturePrior = field(default_factory=TexturePrior)
    memory: float = parameter(
        design.CONVOLUTION_LENGTH, "length of the controller's impulse response", "s", 0.05, 0.4
    )

    def filter(self, loop: Loop) -> design.InverseFilter:
        """Return the inverse without travel reduction for a loop; takes a fraction of a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        return design.design_inverse(loop.plant, loop.rate, self.goal(loop))

    def granted_delay(self, rate: float) -> int:
        """Return the granted delay at a rate in Hz, in samples."""
        return design.granted_samples(self.granted_time, rate)

    def goal(self, loop: Loop) -> design.Goal:
        """Return the design goal of the inverse, or of a family of inverses."""
        granted = loop.latency + self.granted_delay(loop.rate)
        corner = loop.high_pass_frequency
        return design.Goal(granted, self.memory, spectrum=self.texture, high_pass_frequency=corner)


class InverseController(InverseForce, Controller):
    """Causal inverse of eq. (3), hold, delay, mount and sensor, from a_hdes to f_a.

    Attributes
    ----------
    response : callable
        Force over desired acceleration, N per m/s^2, at frequencies in Hz.
    """

    Parameters = InverseParameters
    reducible = True

    def __init__(self, parameters: InverseParameters, loop: Loop) -> None:
        goal = parameters.goal(loop)
        bank = design.design_bank(loop.plant, loop.rate, goal)
        self.response = design.InverseFilter(bank.sections, bank.taps[0], loop.rate, goal).response
        self._invert_by(bank, parameters, loop)

    def _invert_by(
        self, bank: design.InverseBank, parameters: InverseParameters, loop: Loop
    ) -> None:
        plant = loop.plant
        self._bank = bank
        limit = loop.travel_limit
        excursion = ExcursionControl(bank.taps, bank.motion, plant.handle, limit, loop.rate)
        # A force acts in the period before the sample that shows its effect.
        lag = parameters.granted_delay(loop.rate) - 0.5 - plant.delay * loop.rate
        friction = FrictionCompensation(plant.handle, plant.friction, loop.rate, lag)
        InverseForce.__init__(self, bank.sections, excursion, friction)

    def reset(self) -> None:
        """Reset the filters."""
        self.extension.reset()
        self.excursion.restart(self._bank.taps)
        self.friction.reset()
        self.friction_force = 0.0

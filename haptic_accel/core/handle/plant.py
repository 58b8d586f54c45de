# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plant to be inverted: from a force at one tick to the handle's acceleration at later ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from haptic_accel.core.handle.discrete import DiscreteModel, read_discrete_model
from haptic_accel.core.handle.response import sampled_response
from haptic_accel.core.model import (
    AccelerometerParameters,
    ComplexArray,
    HandleParameters,
    MountParameters,
)
from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.core.sampling import check_latency


class Dynamics(Protocol):
    """Properties of a plant that a design needs."""

    @property
    def handle(self) -> HandleParameters:
        """Parameters of the handle, as far as known: for the actuator's travel."""

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz."""


@dataclass(frozen=True)
class Plant(Checked):
    """The handle of eq. (3) with everything between a command and a sample."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    mount: MountParameters = field(default_factory=MountParameters)
    delay: float = parameter(
        0.0,
        "delay from command to force in addition to the hold: converter, amplifier, transport",
        "s",
        0.0,
        0.02,
    )
    bandwidth: float = like(AccelerometerParameters, "bandwidth")
    friction: float = parameter(0.0, "dry friction of the actuator's bearing", "N", 0.0, 1.0)
    coupling: float = parameter(
        250.0,
        "stiffness of the coupling to the slave, which adds to that of the grip (paper)",
        "N/m",
        0.0,
        1e5,
    )
    model: str = parameter(
        "",
        "JSON file of an identification, whose discrete model gives the response in place of"
        " mount, delay and bandwidth; empty for none",
    )

    doubt: str = parameter(
        "",
        "known deficiency of this model, which the compensator reports as a warning;"
        " empty for none",
    )

    @property
    def latency(self) -> int:
        """Samples from the one that caused a force to the tick at which the force is due."""
        return 0

    def coupled(self) -> Plant:
        """Return the plant with the coupling as a part of the grip.

        The slave hardly moves at the frequencies that are felt, so that the coupling's spring is
        parallel to that of the grip.
        """
        handle = replace(self.handle, k_u=self.handle.k_u + self.coupling)
        return replace(self, handle=handle, coupling=0.0)

    def delayed(self, latency: int) -> DelayedPlant:
        """Return the plant of a loop whose forces are due so many samples after their cause.

        Raises
        ------
        ParameterError
            The latency is not allowed.
        """
        check_latency(latency)
        return DelayedPlant(**vars(self) | {"latency": latency})

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz.

        It begins one sample after the force. See `sampled_response`.

        Raises
        ------
        ParameterError
            The file of the model is not usable, or the model was identified at another rate.
        """
        if self.model:
            return IdentifiedPlant(_model(self.model), self.handle).response(frequency, rate)
        return sampled_response(
            self.handle, frequency, rate, self.delay, self.bandwidth, mount=self.mount
        )


@dataclass(frozen=True)
class DelayedPlant(Plant):
    """A plant in a loop whose forces are due some samples after their cause: `latency`."""

    latency: int = 0

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return the response of the plant, m/s^2 per N, one sample after the latency."""
        turns = np.asarray(frequency) * (self.latency / rate)
        return np.asarray(super().response(frequency, rate) * np.exp(-2j * np.pi * turns))


@lru_cache(maxsize=8)
def _model(path: str) -> DiscreteModel:
    return read_discrete_model(Path(path))


@dataclass(frozen=True)
class IdentifiedPlant:
    """A discrete model of the handle that was identified without its physics.

    Attributes
    ----------
    model : DiscreteModel
        Discrete model at the rate of the design.
    handle : HandleParameters
        Handle parameters, for the actuator's travel only, which the model does not contain.
    """

    model: DiscreteModel
    handle: HandleParameters = field(default_factory=HandleParameters)

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return the model's response, m/s^2 per N, at frequencies in Hz.

        Raises
        ------
        ParameterError
            The model was identified at another rate.
        """
        if rate != self.model.rate:
            raise ParameterError(
                f"rate = {rate:g}: must be that of the identified model, {self.model.rate:g} Hz"
            )
        return self.model.response(frequency)

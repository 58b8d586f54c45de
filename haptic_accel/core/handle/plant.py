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

"""Plant for controllers: from a force at one tick to the handle's acceleration at later ticks.

Its response is that of physical parameters, or of a discrete model written by an identification.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from haptic_accel.core.document import read_json_document
from haptic_accel.core.handle.response import sampled_response
from haptic_accel.core.model import (
    AccelerometerParameters,
    ComplexArray,
    FloatArray,
    HandleParameters,
    MountParameters,
)
from haptic_accel.core.parameters import Checked, ParameterError, Specification, like, parameter
from haptic_accel.core.sampling import check_latency


@dataclass(frozen=True)
class DiscreteModel:
    """Stable transfer function in z with a delay.

    Attributes
    ----------
    sections : ndarray, shape (n, 6)
        Second-order sections, rows b0 b1 b2 a0 a1 a2 with a0 = 1; from N to m/s^2.
    rate : float
        Samples per second.
    delay_samples : int
        Whole samples of delay before the sections.
    """

    sections: FloatArray
    rate: float
    delay_samples: int

    def response(self, frequency: npt.ArrayLike) -> ComplexArray:
        """Return the complex response at frequencies in Hz, m/s^2 per N."""
        z = np.exp(2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.rate)
        response = z**-self.delay_samples
        for section in self.sections:
            response = response * np.polyval(section[:3], z) / np.polyval(section[3:], z)
        return np.asarray(response)


def read_discrete_model(path: Path) -> DiscreteModel:
    """Read the discrete model from the metrics of an identification.

    Parameters
    ----------
    path : Path
        JSON file written by ``haptic-accel identify --json``.

    Raises
    ------
    ParameterError
        The file cannot be read, or contains no stable discrete model.
    """
    content = read_json_document(path).at("discrete_model")
    rate, delay = content.at("rate_hz").number(), content.at("delay_samples")
    sections = content.at("sections")
    rows = sections.array()
    formed = rows.ndim == 2 and rows.shape[1] == 6 and np.isfinite(rows).all()
    if not formed or np.any(rows[:, 3] != 1):
        sections.wrong("must be rows of six numbers, the fourth of them 1")
    if not all(np.abs(np.roots(row[3:])).max(initial=0.0) < 1.0 for row in rows):
        sections.wrong("must be stable")
    return DiscreteModel(rows, rate, delay.checked(1, Specification("delay", "", 0)))


class Dynamics(Protocol):
    """Interface of plants for the design of controllers."""

    @property
    def handle(self) -> HandleParameters:
        """Parameters of the handle, as far as known; used for the actuator's travel."""

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz."""


@dataclass(frozen=True)
class Plant(Checked):
    """Handle of eq. (3) with the complete path between command and sample."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    mount: MountParameters = field(default_factory=MountParameters)
    delay: float = parameter(
        0.0, "delay from command to force beside the hold: converter, transport", "s", 0.0, 0.02
    )
    bandwidth: float = like(AccelerometerParameters, "bandwidth")
    friction: float = parameter(0.0, "dry friction of the actuator's bearing", "N", 0.0, 1.0)
    coupling: float = parameter(
        250.0, "stiffness of the coupling to the slave, beside the grip's (paper)", "N/m", 0.0, 1e5
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
        """Delay from sample to force, in samples."""
        return 0

    def coupled(self) -> Plant:
        """Return the plant with the coupling's stiffness added to the grip's.

        The slave hardly moves at perceptible frequencies, so the springs of coupling and grip are
        parallel.
        """
        handle = replace(self.handle, k_u=self.handle.k_u + self.coupling)
        return replace(self, handle=handle, coupling=0.0)

    def delayed(self, latency: int) -> DelayedPlant:
        """Return the plant of a loop with a delay from sample to force, in samples.

        Raises
        ------
        ParameterError
            The latency is not allowed.
        """
        check_latency(latency)
        return DelayedPlant(**vars(self) | {"latency": latency})

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz.

        It starts one sample after the force; see `sampled_response`.

        Raises
        ------
        ParameterError
            The model's file is not usable, or the model was identified at another rate.
        """
        if self.model:
            return IdentifiedPlant(_model(self.model), self.handle).response(frequency, rate)
        return sampled_response(
            self.handle, frequency, rate, self.delay, self.bandwidth, mount=self.mount
        )


@dataclass(frozen=True)
class DelayedPlant(Plant):
    """Plant in a loop with a delay of `latency` samples from sample to force."""

    latency: int = 0

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return the response of the plant, m/s^2 per N, from one sample after the latency on."""
        turns = np.asarray(frequency) * (self.latency / rate)
        return np.asarray(super().response(frequency, rate) * np.exp(-2j * np.pi * turns))


@lru_cache(maxsize=8)
def _model(path: str) -> DiscreteModel:
    return read_discrete_model(Path(path))


@dataclass(frozen=True)
class IdentifiedPlant:
    """Discrete model of the handle, identified without a physical model.

    Attributes
    ----------
    model : DiscreteModel
        Discrete model at the rate of the design.
    handle : HandleParameters
        Handle parameters, used only for the actuator's travel, which is not part of the model.
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

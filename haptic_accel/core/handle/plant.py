# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plant for controllers: from a force at one tick to the handle's acceleration at later ticks.

Its response is that of physical parameters, or of a discrete model written by an identification.
A handle with three coils has a plant for each axis, and the coupling between them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from haptic_accel.core import parameters
from haptic_accel.core.axes import HIGHEST_CONDITION, NAMES
from haptic_accel.core.document import Document, read_json_document
from haptic_accel.core.handle.mechanics import sampled_response
from haptic_accel.core.model import (
    AccelerometerParameters,
    ComplexArray,
    FloatArray,
    HandleParameters,
    MountParameters,
)
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
    return DiscreteModel(rows, rate, delay.checked(1, parameters.Specification("delay", "", 0)))


class Dynamics(Protocol):
    """Interface of plants for the design of controllers."""

    @property
    def handle(self) -> HandleParameters:
        """Parameters of the handle, as far as known; used for the actuator's travel."""

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz."""


@dataclass(frozen=True)
class Plant(parameters.Checked):
    """Handle of eq. (3) with the complete path between command and sample."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    mount: MountParameters = field(default_factory=MountParameters)
    delay: float = parameters.parameter(
        0.0, "delay from command to force after the hold: converter, transport", "s", 0.0, 0.02
    )
    bandwidth: float = parameters.like(AccelerometerParameters, "bandwidth")
    friction: float = parameters.parameter(
        0.0, "dry friction of the actuator's bearing", "N", 0.0, 1.0
    )
    coupling: float = parameters.parameter(
        250.0, "coupling to the slave: stiffness in addition to the grip (paper)", "N/m", 0.0, 1e5
    )
    model: str = parameters.parameter(
        "",
        "JSON file of an identification, whose discrete model gives the response in place of"
        " mount, delay and bandwidth; empty for none",
    )

    doubt: str = parameters.parameter(
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
            raise parameters.ParameterError(
                f"rate = {rate:g}: must be that of the identified model, {self.model.rate:g} Hz"
            )
        return self.model.response(frequency)


THREE_AXES = "three_axes"
"""Key of a plant with three axes in the results of an identification."""


@dataclass(frozen=True, eq=False)
class MatrixPlant:
    """Response of a handle with three coils, G(f) = K(f) diag(p_x(f), p_y(f), p_z(f)).

    Column j of K is the acceleration in all axes relative to the acceleration that the plant p_j
    has along its own axis, when only coil j is driven. K is close to the directions of the coils,
    and causal without a delay of its own, as a coil's delay is part of its plant.

    Attributes
    ----------
    axes : tuple of Plant
        Plants of x, y and z.
    coupling : ndarray, shape (3, 3, n)
        Impulse responses of K at `rate`; the first index is the axis of the acceleration, the
        second that of the coil.
    rate : float
        Samples per second of the coupling.
    """

    axes: tuple[Plant, Plant, Plant]
    coupling: FloatArray
    rate: float

    @classmethod
    def uncoupled(cls, plant: Plant, rate: float) -> MatrixPlant:
        """Return a plant whose axes are equal and independent."""
        return cls((plant, plant, plant), np.eye(3)[:, :, np.newaxis], rate)

    @property
    def directions(self) -> FloatArray:
        """Static coupling, shape (3, 3): K at 0 Hz."""
        return np.asarray(self.coupling.sum(axis=2))

    @property
    def condition(self) -> float:
        """Condition number of the directions; see `HIGHEST_CONDITION`."""
        return float(np.linalg.cond(self.directions))

    def coupling_response(self, frequency: npt.ArrayLike) -> ComplexArray:
        """Return K at frequencies in Hz, shape (f, 3, 3)."""
        turns = np.outer(
            np.asarray(frequency, dtype=np.float64), np.arange(self.coupling.shape[2])
        )
        return np.moveaxis(self.coupling @ np.exp(-2j * np.pi / self.rate * turns).T, 2, 0)

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return G, sampled acceleration over held force, m/s^2 per N, shape (f, 3, 3).

        Parameters
        ----------
        frequency : array_like, shape (f,)
            Frequencies, Hz.
        rate : float
            Samples per second.

        Raises
        ------
        ParameterError
            The coupling was identified at another rate.
        """
        self.check_rate(rate)
        own = np.stack([plant.response(frequency, rate) for plant in self.axes], axis=-1)
        return np.asarray(self.coupling_response(frequency) * own[:, np.newaxis, :])

    def check_rate(self, rate: float) -> None:
        """Reject a rate other than that of the identification.

        Raises
        ------
        ParameterError
            The message contains both rates.
        """
        if rate != self.rate:
            raise parameters.ParameterError(
                f"rate = {rate:g}: must be that of the identified plant, {self.rate:g} Hz;"
                " run identify"
            )

    def coupled(self) -> MatrixPlant:
        """Return the plant with the coupling of the arms as part of the handle."""
        x, y, z = (plant.coupled() for plant in self.axes)
        return replace(self, axes=(x, y, z))

    def delayed(self, latency: int) -> MatrixPlant:
        """Return the plant of a loop with a delay from sample to force, in samples."""
        x, y, z = (plant.delayed(latency) for plant in self.axes)
        return replace(self, axes=(x, y, z))

    def as_document(self) -> dict[str, object]:
        """Return the content of `THREE_AXES` in a file of results, for `read_matrix_plant`."""
        return {
            "rate_hz": self.rate,
            "axes": {
                name: {key: value for key, value in asdict(plant).items() if key not in _FILES}
                for name, plant in zip(NAMES, self.axes, strict=True)
            },
            "coupling": self.coupling.tolist(),
        }


_FILES = ("model", "doubt")
"""Parameters of a plant that have no meaning for one axis of three."""


_NUMBERS = {
    name: each for name, each in parameters.own_schema(Plant).items() if name not in _FILES
}


def read_matrix_plant(path: Path) -> MatrixPlant:
    """Read the plant with three axes from the results of an identification.

    Parameters
    ----------
    path : Path
        JSON file written by ``haptic-accel identify`` for a handle with three coils.

    Raises
    ------
    ParameterError
        The file cannot be read, holds a handle with one axis, or coils whose directions are too
        close to a plane to be inverted.
    """
    results = read_json_document(path)
    if THREE_AXES not in results:
        results.refuse("holds a handle with one axis: must be an identification with three axes")
    content = results.at(THREE_AXES)
    axes = content.at("axes")
    x, y, z = (_axis(axes.at(name)) for name in NAMES)
    coupling = content.at("coupling")
    taps = coupling.array()
    if taps.ndim != 3 or taps.shape[:2] != (3, 3) or not np.isfinite(taps).all():
        coupling.wrong("must be three rows of three impulse responses of finite numbers")
    found = MatrixPlant((x, y, z), taps, content.at("rate_hz").number())
    if not found.condition <= HIGHEST_CONDITION:
        coupling.refuse(
            f"condition number {found.condition:.3g} of the coils' directions: must be at most"
            f" {HIGHEST_CONDITION:g}, or the axes cannot be driven independently"
        )
    return found


def _axis(content: Document) -> Plant:
    handle = content.at("handle").build(HandleParameters)
    mount = content.at("mount").build(MountParameters)
    own: dict[str, Any] = {
        key: content.at(key).number(each) for key, (_, each) in _NUMBERS.items()
    }
    return Plant(handle=handle, mount=mount, **own)

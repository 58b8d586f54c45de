"""What every controller has: parameters, one sample in and out, slow work between, a reset."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.control.inversion.plant import Plant
from haptic_accel.core.parameters import Checked


@dataclass(frozen=True)
class Loop:
    """What surrounds a controller.

    Attributes
    ----------
    rate : float
        Samples per second.
    high_pass_frequency : float
        Corner of the high-pass that the desired acceleration has passed, Hz.
    plant : Plant
        The handle as identified, and all between a command and a sample.
    """

    rate: float
    high_pass_frequency: float = HIGH_PASS_FREQUENCY
    plant: Plant = field(default_factory=Plant)


@dataclass(frozen=True)
class NoParameters(Checked):
    """The parameters of a controller that has none."""


class Controller(ABC):
    """Turns the desired handle acceleration into the actuator's force.

    A subclass names its parameter dataclass in `Parameters`; the compensator node declares
    the fields as ROS parameters below the controller's name.

    Parameters
    ----------
    parameters
        An instance of the class' `Parameters`.
    loop : Loop
    """

    Parameters: ClassVar[type[Checked]] = NoParameters

    @abstractmethod
    def __init__(self, parameters: Any, loop: Loop) -> None: ...

    @abstractmethod
    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Take one sample of desired and measured handle acceleration, give one force.

        Parameters
        ----------
        desired_acceleration : float
            High-passed tool acceleration, m/s^2.
        measured_acceleration : float
            The latest handle acceleration, m/s^2; NaN where it is stale or its sensor was at its
            range, and must not be used.

        Returns
        -------
        float
            Actuator force, N, before the actuator's limit.
        """

    def applied(self, actuator_force: float) -> None:  # noqa: B027 - most need not know
        """Hear which force, N, was sent at this sample in the end: limited, or another's."""

    def adapt(self) -> None:  # noqa: B027 - most have none
        """Do a piece of slow work, in time that no force waits for: tens of microseconds."""

    def freeze(self, frozen: bool) -> None:  # noqa: B027 - most have nothing to
        """Stop adapting, or go on."""

    def status(self) -> dict[str, str]:
        """Return what is worth showing in diagnostics, by name with unit."""
        return {}

    @property
    def warning(self) -> str:
        """What is wrong, empty if all is well."""
        return ""

    @abstractmethod
    def reset(self) -> None:
        """Return to the state of a controller that has always seen zero."""

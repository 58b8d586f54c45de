"""What every controller has: parameters, one sample in and out, a reset."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from haptic_accel.core.parameters import Checked


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
    rate : float
        Samples per second.
    """

    Parameters: ClassVar[type[Checked]] = NoParameters

    @abstractmethod
    def __init__(self, parameters: Any, rate: float) -> None: ...

    @abstractmethod
    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Take one sample of desired and measured handle acceleration, give one force.

        Parameters
        ----------
        desired_acceleration : float
            High-passed tool acceleration, m/s^2.
        measured_acceleration : float
            The latest handle acceleration, m/s^2.

        Returns
        -------
        float
            Actuator force, N, before the actuator's limit.
        """

    @abstractmethod
    def reset(self) -> None:
        """Return to the state of a controller that has always seen zero."""

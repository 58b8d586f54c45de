"""What every device has: parameters, open, read, write, close."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from haptic_accel.core.model import Sample, Vector

__all__ = ["Device", "DeviceError", "Sample"]


class DeviceError(RuntimeError):
    """A device cannot be opened or does not answer; the message is one line fit to be shown."""


class Device(ABC):
    """An arm with an accelerometer, and at the master an actuator in the handle.

    A subclass names its parameter dataclass in `Parameters`; the device nodes declare its
    fields as ROS parameters below the device's name. Times are seconds on the caller's
    clock, from any origin and never backwards; a device with a clock of its own may ignore
    them.

    Parameters
    ----------
    parameters
        An instance of the class' `Parameters`.
    rate : float
        Samples per second at which it will be read.
    seed : int
        For what is random in it, if anything is.
    """

    Parameters: ClassVar[type]

    CHANGEABLE: ClassVar[tuple[str, ...]] = ()
    """Dotted names of the parameters that `change` takes."""

    @abstractmethod
    def __init__(self, parameters: Any, rate: float, seed: int) -> None: ...

    @abstractmethod
    def open(self) -> None:
        """Get ready to be read and written, with zero force.

        Raises
        ------
        DeviceError
            It cannot be opened.
        """

    @abstractmethod
    def read(self, time: float) -> Sample | None:
        """Return the sample of an instant, None where there is none: unplugged, not yet heard.

        Parameters
        ----------
        time : float
            The instant the sample is for: a tick of the caller's rate, now or just past.

        Raises
        ------
        DeviceError
            It does not answer.
        """

    @abstractmethod
    def write(
        self,
        time: float,
        *,
        arm_force: Vector | None = None,
        actuator_force: float | None = None,
    ) -> None:
        """Apply forces at once; what is not given stays as it is.

        Parameters
        ----------
        time : float
            Now.
        arm_force : tuple of float, optional
            Force of the arm's motors in its base frame, N.
        actuator_force : float, optional
            Force of the handle's actuator, N; a slave has none and ignores it.

        Raises
        ------
        DeviceError
            It does not answer.
        """

    def change(self, parameters: Any) -> None:
        """Go on with other parameters; motion and forces stay as they are.

        Parameters
        ----------
        parameters
            An instance of the class' `Parameters` that differs in `CHANGEABLE` only.

        Raises
        ------
        ParameterError
            They cannot be taken now; nothing has changed.
        """
        raise NotImplementedError(f"{type(self).__name__} names no CHANGEABLE parameter")

    def arm(self) -> bool | None:
        """Allow forces again after the device itself refused them; `problem` says whether it does.

        Returns
        -------
        bool or None
            Whether it could; None where that takes a while to tell.
        """
        return True

    @abstractmethod
    def close(self) -> None:
        """Leave the device with zero force, also when it was never opened."""

    @property
    def remark(self) -> str:
        """What is worth telling once it is open; empty for nothing."""
        return ""

    @property
    def problem(self) -> str:
        """Why there are no samples or no forces, in one line; empty if all is well."""
        return ""

    @property
    def ended(self) -> bool:
        """Whether it has come to its end, and the graph with it: a recording that is over."""
        return False

    def status(self) -> dict[str, int]:
        """Return counts worth showing in diagnostics, by name."""
        return {}

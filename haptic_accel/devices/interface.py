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

"""Interface of all devices: parameters, open, read, write, close."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar

from haptic_accel.core.model import LATER, Reading, Sample, Vector
from haptic_accel.core.parameters import Checked

__all__ = ["LATER", "Device", "DeviceDescription", "DeviceError", "Joints", "Reading", "Sample"]

D = TypeVar("D", bound="Device")


class Joints(NamedTuple):
    """State of an arm's joints: rad, rad/s and N m, or m, m/s and N of prismatic ones."""

    names: Sequence[str]
    positions: Sequence[float]
    velocities: Sequence[float]
    efforts: Sequence[float]


class DeviceError(RuntimeError):
    """Failure to open a device or to get an answer; the message is one line fit to be shown."""


@dataclass(frozen=True)
class NoParameters(Checked):
    """No parameters."""


@dataclass(frozen=True)
class DeviceDescription:
    """Properties of a class of devices that the graph needs before it builds one.

    Attributes
    ----------
    parameters_of : tuple of str
        Names of the devices whose parameters it has in place of own ones, in the order in which
        it is built with them.
    changeable : tuple of str
        Dotted names of the parameters that `Device.change` accepts, own ones or those of the
        first in `parameters_of`.
    ahead : bool
        `Device.write` accepts an actuator force ahead of its due time; the device applies it then
        by its own clock.
    pointed : bool
        It has a simulated hand that `Device.point` leads.
    """

    parameters_of: tuple[str, ...] = ()
    changeable: tuple[str, ...] = ()
    ahead: bool = False
    pointed: bool = False

    def owners(self, name: str) -> tuple[str, ...]:
        """Return the names of the devices whose parameters a device of a name has."""
        return self.parameters_of or (name,)


class Device(ABC):
    """Arm with an accelerometer, and at the master an actuator in the handle.

    A subclass names its parameter dataclass in `Parameters`, if it has parameters; the device
    nodes declare its fields as ROS parameters below the device's name. Where the defaults of
    `DeviceDescription` do not hold, it has a `description` of its own. Times are seconds on the
    caller's clock, from any origin and never backwards; a device with a clock of its own may
    ignore them.

    Parameters
    ----------
    parameters
        An instance of the class' `Parameters`, or one for each name in `parameters_of` of its
        description.
    rate : float
        Rate at which it will be read, Hz.
    seed : int
        Seed of its random numbers, if it has any.
    """

    Parameters: ClassVar[type] = NoParameters

    description: ClassVar[DeviceDescription] = DeviceDescription()

    parts: Sequence[Device] = ()
    """Devices that it is made of, its arm first: their joints, remarks, warnings and problems are
    its own, and it arms them all."""

    @abstractmethod
    def __init__(self, parameters: Any, rate: float, seed: int) -> None: ...

    @classmethod
    def from_options(
        cls: type[D], name: str, options: Mapping[str, Any], rate: float, seed: int
    ) -> D:
        """Build the device of a name with its part of the parameters of all devices, by name.

        Parameters
        ----------
        name : str
        options : mapping
            Parameters by device.
        rate : float
        seed : int
        """
        own = [options[each] for each in cls.description.owners(name)]
        return cls(*[*own, rate, seed])

    @abstractmethod
    def open(self) -> None:
        """Get ready to be read and written, with zero force.

        Raises
        ------
        DeviceError
            The device cannot be opened.
        """

    @abstractmethod
    def read(self, time: float) -> Reading:
        """Return the sample of a tick.

        Called for each tick of the sampling grid in turn, again after the answer `LATER`; a
        caller that was held up asks for the ticks of that time too, and one that does not wait
        any longer goes on to the next tick.

        Parameters
        ----------
        time : float
            Time of the tick, now or past.

        Returns
        -------
        Sample, LATER or None
            `LATER` while the sample may still come; None if there is none: unplugged, lost, or
            the device keeps no samples of ticks that have passed.

        Raises
        ------
        DeviceError
            The device does not answer.
        """

    @abstractmethod
    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: float | None = None
    ) -> None:
        """Apply forces; a force that is not given stays as it is.

        Parameters
        ----------
        time : float
            The tick read last at which the forces are due, or now for forces that come after
            it. Described as `ahead`, the time to come at which the actuator's force is due; one
            for a time that has passed acts at once, and discards those that are not due yet.
        arm_force : tuple of float, optional
            Force of the arm's motors in its base frame, N.
        actuator_force : float, optional
            Force of the handle's actuator, N; a slave has none and ignores it.

        Raises
        ------
        DeviceError
            The device does not answer.
        """

    def change(self, parameters: Any) -> None:
        """Change parameters in operation; motion and forces stay as they are.

        Parameters
        ----------
        parameters
            An instance of the class' `Parameters` that differs in `changeable` ones only.

        Raises
        ------
        ParameterError
            They cannot be changed now; nothing has changed.
        """
        raise NotImplementedError(f"{type(self).__name__} has no changeable parameter")

    def point(self, position: Vector) -> None:
        """Lead the simulated hand to a position in the arm's base frame, m."""
        raise NotImplementedError(f"{type(self).__name__} has no hand to lead")

    def arm(self) -> bool | None:
        """Allow forces again after the device itself refused them; `problem` shows the result.

        Returns
        -------
        bool or None
            True if it succeeded; None if that takes a while to find out.
        """
        answers = [part.arm() for part in self.parts]
        if False in answers:
            return False
        return None if None in answers else True

    @abstractmethod
    def close(self) -> None:
        """Leave the device with zero force, also when it was never opened."""

    def joints(self, sample: Sample, force: Vector) -> Joints:
        """Return the arm's joints at its last sample and force: three along x, y and z.

        Parameters
        ----------
        sample : Sample
        force : tuple of float
            Force of the arm's motors at that time, N.
        """
        if self.parts:
            return self.parts[0].joints(sample, force)
        return Joints(("x", "y", "z"), sample.position, sample.velocity, force)

    @property
    def contact_force(self) -> Vector | None:
        """Force of the surface on the tool at the last sample, N; None where it is not known."""
        return None

    @property
    def remark(self) -> str:
        """Remark for the log once it is open; empty for none."""
        return _joined(part.remark for part in self.parts)

    @property
    def hang_warning(self) -> str:
        """Warning that a force may outlast this process where it hangs; empty where none can."""
        return _joined(part.hang_warning for part in self.parts)

    @property
    def problem(self) -> str:
        """Reason why there are no samples or no forces, in one line; empty if there is none."""
        return _joined(part.problem for part in self.parts)

    @property
    def ended(self) -> bool:
        """True once it has ended, and the graph with it: the end of a recording."""
        return any(part.ended for part in self.parts)

    @property
    def late(self) -> int:
        """Number of forces that the device itself applied after their due time since opened.

        Forces that were given to `write` after their due time do not count.
        """
        return sum(part.late for part in self.parts)

    def counters(self) -> dict[str, int]:
        """Return counts for the diagnostics, by name."""
        return {}


def _joined(lines: Iterable[str]) -> str:
    """Return those of some lines that are not empty as one."""
    return "; ".join(filter(None, lines))

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interface of all devices: parameters, open, read, write, close; composite devices; connection.

A connection to hardware has a separate thread that reads, and reconnects after a loss.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar

from haptic_accel.core.axes import ACTUATOR_AXES, Axes, is_turned, to_base
from haptic_accel.core.model import LATER, Force, Reading, Sample, Vector
from haptic_accel.core.outside import OutsideError, guard, parameters_problem
from haptic_accel.core.parameters import Checked, ParameterError, schema

MASTERS_GROUP, SLAVES_GROUP = "haptic_accel.masters", "haptic_accel.slaves"
"""Groups of entry points: drivers of the master's and of the slave's arm."""


def driver_problem(kind: type[Device], known: Mapping[str, type[Device]]) -> str:
    """Return the reason to refuse a class as a driver; empty for a driver."""
    described, parameters = kind.description, kind.Parameters
    if not isinstance(described, DeviceDescription):
        return "description must be a DeviceDescription"
    own = {name: each for name, each in known.items() if not each.description.parameters_of}
    for name in described.parameters_of:
        if name not in own:
            return f"description.parameters_of: {name}: must be one of {', '.join(own)}"
    if described.parameters_of:
        parameters = own[described.parameters_of[0]].Parameters
    if problem := parameters_problem(parameters):
        return problem
    names = schema(parameters)
    for name in described.changeable:
        if name not in names:
            return f"description.changeable: {name}: must be one of {', '.join(names)}"
    return ""


__all__ = ["LATER", "Device", "DeviceDescription", "DeviceError", "Joints", "Reading", "Sample"]

D = TypeVar("D", bound="Device")


class Joints(NamedTuple):
    """State of an arm's joints in rad, rad/s and N m, or in m, m/s and N if prismatic."""

    names: Sequence[str]
    positions: Sequence[float]
    velocities: Sequence[float]
    efforts: Sequence[float]


class DeviceError(RuntimeError):
    """Error: a device cannot be opened or does not answer; the message is one line."""


@dataclass(frozen=True)
class NoParameters(Checked):
    """No parameters."""


@dataclass(frozen=True)
class DeviceDescription:
    """Properties of a device class that the graph needs before building a device.

    Attributes
    ----------
    parameters_of : tuple of str
        Names of the devices whose parameters replace those of the class, in the order of the
        constructor's arguments.
    changeable : tuple of str
        Dotted names of the parameters that `Device.change` accepts, of the class or of the first
        device in `parameters_of`.
    ahead : bool
        True if `Device.write` accepts an actuator force ahead of its due time, which the device
        applies on time by its clock.
    framed : bool
        True if `Device.write` accepts all forces ahead of their due time, and the device applies
        them at that time on the clock of `Device.read`. Samples of several ticks can then be read
        together.
    pointed : bool
        True if `Device.point` moves a simulated hand.
    """

    parameters_of: tuple[str, ...] = ()
    changeable: tuple[str, ...] = ()
    ahead: bool = False
    framed: bool = False
    pointed: bool = False

    def owners(self, name: str) -> tuple[str, ...]:
        """Return the names of the devices whose parameters a device uses."""
        return self.parameters_of or (name,)

    def changeable_of(self, name: str) -> frozenset[str]:
        """Return the parameters of a device that may change in operation, by name with owner."""
        return frozenset(f"{self.owners(name)[0]}.{field}" for field in self.changeable)


class Device(ABC):
    """Arm with an accelerometer, and at the master an actuator in the handle.

    A subclass names its parameter dataclass, if any, in `Parameters`; the device nodes declare the
    fields as ROS parameters below the device's name. A subclass that differs from the defaults of
    `DeviceDescription` sets `description`. Times are seconds on the caller's clock, from any
    origin, never decreasing; a device with its own clock may ignore times.

    Parameters
    ----------
    parameters
        An instance of `Parameters`, or an instance for each name in `parameters_of` of the
        description.
    rate : float
        Rate of reading, Hz.
    seed : int
        Seed of random numbers, if any are used.
    """

    Parameters: ClassVar[type] = NoParameters

    description: ClassVar[DeviceDescription] = DeviceDescription()

    axes: Axes = ACTUATOR_AXES
    """Axes along which the device measures vibration and drives an actuator."""

    parts: Sequence[Device] = ()
    """Component devices, the arm first; their joints, remarks, warnings and problems are those of
    this device, which arms all of them."""

    @abstractmethod
    def __init__(self, parameters: Any, rate: float, seed: int) -> None: ...

    @classmethod
    def from_options(
        cls: type[D], name: str, options: Mapping[str, Any], rate: float, seed: int
    ) -> D:
        """Build a device by name, with its parameters from those of all devices.

        Parameters
        ----------
        name : str
        options : mapping
            Parameters by device.
        rate : float
        seed : int

        Raises
        ------
        DeviceError
            A library is missing, or a device of another package cannot be built.
        """
        own = [options[each] for each in cls.description.owners(name)]
        try:
            with guard(cls.__module__, passing=(DeviceError, ParameterError, OSError)):
                return cls(*[*own, rate, seed])
        except OutsideError as error:
            raise DeviceError(str(error)) from None

    @abstractmethod
    def open(self) -> None:
        """Prepare for reads and writes, with zero force.

        Raises
        ------
        DeviceError
            The device cannot be opened.
        """

    @abstractmethod
    def read(self, time: float) -> Reading:
        """Return the sample of a tick.

        The method is called for each tick of the sampling grid in order, and again after `LATER`.
        A delayed caller also requests past ticks; a caller that stops waiting continues with the
        next tick.

        Parameters
        ----------
        time : float
            Time of the tick, now or past.

        Returns
        -------
        Sample, LATER or None
            `LATER` while the sample may still arrive; None if the device is unplugged, or the
            sample is lost or too old to be kept.

        Raises
        ------
        DeviceError
            The device does not answer.
        """

    @abstractmethod
    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Apply forces; an omitted force remains unchanged.

        Parameters
        ----------
        time : float
            Due time of the forces: the last tick read, or now for later forces. With `ahead`: due
            time of the actuator's force, which may be in the future; an overdue force acts at
            once, and discards forces that are not due yet.
        arm_force : tuple of float, optional
            Force of the arm's motors in its base frame, N.
        actuator_force : tuple of float, optional
            Forces of the actuator's coils along x, y, z of the handle, N; a slave ignores it.

        Raises
        ------
        DeviceError
            The device does not answer.
        """

    def change(self, parameters: Any) -> None:
        """Change parameters in operation; motion and forces remain.

        Parameters
        ----------
        parameters
            An instance of the class' `Parameters`, with changes in `changeable` only.

        Raises
        ------
        ParameterError
            No change is allowed now; nothing has changed.
        """
        if not self.parts:
            raise NotImplementedError(f"{type(self).__name__} has no changeable parameter")
        self.parts[0].change(parameters)

    def point(self, position: Vector) -> None:
        """Move the simulated hand to a position in the arm's base frame, m."""
        if not self.parts:
            raise NotImplementedError(f"{type(self).__name__} has no hand to lead")
        self.parts[0].point(position)

    def arm(self) -> bool | None:
        """Allow forces again after the device refused forces; `problem` shows the result.

        Returns
        -------
        bool or None
            True on success; None if the result takes a while.
        """
        answers = [part.arm() for part in self.parts]
        if False in answers:
            return False
        return None if None in answers else True

    @abstractmethod
    def close(self) -> None:
        """Leave the device with zero force, even if never opened."""

    def joints(self, sample: Sample, force: Vector) -> Joints:
        """Return the joints at the last sample and force; default: prismatic joints along x, y, z.

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
        """Force of the surface on the tool at the last sample, N; None if unknown."""
        return None

    @property
    def remark(self) -> str:
        """Remark for the log after opening; empty for none."""
        return _joined(part.remark for part in self.parts)

    @property
    def hang_warning(self) -> str:
        """Warning that a force may persist if this process hangs; empty if it cannot."""
        return _joined(part.hang_warning for part in self.parts)

    @property
    def problem(self) -> str:
        """One-line reason for missing samples or forces; empty if none."""
        return _joined(part.problem for part in self.parts)

    @property
    def ended(self) -> bool:
        """True once a replay has ended, which also ends the graph."""
        return any(part.ended for part in self.parts)

    @property
    def late(self) -> int:
        """Number of forces that the device applied after their due time, since opening.

        Forces passed to `write` after their due time do not count.
        """
        return sum(part.late for part in self.parts)

    @property
    def interruptions(self) -> int:
        """Number of times that samples or forces were lost, or their clock stepped, since opening.

        Near each interruption, samples do not correspond to forces.
        """
        return sum(part.interruptions for part in self.parts)

    def counters(self) -> dict[str, int]:
        """Return counts for the diagnostics, by name."""
        return {}


def _joined(lines: Iterable[str]) -> str:
    """Return the non-empty lines, joined into one line."""
    return "; ".join(filter(None, lines))


class CompositeDevice(Device):
    """Device with `parts`; opening succeeds for all of them or for none.

    A subclass opens and closes everything else in `_open_own` and `_close_own`.
    """

    def open(self) -> None:
        """Open the parts in order, then everything else; on failure, close all."""
        with ExitStack() as opened:
            opened.callback(self.close)
            for part in self.parts:
                part.open()
            self._open_own()
            opened.pop_all()

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Pass forces to the arm."""
        self.parts[0].write(time, arm_force=arm_force, actuator_force=actuator_force)

    def close(self) -> None:
        """Close everything else, then the parts, without force, even if any of them fails."""
        with ExitStack() as closing:
            for part in self.parts:
                closing.callback(part.close)
            closing.callback(self._close_own)

    def _open_own(self) -> None:
        """Open everything except the parts."""

    def _close_own(self) -> None:
        """Close everything except the parts, even if never opened."""


class CombinedDevice(CompositeDevice):
    """Arm that measures position and velocity, with a handle or tool for acceleration.

    A subclass specifies both classes.

    Parameters
    ----------
    arm, handle
        Parameters of arm and handle.
    rate : float
    seed : int
    """

    ArmDevice: ClassVar[type[Device]]
    HandleDevice: ClassVar[type[Device]]

    def __init__(self, arm: Any, handle: Any, rate: float, seed: int) -> None:
        self._arm = self.ArmDevice(arm, rate, seed)
        self._handle = self.HandleDevice(handle, rate, seed)
        self.parts = self._arm, self._handle
        self.axes = self._handle.axes

    def read(self, time: float) -> Reading:
        """Return the arm's motion and the handle's acceleration; None if either is missing."""
        motion = self._arm.read(time)
        if motion is LATER:
            return LATER
        # Read the handle after the arm, as a handle returns each sample only once.
        vibration = self._handle.read(time)
        if vibration is LATER:
            return LATER
        if motion is None or vibration is None:
            return None
        return motion._replace(acceleration=vibration.acceleration)

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Write each force to its device, the actuator's first."""
        if actuator_force is not None:
            self._handle.write(time, actuator_force=actuator_force)
        if arm_force is not None:
            self._arm.write(time, arm_force=arm_force)

    def counters(self) -> dict[str, int]:
        """Return the counts of arm and handle, with the part's name as prefix."""
        return {
            f"{part}_{name}": count
            for part, device in zip(("arm", "handle"), self.parts, strict=True)
            for name, count in device.counters().items()
        }


def in_base_axes(reading: Reading) -> Reading:
    """Rotate the acceleration of a sample from the tool's axes to those of the arm's base."""
    if isinstance(reading, Sample) and is_turned(reading.orientation, reading.acceleration):
        return reading._replace(acceleration=to_base(reading.orientation, reading.acceleration))
    return reading


class CombinedTool(CombinedDevice):
    """Arm with a tool, whose acceleration is rotated to the axes of the arm's base."""

    def read(self, time: float) -> Reading:
        """Return the arm's motion and the tool's acceleration in the axes of the arm's base."""
        return in_base_axes(super().read(time))


def combined(
    devices: Mapping[str, type[Device]],
    arm: str,
    handle: str,
    kind: type[CombinedDevice] = CombinedDevice,
) -> type[CombinedDevice]:
    """Return a device class with the arm of one device, and the handle or tool of another.

    The class has the parameters of both devices.

    Parameters
    ----------
    devices : mapping
        Device classes by name.
    arm, handle : str
        Device names.
    kind : type
        `CombinedTool` for a slave.
    """
    parts = {"ArmDevice": devices[arm], "HandleDevice": devices[handle]}
    name = "".join(part.__name__ for part in parts.values())
    described = DeviceDescription((arm, handle), ahead=devices[handle].description.ahead)
    return type(name, (kind,), {**parts, "description": described})


RETRY = 0.2
"""Time between attempts to connect again, s."""

JOIN_TIMEOUT = 5.0
"""Longest time for a driver to return from connecting or reading, s."""

AUTO, MANUAL = "auto", "manual"
"""Values of the parameter `rearm`: forces after a lost connection are allowed automatically or by
a user."""


class Connection(ABC):
    """Base of connections to hardware.

    A subclass connects, receives and disconnects. Its methods raise `DeviceError` when the
    hardware is gone; the thread then disconnects and retries to connect.

    Attributes
    ----------
    connected : bool
        True from a successful `_connect` until `_disconnect`.
    problem : str
        Reason for a missing connection, in one line; empty while connected.
    losses, reconnects : int
        Numbers of lost and restored connections.
    """

    def __init__(self) -> None:
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.connected = False
        self.problem = ""
        self.losses = self.reconnects = 0

    def open(self) -> None:
        """Connect, and stay connected from now on.

        Raises
        ------
        DeviceError
            The connection cannot be made.
        """
        self._closing.clear()
        try:
            self._connect()
        except DeviceError:
            self._disconnect()
            raise
        self.problem = ""
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the hardware without force; may be called even if never opened."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(JOIN_TIMEOUT)
            self._thread = None
        if self.connected:
            self._release()
        self._disconnect()

    @abstractmethod
    def _connect(self) -> None:
        """Make the connection or raise `DeviceError`."""

    @abstractmethod
    def _receive(self) -> None:
        """Wait a short time for data and process it; raise `DeviceError` if the link is lost."""

    @abstractmethod
    def _release(self) -> None:
        """Remove all forces, as far as the hardware still answers."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Close a connection, even if `_connect` only succeeded in part."""

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                if not self.connected:
                    self._connect()
                    self.reconnects += 1
                    self.problem = ""
                self._receive()
            except DeviceError as error:
                self.losses += self.connected
                self.problem = str(error)
                self._disconnect()
                self._closing.wait(RETRY)


def explained(error: BaseException, reasons: Mapping[int, str]) -> str:
    """Return the explanation of an error by its errno; empty if unknown.

    Parameters
    ----------
    error : BaseException
        Error whose causes are searched as well.
    reasons : mapping
        Explanations by number, as in the module `errno`.
    """
    cause: BaseException | None = error
    while cause is not None:
        if (number := getattr(cause, "errno", None) or 0) in reasons:
            return reasons[number]
        cause = cause.__cause__ or cause.__context__
    return ""

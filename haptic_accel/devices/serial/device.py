# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices `serial`: an accelerometer and, at the master, voice coils, without an arm."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ALL_AXES, NAMES, Axes, Mounting, read_mounting, read_numbers
from haptic_accel.core.model import ZERO, Force, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.devices import interface
from haptic_accel.devices.interface import AUTO, MANUAL

if TYPE_CHECKING:
    from haptic_accel.devices.serial.protocol import Samples

# pyserial and cobs are an extra of the package, needed only to open a port.

MISSING_LIBRARY = "needs pyserial and cobs: pip install 'haptic_accel[serial]'"

HIGHEST_BOARD_RATE = 10_000
"""Highest sampling rate of the protocol, Hz."""

MOST_WAITING = 4096
"""Maximum number of samples stored between two reads."""

LONGEST_HELD = 10
"""Maximum number of ticks for which a sample at another rate is held."""


@dataclass(frozen=True)
class CalibrationParameters(Checked):
    """Calibration of the accelerometer, as determined by `haptic-accel calibrate`."""

    axis: str = parameter(
        "z",
        "axis of the accelerometer along the actuator of a device with one axis; without effect"
        " where there is a mounting",
        choices=("x", "y", "z"),
    )
    offset: float = parameter(
        0.0, "reading of this axis without acceleration", "counts", low=-(2.0**15), high=2.0**15
    )
    gain: float = parameter(
        0.0,
        "acceleration per count of this axis, negative where it is mounted upside down; 0 for the"
        " board's nominal one",
        unit="m/s^2",
        low=-10.0,
        high=10.0,
    )
    offsets: str = parameter(
        "",
        "readings of the accelerometer's axes x, y, z without acceleration, where several are"
        " used: three numbers; empty for 0",
        "counts",
    )
    gains: str = parameter(
        "",
        "accelerations per count of the accelerometer's axes x, y, z, where several are used:"
        " three numbers; empty for the board's nominal one",
        "m/s^2",
    )
    mounting: str = parameter(
        "",
        "directions of the accelerometer's axes x, y, z in the frame of handle or tool: three rows"
        " of three numbers, separated by commas or spaces; empty for aligned axes",
    )
    board: str = parameter("", "serial number of the calibrated board; empty for any")


@dataclass(frozen=True)
class PortParameters(Checked):
    """Serial port of a board."""

    port: str = parameter("", "path of the serial port, such as /dev/ttyACM0")
    usb_serial: str = parameter("", "USB serial number of the board, in place of a path")


@dataclass(frozen=True)
class SerialSlaveParameters(PortParameters):
    """Board with an accelerometer."""

    rate: int = parameter(
        0,
        "sampling rate of the board; 0 for that of the graph, at which it samples on the graph's"
        " grid",
        unit="Hz",
        low=0,
        high=HIGHEST_BOARD_RATE,
    )
    samples_per_frame: int = parameter(
        1, "number of samples that the board sends together", low=1, high=64
    )
    axes: str = parameter("z", "axes of accelerometer and coils, such as x, y, z")
    calibration: CalibrationParameters = field(default_factory=CalibrationParameters)


@dataclass(frozen=True)
class SerialMasterParameters(SerialSlaveParameters):
    """Board with an accelerometer and an actuator."""

    rearm: str = parameter(
        MANUAL,
        "re-arming after the board was unplugged: auto (once it is back) or manual (on request)",
        choices=(AUTO, MANUAL),
    )
    coil_mounting: str = parameter(
        "",
        "directions of the coils x, y, z in the handle's frame: three rows of three numbers;"
        " empty for the axes, or for coils whose directions are identified",
    )
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)


class SerialDevice(interface.Device):
    """Accelerometer of a board; position and velocity are zero, there is no arm.

    The caller's clock must be `time.monotonic`. At the graph's rate, the board samples on the
    graph's grid (multiples of the period on that clock), and each tick gets the sample taken for
    it. At another rate, a tick gets the newest sample; without a new sample since the last tick,
    the old sample is held for a while, and counted. Reading never waits for the port, which a
    separate thread reads.
    """

    # Without an arm, there is no other force.
    description = interface.DeviceDescription(framed=True)

    def __init__(self, parameters: SerialSlaveParameters, rate: float, seed: int) -> None:
        p = self._parameters = parameters
        if bool(p.port) == bool(p.usb_serial):
            raise ParameterError(
                f"serial.port = {p.port!r}: must be the path of a port, or serial.usb_serial a"
                " number, and not both"
            )
        try:
            from haptic_accel.devices.serial.link import BoardLink, Requirements
            from haptic_accel.devices.serial.protocol import Configuration, axes_bits
        except ImportError:
            raise interface.DeviceError(f"serial: {MISSING_LIBRARY}") from None
        self.axes = Axes.parsed(p.axes)
        self._sensor = Sensor(p.calibration, self.axes)
        self._configuration = Configuration(
            p.rate or round(rate), axes_bits(self._sensor.names), p.samples_per_frame
        )
        self._half_period = 0.5 / rate
        self._on_grid = self._configuration.rate == round(rate)
        required = Requirements(
            p.port,
            p.usb_serial,
            self._configuration,
            serial_number=p.calibration.board,
            grid_rate=rate if self._on_grid else 0.0,
        )
        self._actuator: ActuatorParameters | None = None
        self._coils: Mounting | None = None
        if isinstance(p, SerialMasterParameters):
            self._actuator = p.actuator
            self._coils = read_mounting("serial.coil_mounting", p.coil_mounting, self.axes)
            required = replace(required, coils=self.axes.names, rearm=p.rearm == AUTO)
        self._link = BoardLink(required, self._take)
        self._waiting: deque[tuple[float, Vector]] = deque(maxlen=MOST_WAITING)
        self._longest_held = LONGEST_HELD / rate
        self._held: interface.Sample | None = None
        self._held_since = 0.0
        self._counts = Counter(
            samples_missing=0, samples_skipped=0, samples_overflowed=0, samples_held=0
        )

    def open(self) -> None:
        """Connect to the board, and start sampling."""
        self._waiting.clear()
        self._held = None
        self._link.open()

    def read(self, time: float) -> interface.Reading:
        """Return a tick's sample; for a board of another rate, the newest sample by then.

        Until the board samples on the grid, a tick gets the sample nearest to it.
        """
        return self._sample_of(time) if self._on_grid else self._newest(time)

    def _sample_of(self, tick: float) -> interface.Reading:
        """Return the sample within half a period of a tick; remove earlier samples."""
        waiting, aligned = self._waiting, self._link.aligned
        while waiting and waiting[0][0] < tick - self._half_period:
            waiting.popleft()
            self._counts["samples_skipped"] += aligned
        if not waiting:
            return interface.LATER if self._link.connected else None
        if waiting[0][0] > tick + self._half_period:
            self._counts["samples_missing"] += aligned
            return None
        return interface.Sample(ZERO, ZERO, waiting.popleft()[1])

    def _newest(self, time: float) -> interface.Sample | None:
        """Return the newest sample at a time; None if it is too old to be held."""
        newest = None
        while self._waiting and self._waiting[0][0] <= time:
            newest = self._waiting.popleft()
        if newest is not None:
            self._held_since, acceleration = newest
            self._held = interface.Sample(ZERO, ZERO, acceleration)
        elif self._held is not None:
            if time - self._held_since > self._longest_held:
                self._held = None
            else:
                self._counts["samples_held"] += 1
        return self._held

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Send current set-points, zero for a force that is not finite.

        The board applies a set-point in the tick of its time. An overdue set-point acts at once,
        and discards set-points not due yet. After 5 ms without set-points the board switches the
        current off. There is no arm; without an actuator nothing is sent.
        """
        if actuator_force is not None and self._actuator:
            force = self._coils.coil_forces(actuator_force) if self._coils else actuator_force
            x, y, z = (each / self._actuator.force_constant for each in force)
            self._link.set_currents((x, y, z), time)

    def close(self) -> None:
        """Leave the board without current and without samples."""
        self._link.close()

    @property
    def remark(self) -> str:
        """Serial number and firmware of the board, sampling rate and calibration."""
        identity = self._link.identity
        if identity is None:
            return ""
        firmware = ".".join(map(str, identity.firmware))
        calibrated = "calibrated" if self._sensor.calibrated else "not calibrated"
        return (
            f"board {identity.serial_number}, firmware {firmware}, {self._configuration.rate}"
            f" samples per second, {calibrated}"
        )

    @property
    def problem(self) -> str:
        """One-line reason for missing samples or forces; empty if none."""
        return self._link.refusal

    @property
    def late(self) -> int:
        """Number of set-points that reached the board after their due tick."""
        return self._link.late

    def counters(self) -> dict[str, int]:
        """Return counts of the link, of unused samples, and of ticks without a sample."""
        return {**self._counts, **self._link.counters()}

    def _take(self, times: Sequence[float], samples: Samples) -> None:
        assert self._link.identity
        values = self._sensor.accelerations(samples.counts, self._link.identity.nominal_gain)
        overflow = len(self._waiting) + len(times) - MOST_WAITING
        self._counts["samples_overflowed"] += max(0, overflow)
        self._waiting.extend(zip(times, values, strict=True))


class Sensor:
    """Accelerometer with a calibration.

    Parameters
    ----------
    calibration : CalibrationParameters
    axes : Axes
        Axes of the device.

    Attributes
    ----------
    names : tuple of str
        Axes of the accelerometer to sample: all with a mounting, otherwise those of the device.
    calibrated : bool
        True if the calibration has gains.

    Raises
    ------
    ParameterError
        The calibration contains text that is not a number, or its directions cannot be inverted.
    """

    def __init__(self, calibration: CalibrationParameters, axes: Axes) -> None:
        name = "serial.calibration"
        self._mounting = read_mounting(f"{name}.mounting", calibration.mounting, ALL_AXES)
        self._axes = axes
        self._own = ALL_AXES if self._mounting else axes
        self.names = self._own.names
        if len(self.names) == 1:
            self.names = (calibration.axis,)
            self._offsets, self._gains = [calibration.offset], [calibration.gain]
        else:
            self._offsets = _of_axes(f"{name}.offsets", calibration.offsets, self._own)
            self._gains = _of_axes(f"{name}.gains", calibration.gains, self._own)
        self.calibrated = all(self._gains)

    def accelerations(self, counts: Sequence[int], nominal_gain: float) -> list[Vector]:
        """Return the accelerations of samples, counts by sample, then by axis."""
        columns = [
            [(gain or nominal_gain) * (each - offset) for each in counts[index :: len(self.names)]]
            for index, (gain, offset) in enumerate(zip(self._gains, self._offsets, strict=True))
        ]
        vectors = [self._own.vector(each) for each in zip(*columns, strict=True)]
        if not self._mounting:
            return vectors
        turned = map(self._mounting.acceleration, vectors)
        return [self._axes.vector(self._axes.components(each)) for each in turned]


def _of_axes(name: str, text: str, axes: Axes) -> list[float]:
    """Return the numbers for a device's axes; 0 for an empty text."""
    x, y, z = read_numbers(name, text, len(NAMES)) if text else ZERO
    return axes.components((x, y, z))


class SerialSlave(SerialDevice):
    """Tool with the accelerometer of a board."""

    Parameters = SerialSlaveParameters


class SerialMaster(SerialDevice):
    """Handle with an accelerometer and one or three voice coils."""

    Parameters = SerialMasterParameters
    description = interface.DeviceDescription(ahead=True, framed=True)

    def arm(self) -> bool | None:
        """Request that the board allow forces again; return False without a board."""
        return None if self._link.arm() else False

"""The devices `serial`: accelerometer and, at the master, voice coil; they have no arm."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.devices.interface import Device, DeviceError, Sample

if TYPE_CHECKING:
    from haptic_accel.devices.serial.link import Link
    from haptic_accel.devices.serial.protocol import Samples

# pyserial and cobs are an extra of the package: only who opens a port needs them.

MISSING_LIBRARY = "needs pyserial and cobs: pip install 'haptic_accel[serial]'"

FORCE_CONSTANT = 2.4
"""Of the paper's voice coil, H2W NCM02-05-005-4JB (data sheet), N/A."""

BAUD = 1_000_000
"""Of a real serial line, bit/s; USB has none."""

HIGHEST_RATE = 10_000
"""Samples per second that the protocol is made for."""

MOST_WAITING = 4096
"""Samples kept for a reader that does not come."""

LONGEST_HELD = 10
"""Ticks for which a sample may be held; beyond, it would be a lie."""

AUTO, MANUAL = "auto", "manual"


@dataclass(frozen=True)
class CalibrationParameters(Checked):
    """What a count of the accelerometer is, as `haptic-accel calibrate` finds it."""

    axis: str = parameter("z", "of the accelerometer, along the actuator", choices=("x", "y", "z"))
    offset: float = parameter(0.0, "counts without acceleration", low=-(2.0**15), high=2.0**15)
    gain: float = parameter(
        0.0,
        "acceleration per count, negative where it is mounted upside down; 0 for the board's"
        " nominal one",
        unit="m/s^2",
        low=-10.0,
        high=10.0,
    )
    board: str = parameter("", "serial number of the board that this is of; empty for any")


@dataclass(frozen=True)
class SerialSlaveParameters(Checked):
    """A board with an accelerometer."""

    port: str = parameter("", "path of the port, such as /dev/ttyACM0")
    usb_serial: str = parameter("", "USB serial number of the board, in place of a path")
    baud: int = parameter(
        BAUD, "of a real serial line; USB has none", unit="bit/s", low=9600, high=12_000_000
    )
    rate: int = parameter(
        0, "samples per second of the board; 0 for the graph's", low=0, high=HIGHEST_RATE
    )
    samples_per_frame: int = parameter(1, "samples sent together", low=1, high=64)
    delay: float = parameter(
        0.0,
        "how old samples are at least, so that every tick has one of the same age; 0 for as old as"
        " 19 of 20 are when they come, and at most a period more than a frame is long",
        unit="s",
        low=0.0,
        high=0.1,
    )
    calibration: CalibrationParameters = field(default_factory=CalibrationParameters)


@dataclass(frozen=True)
class ActuatorParameters(Checked):
    """What the current of a board drives."""

    force_constant: float = parameter(
        FORCE_CONSTANT,
        "force per current, negative where its wires are swapped (H2W NCM02-05-005-4JB: 2.4)",
        unit="N/A",
        low=-1000.0,
        high=1000.0,
    )
    rearm: str = parameter(
        MANUAL,
        "who allows a force after the board was unplugged: auto for the driver, once it is back",
        choices=(AUTO, MANUAL),
    )

    def __post_init__(self) -> None:
        """Check all fields; no force comes of a constant of zero."""
        super().__post_init__()
        if self.force_constant == 0:
            raise ParameterError("force_constant = 0: must not be 0 N/A")


@dataclass(frozen=True)
class SerialMasterParameters(SerialSlaveParameters):
    """A board with an accelerometer and an actuator."""

    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)


class SerialDevice(Device):
    """A board's accelerometer; position and velocity are zero, there is no arm.

    The caller's clock must be `time.monotonic`. A tick gets the newest sample that is as old as
    the delay; where there is none since the last tick, that one is held for a while, and counted.
    The delay covers how differently long frames take: without it, a tick would have none or two
    by chance. Whoever takes the samples never waits for the port, which has a thread of its own.
    """

    _actuator: ActuatorParameters | None = None
    """None where there is none."""

    def __init__(self, parameters: SerialSlaveParameters, rate: float, seed: int) -> None:
        if not (parameters.port or parameters.usb_serial):
            raise ParameterError(
                "serial.port = '': must be the path of a port, or serial.usb_serial a number"
            )
        if parameters.port and parameters.usb_serial:
            raise ParameterError(
                f"serial.usb_serial = {parameters.usb_serial!r}: must be empty with serial.port"
            )
        self._parameters = parameters
        self._rate = parameters.rate or round(rate)
        self._link: Link | None = None
        self._waiting: deque[tuple[float, float]] = deque(maxlen=MOST_WAITING)
        self._offset = parameters.calibration.offset
        self._gain = parameters.calibration.gain
        self._longest_held = LONGEST_HELD / rate
        self._held: Sample | None = None
        self._held_since = 0.0
        self._samples_held = 0

    def open(self) -> None:
        """Connect to the board, and let it sample."""
        p = self._parameters
        try:
            from haptic_accel.devices.serial.link import Link, Wanted
            from haptic_accel.devices.serial.protocol import Configuration, axes_bits
        except ImportError:
            raise DeviceError(f"serial: {MISSING_LIBRARY}") from None
        self._waiting.clear()
        self._held = None
        axes = axes_bits(p.calibration.axis)
        wanted = Wanted(
            Configuration(self._rate, axes, p.samples_per_frame),
            actuator=self._actuator is not None,
            rearm=self._actuator is not None and self._actuator.rearm == AUTO,
            serial_number=p.calibration.board,
        )
        self._link = Link(p.port, p.usb_serial, p.baud, wanted, self._take)
        self._link.open()

    def read(self, time: float) -> Sample | None:
        """Return the newest sample that was taken no later than `time` less the delay.

        None before the first, and once the last is too old to be held.
        """
        due = time - self._delay
        newest = None
        while self._waiting and self._waiting[0][0] <= due:
            newest = self._waiting.popleft()
        if newest is not None:
            self._held_since, acceleration = newest
            self._held = Sample(ZERO, ZERO, acceleration)
        elif self._held is not None:
            if due - self._held_since > self._longest_held:
                self._held = None
            else:
                self._samples_held += 1
        return self._held

    def write(
        self,
        time: float,
        *,
        arm_force: Vector | None = None,
        actuator_force: float | None = None,
    ) -> None:
        """Do nothing: there is no arm and no actuator."""

    def close(self) -> None:
        """Leave the board without current and without samples."""
        if self._link is not None:
            self._link.close()

    @property
    def remark(self) -> str:
        """Which board it is."""
        identity = self._link.identity if self._link else None
        if identity is None:
            return ""
        firmware = ".".join(map(str, identity.firmware))
        calibrated = "calibrated" if self._parameters.calibration.gain else "not calibrated"
        return (
            f"board {identity.serial_number}, firmware {firmware}, {self._rate} samples per"
            f" second, {calibrated}"
        )

    @property
    def problem(self) -> str:
        """Why there are no samples or no forces, in one line; empty if all is well."""
        return self._link.refusal if self._link else ""

    def status(self) -> dict[str, int]:
        """Return counts of the link, and of ticks without a sample of their own."""
        link = self._link.status() if self._link else {}
        delay = {"sample_delay_us": round(self._delay * 1e6)}
        return {"samples_held": self._samples_held, **delay, **link}

    @property
    def _delay(self) -> float:
        if self._parameters.delay:
            return self._parameters.delay
        return self._link.delay if self._link else 0.0

    def _take(self, times: Sequence[float], samples: Samples) -> None:
        if not self._gain:
            assert self._link and self._link.identity
            self._gain = self._link.identity.nominal_gain
        for time, counts in zip(times, samples.counts, strict=True):
            self._waiting.append((time, self._gain * (counts - self._offset)))


class SerialSlave(SerialDevice):
    """The tool: an accelerometer."""

    Parameters = SerialSlaveParameters


class SerialMaster(SerialDevice):
    """The handle: an accelerometer and a voice coil."""

    Parameters = SerialMasterParameters

    def __init__(self, parameters: SerialMasterParameters, rate: float, seed: int) -> None:
        super().__init__(parameters, rate, seed)
        self._actuator = parameters.actuator

    def write(
        self,
        time: float,
        *,
        arm_force: Vector | None = None,
        actuator_force: float | None = None,
    ) -> None:
        """Send a set-point of the current at once, zero for one that is not finite.

        The board takes the current off by itself when none comes for 5 ms.
        """
        link = self._link
        if actuator_force is not None and link is not None:
            assert self._actuator
            link.set_current(actuator_force / self._actuator.force_constant)

    def arm(self) -> bool | None:
        """Ask the board to allow forces again; False where there is none to ask."""
        return None if self._link is not None and self._link.arm() else False

    def disarm(self) -> bool:
        """Ask the board to take the current off until `arm`; whether there is one to ask."""
        return self._link is not None and self._link.disarm()

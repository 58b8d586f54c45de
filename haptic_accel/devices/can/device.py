# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices `can`: arms on a CAN bus, without accelerometer and actuator.

Messages for errors of the bus, which python-can opens, have one line.
"""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, TypeVar

from haptic_accel.core.model import Force, Vector
from haptic_accel.core.parameters import ParameterError, one_line
from haptic_accel.devices.can.arm import LONGEST_SILENCE, DrivenArm, State
from haptic_accel.devices.can.parameters import (
    REQUESTED,
    CanMasterParameters,
    CanParameters,
    CanSlaveParameters,
)
from haptic_accel.devices.can.protocol import COMMAND_BITS, HIGHEST_ID, BusLoad, Frame, frame_bits
from haptic_accel.devices.interface import (
    Connection,
    Device,
    DeviceError,
    Joints,
    Sample,
    explained,
)

if TYPE_CHECKING:
    import can

# python-can is imported where it is needed, so that users without CAN need not install it.

DEFAULT_BITRATE = 1e6
"""Default bit rate, bit/s: the highest of classic CAN, needed at 1 kHz."""

NODE_MASK = HIGHEST_ID & ~((1 << COMMAND_BITS) - 1)
"""Bits of an id that hold the node."""

_MISSING = "there is no such channel"
_REASONS = {
    errno.ENOENT: _MISSING,
    errno.ENODEV: _MISSING,
    errno.ENXIO: _MISSING,
    errno.EACCES: "no permission: join the group that owns it (ls -l; often dialout), and log in",
    errno.EPERM: "no permission: it needs an administrator",
    errno.EBUSY: "busy: another program has it open",
    errno.ENETDOWN: "it is down: sudo ip link set CHANNEL up type can bitrate 1000000",
    errno.EAFNOSUPPORT: "its driver is missing: this kernel has no CAN (sudo modprobe can)",
    errno.EPROTONOSUPPORT: "its driver is missing: this kernel has no CAN (sudo modprobe can_raw)",
}
"""Reason why a channel cannot be opened, by errno."""


def bus_configuration(parameters: CanParameters) -> dict[str, Any]:
    """Return python-can's configuration, in which the parameters take precedence.

    Precedence: the parameters; the environment's CAN_INTERFACE, CAN_CHANNEL, CAN_BITRATE and
    CAN_CONFIG, first with ``_<context>`` appended, then without; can.conf, first its section
    ``[<context>]``, then ``[default]``.

    Raises
    ------
    DeviceError
        python-can is not installed.
    ParameterError
        The interface is missing or unknown.
    """
    try:
        import can.util
    except ImportError:
        raise DeviceError(
            "can: python-can is not installed: pip install python-can, or the package python3-can"
        ) from None
    named = {name: getattr(parameters, name) for name in ("interface", "channel", "bitrate")}
    settings = parameters.settings | {name: value for name, value in named.items() if value}
    known = ", ".join(sorted(can.VALID_INTERFACES))
    try:
        return dict(can.util.load_config(config=settings, context=parameters.context))
    except can.CanInterfaceNotImplementedError as error:
        # The interface comes from python-can's configuration, or is missing.
        found = parameters.interface or ("" if '"None"' in str(error) else one_line(error))
        raise ParameterError(
            f"can.interface = {found!r}: must be one of {known}, here or in python-can's own"
            " configuration"
        ) from None
    except (ValueError, TypeError) as error:
        raise ParameterError(f"can: python-can's configuration: {one_line(error)}") from None


def bitrate_of(configuration: dict[str, Any]) -> float:
    """Return a configuration's bit rate, bit/s; the default if it has none."""
    return float(configuration.get("bitrate") or DEFAULT_BITRATE)


def open_bus(configuration: dict[str, Any], nodes: list[int]) -> can.BusABC:
    """Open a bus.

    Parameters
    ----------
    configuration : dict
        Result of `bus_configuration`.
    nodes : list of int
        Nodes whose frames to receive; all if empty.

    Raises
    ------
    DeviceError
        The bus cannot be opened; one line with a remedy.
    ParameterError
        The channel is missing.
    """
    import can

    filters: list[Any] = [
        {"can_id": node << COMMAND_BITS, "can_mask": NODE_MASK, "extended": False}
        for node in nodes
    ]
    what = f"can: {configuration.get('interface')} {configuration.get('channel') or ''}".strip()
    try:
        return can.Bus(ignore_config=True, can_filters=filters or None, **configuration)
    except can.CanInterfaceNotImplementedError as error:
        raise DeviceError(f"{what}: its driver is missing: {one_line(error)}") from None
    # Drivers raise any kind of exception.
    except Exception as error:
        if isinstance(error, TypeError) and not configuration.get("channel"):
            raise ParameterError(f"can.channel = '': {what} must have one") from None
        missing = isinstance(error, (ImportError, NameError))
        reason = "its driver is missing: " * missing + one_line(error)
        raise DeviceError(f"{what}: {explained(error, _REASONS) or reason}") from None


def frame_of(message: can.Message) -> Frame | None:
    """Return a received frame; None for an error frame or an extended id."""
    if message.is_error_frame or message.is_extended_id or message.is_fd:
        return None
    return Frame(message.arbitration_id, bytes(message.data), message.is_remote_frame)


def message_of(frame: Frame) -> can.Message:
    """Return a frame's message with a standard id; python-can defaults to extended."""
    import can

    return can.Message(
        arbitration_id=frame.id,
        data=frame.data or None,
        is_remote_frame=frame.remote,
        is_extended_id=False,
        check=False,
    )


T = TypeVar("T")

POLL_PERIOD = 2e-3
"""Period of polling while a device opens, s."""


class CanArm(Device):
    """Arm of one to three ODrives that move a tip; there is no accelerometer and no actuator.

    Torques require that every axis reports closed loop and no error. Otherwise all axes are
    released (zero torque, idle) until `arm` is called or, with `rearm` ``auto``, until all lost
    reports are back.
    """

    Parameters = CanParameters

    def __init__(self, parameters: CanParameters, rate: float, seed: int) -> None:
        self._p = parameters
        self._rate = rate
        self._link = ArmLink(parameters)
        self._arm = self._link.arm
        self._measured_since = monotonic()
        self._measured_bits = 0

    def open(self) -> None:
        """Open the bus, wait for every axis, test its watchdog, and arm.

        Raises
        ------
        DeviceError
            The bus cannot be opened, an axis does not report, does not enter closed loop, or stays
            in closed loop without commands.
        ParameterError
            The interface does not exist.
        """
        self._link.open()
        try:
            if silent := self._wait_while(lambda: self._arm.missing(monotonic())):
                raise DeviceError(
                    f"can: {self._channel}: no heartbeat of {silent} for"
                    f" {self._p.start_timeout:g} s: powered, wired, {self.load.bitrate:g} bit/s?"
                )
            self._arm.arm(monotonic(), test=True)
            pending = State.ARMING, State.FALLING_SILENT
            # The arm is armed twice, with silence in between.
            longest = 2 * self._p.start_timeout + LONGEST_SILENCE
            self._wait_while(lambda: self._arm.state in pending, longest)
            if self._arm.state is not State.ARMED:
                raise DeviceError(f"can: {self._channel}: {self._arm.fault or 'is not armed'}")
        except DeviceError:
            self.close()
            raise

    def read(self, time: float) -> Sample | None:
        """Return the tip's newest position and velocity without blocking; None if too old."""
        return self._arm.read(monotonic())

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Send the torques for a force of the tip; ignore an actuator's force."""
        if arm_force is not None:
            self._arm.apply(arm_force, monotonic())

    def joints(self, sample: Sample, force: Vector) -> Joints:
        """Return the driven joints' newest estimates and commanded torques."""
        return self._arm.joints()

    def close(self) -> None:
        """Leave every axis idle and without torque, even if never opened."""
        self._link.close()

    @property
    def remark(self) -> str:
        """Bus load, with a warning if it is too high, and the watchdogs' reaction time."""
        longest = self._arm.longest_silence
        return f"can: {self._channel}: {self.load}, without commands no torque in {longest:.2f} s"

    @property
    def load(self) -> BusLoad:
        """Largest load of the bus by the arm."""
        return BusLoad(
            len(self._p.joints),
            self._rate,
            bitrate_of(self._link.configuration),
            self._p.estimates == REQUESTED,
        )

    def counters(self) -> dict[str, int]:
        """Return counts, and the load of the bus since the last call in percent."""
        now, link = monotonic(), self._link
        seconds = max(now - self._measured_since, POLL_PERIOD)
        load = (link.bits - self._measured_bits) / seconds / bitrate_of(link.configuration)
        self._measured_since, self._measured_bits = now, link.bits
        return {
            "connected": int(link.connected),
            **self._arm.counters(),
            "bus_load_percent": round(100 * load),
            **link.counts,
            "bus_losses": link.losses,
        }

    @property
    def problem(self) -> str:
        """One-line reason for missing torques; empty while there are torques."""
        return "" if self._arm.state is State.ARMED else self._arm.fault

    def arm(self) -> bool | None:
        """Start arming, which takes one or two heartbeats; return None, or False without a bus.

        Torques are zero until the next force; `armed` and `problem` show the result.
        """
        if not self._link.connected:
            return False
        self._arm.arm(monotonic())
        return None

    @property
    def _channel(self) -> str:
        names = (self._link.configuration.get(key) for key in ("interface", "channel"))
        return " ".join(str(name) for name in names if name)

    def _wait_while(self, pending: Callable[[], T], longest: float = 0.0) -> T:
        """Wait while `pending` returns a true value, up to a time limit; return the last value."""
        deadline = monotonic() + (longest or self._p.start_timeout) + POLL_PERIOD
        while (still := pending()) and monotonic() < deadline:
            sleep(POLL_PERIOD)
        return still


class CanMaster(CanArm):
    """Arm of the master."""

    Parameters = CanMasterParameters


class CanSlave(CanArm):
    """Arm of the slave."""

    Parameters = CanSlaveParameters


RECEIVE_TIMEOUT = 2e-3
"""Longest time between two periodic updates of the arm, s."""

LONGEST_QUEUE = 100
"""Maximum number of frames received between two periodic updates of the arm."""

SEND_TIMEOUT = 50e-3
"""Longest time that a full transmit buffer may delay a command, s. With 0, serial interfaces would
send half frames. Delays by other processes are included."""


COUNTERS = "frames_received", "frames_sent", "frames_garbled", "send_failures"
"""Names of the counters of a link."""


class ArmLink(Connection):
    """Connection of an arm to its bus.

    Parameters
    ----------
    parameters : CanParameters

    Attributes
    ----------
    arm : DrivenArm
    configuration : dict
        Configuration of the bus for python-can; empty before it was opened.
    counts : dict
        Numbers of frames received, sent, unreadable, and not sent.
    bits : int
        Maximum bits of all frames received and sent.
    """

    def __init__(self, parameters: CanParameters) -> None:
        super().__init__()
        self._parameters = parameters
        self.arm = DrivenArm(parameters, self._send)
        self.configuration: dict[str, Any] = {}
        self._bus: can.BusABC | None = None
        self._sending = threading.Lock()
        self.counts = dict.fromkeys(COUNTERS, 0)
        self.bits = 0

    def _connect(self) -> None:
        self.configuration = self.configuration or bus_configuration(self._parameters)
        self._bus = open_bus(self.configuration, self.arm.nodes)
        self.connected = True
        if self.losses:
            self.arm.release()

    def _receive(self) -> None:
        """Receive all frames, so that queued frames do not seem lost after a stall."""
        timeout = RECEIVE_TIMEOUT
        for _ in range(LONGEST_QUEUE):
            try:
                message = self._bus.recv(timeout) if self._bus else None
            # Drivers raise any kind of exception.
            except Exception as error:
                if not isinstance(error.__cause__ or error, (ValueError, IndexError)):
                    raise DeviceError(one_line(error)) from error
                self.counts["frames_garbled"] += 1
                # Flush, or the driver would keep the unreadable data and fail again: slcan reads
                # lines of text, and may lose bytes.
                flush = getattr(self._bus, "flush", lambda: None)
                with suppress(Exception):
                    flush()
                continue
            if message is None:
                break
            timeout = 0.0
            self._accept(message)
        self.arm.update(time.monotonic())

    def _release(self) -> None:
        self.arm.disarm()

    def _disconnect(self) -> None:
        with self._sending:
            self.connected = False
            bus, self._bus = self._bus, None
        if bus is not None:
            # Closing a lost bus may fail.
            with suppress(Exception):
                bus.shutdown()
            self.arm.lose()

    def _send(self, frames: Sequence[Frame]) -> bool:
        """Send frames in order; return False if a frame could not be sent."""
        with self._sending:
            if self._bus is None:
                return False
            try:
                for frame in frames:
                    self._bus.send(message_of(frame), SEND_TIMEOUT)
                    self.counts["frames_sent"] += 1
                    self.bits += frame_bits(len(frame.data))
            # Drivers raise any kind of exception; the thread notices a lost bus.
            except Exception:
                self.counts["send_failures"] += 1
                return False
        return True

    def _accept(self, message: can.Message) -> None:
        frame = frame_of(message)
        if frame is None:
            self.counts["frames_garbled"] += 1
            return
        self.counts["frames_received"] += 1
        self.bits += frame_bits(len(frame.data))
        self.arm.receive(frame, time.monotonic())

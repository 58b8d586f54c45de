# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Connection to a board: identify, configure and arm it, receive samples, send set-points."""

from __future__ import annotations

import errno
import math
import os
import select
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import serial
from serial.tools import list_ports

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import one_line
from haptic_accel.devices.interface import Connection, DeviceError, explained
from haptic_accel.devices.serial import protocol
from haptic_accel.devices.serial.protocol import CLOCKS

MICROSECOND = 1e-6
"""Unit of a device's clock, s."""

BLOCK = 32
"""Number of frames in a block, of which the fastest is used."""

BLOCKS = 256
"""Number of blocks in the line fit: 8 s at 1000 frames per second, too short for a crystal to
drift."""

LEAST_BLOCKS = 32
"""Minimum number of blocks for fitting a slope; with fewer, jitter would cause a large error."""

FIRST_BLOCKS = 4
"""Number of blocks for a line without a fitted slope; drift makes older blocks wrong."""

LARGEST_DRIFT = 1e-3
"""Largest relative difference of a rate from its nominal value: crystals have 1e-4."""

STRAGGLER = 0.5e-3
"""Lateness against the line beyond which a block is ignored, s; equal earliness shows that the
line is wrong."""

LATE_BLOCKS = 32
"""Number of successive late blocks after which the line counts as wrong."""


def unwrapped(count: int, near: int) -> int:
    """Return a count that wraps at `CLOCKS` as the continuous count nearest to `near`."""
    return near + (count - near + CLOCKS // 2) % CLOCKS - CLOCKS // 2


class Line(NamedTuple):
    """Linear relation between the device's and the host's clock, as a point and a slope.

    Attributes
    ----------
    clock : float
        Time by the device's clock, us.
    time : float
        The same time by the host's clock, s.
    slope : float
        Host time per device time, s/us.
    """

    clock: float
    time: float
    slope: float


class DeviceClock:
    """Clock of a device; one thread may add frames while others convert times."""

    def __init__(self) -> None:
        self._line = Line(0.0, 0.0, MICROSECOND)
        self._points: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self._late_blocks = 0
        self._block: list[tuple[float, int, float]] = []

    @property
    def known(self) -> bool:
        """True after the first complete block; until then the fastest frame counts."""
        return bool(self._points)

    def add(self, clock: int, arrival: float) -> None:
        """Process the stamp of a frame.

        Parameters
        ----------
        clock : int
            Time of the stamp by the device's clock, us, continuous.
        arrival : float
            Time of arrival by the host's clock, s.
        """
        slope = self._line.slope
        self._block.append((arrival - clock * slope, clock, arrival))
        if self.known and len(self._block) < BLOCK:
            return
        _, stamp, arrived = min(self._block)
        if len(self._block) == BLOCK:
            self._block.clear()
            self._take(stamp, arrived)
        else:
            self._line = Line(stamp, arrived, slope)

    def time(self, clock: float) -> float:
        """Convert a device time, us, to the host's clock, s."""
        line = self._line
        return line.time + line.slope * (clock - line.clock)

    def device_time(self, time: float) -> float:
        """Convert a host time, s, to the device's clock, us, continuous."""
        line = self._line
        return line.clock + (time - line.time) / line.slope

    def device_duration(self, duration: float) -> float:
        """Convert a duration on the host's clock, s, to the device's clock, us."""
        return duration / self._line.slope

    def _take(self, clock: float, arrival: float) -> None:
        """Add a block's fastest frame to the line fit."""
        late = arrival - self.time(clock) if self.known else 0.0
        self._late_blocks = self._late_blocks + 1 if late > STRAGGLER else 0
        if 0 < self._late_blocks < LATE_BLOCKS:
            return
        if abs(late) > STRAGGLER:
            self._points.clear()
            self._late_blocks = 0
        self._points.append((clock, arrival))
        self._line = self._fitted()

    def _fitted(self) -> Line:
        # Fit relative to the last point, which keeps precision after hours.
        last = self._points[-1]
        points, slope = np.array(self._points) - last, MICROSECOND
        if len(points) < LEAST_BLOCKS:
            points = points[-FIRST_BLOCKS:]
        else:
            variance, covariance = np.cov(points, rowvar=False)[0].tolist()
            low, high = (MICROSECOND * (1 + sign * LARGEST_DRIFT) for sign in (-1, 1))
            # The slope is undefined for a clock that stands still.
            slope = min(max(covariance / variance, low), high) if variance else slope
        clock, time = points.mean(axis=0).tolist()
        return Line(last[0] + clock, last[1] + time, slope)


FIRMWARE = ".".join(map(str, protocol.FIRMWARE))
"""Version of the firmware that this driver needs."""

ANSWER = 2.0
"""Longest time for a board to answer, s: some restart when their port is opened."""

ASK_AGAIN = 0.2
"""Time without an answer after which a request is repeated, s."""

NANOSECONDS = 1000
"""Nanoseconds in a microsecond."""

SILENCE = 1.0
"""Time without a frame after which a board counts as gone, s: a status comes every 0.1 s."""

ENDING = 0.1
"""Longest time to wait for the last answer during closing, s."""

ALIGN_PERIOD = 0.05
"""Interval between alignment requests, s; the initially unknown clock drift shifts the ticks by
some 5 us in that time."""

ALIGNED = 1 / 16
"""Distance of a sample from the grid below which the board follows it, periods."""

LEAD = 0.2
"""Lead of a board's ticks over the grid, periods: most samples are then present when the nodes'
tick begins, which would otherwise poll repeatedly."""

BAUD = 1_000_000
"""Bit rate of a real serial line, bit/s; USB has none."""

NO_ANSWER = f"no answer; is there a board with this firmware, at {BAUD} baud?"

REFUSALS = {
    protocol.State.DISARMED: "not armed since the board was gone",
    protocol.State.FAULT: "the amplifier has or had a fault; arm again",
}
"""Reason why a connected board allows no current, by state."""

ARMED = protocol.State.ARMED, protocol.State.TIMED_OUT
"""States of a board that allows a current."""

BOARD_COUNTERS = "state", "damaged", "lost", "refused", "timeouts", "unsent", "overflowed"
"""Names of the counters from a board's status."""

TakeSamples = Callable[[Sequence[float], protocol.Samples], None]
"""Callback for samples and their sampling times, s of `time.monotonic`."""


@dataclass(frozen=True)
class Requirements:
    """Port of a board, and requirements on it.

    Attributes
    ----------
    port, usb_serial : str
        See `find_port`.
    configuration : Configuration
    coils : tuple of str
        Axes of the required coils; an actuator is armed if there are any.
    rearm : bool
        True to arm again without a request after the board was disconnected.
    serial_number : str
        Serial number of the only board accepted; empty for any.
    grid_rate : float
        Rate of the board's sampling grid on `time.monotonic`, Hz; 0 for samples at any time.
        Samples are taken `LEAD` before the grid point for which they count.
    """

    port: str
    usb_serial: str
    configuration: protocol.Configuration
    coils: tuple[str, ...] = ()
    rearm: bool = False
    serial_number: str = ""
    grid_rate: float = 0.0


class BoardLink(Connection):
    """Connection to a board on a port.

    After a loss of the board, its current is zero until `arm` is called or the link arms it
    without a request. Only the board's status determines its state: set-points are sent while the
    status is armed.

    Parameters
    ----------
    required : Requirements
    take : callable
        Callback for samples, called by the link's thread or by `open`.

    Attributes
    ----------
    identity : Identity or None
        Identity of the board, from the first connection on.
    aligned : bool
        True while the board is connected and follows the grid, if any.
    late : int
        Number of scheduled set-points that reached the board after their due time.
    """

    def __init__(self, required: Requirements, take: TakeSamples) -> None:
        super().__init__()
        self._required = required
        self._take = take
        self._lead = LEAD / required.grid_rate if required.grid_rate else 0.0
        self._decoder = protocol.Decoder()
        self._encoder = protocol.Encoder()
        self._writing = threading.Lock()
        self._path = ""
        self._port: Port | None = None
        self._counts: Counter[str] = Counter(frames_wrong=0, frames_unsent=0, refusals=0)
        self._counts.update(samples_lost=0, set_points_refused=0, set_points_limited=0)
        self._last_frame = 0.0
        self.identity: protocol.Identity | None = None
        self.late = 0
        self._forget()

    # Called by the owner's thread

    def set_currents(self, currents: Vector, due: float) -> None:
        """Send the set-points of all coils; all are zero if one is not finite.

        Currents beyond full scale are scaled together, so that they keep their direction.

        Parameters
        ----------
        currents : tuple of float
            Currents of the coils along x, y and z, A; ignored for axes without a coil.
        due : float
            Tick from which the set-points act, s of `time.monotonic`. If overdue, or if the board
            does not follow the grid yet, they act at once, and discard set-points not due yet.
        """
        identity = self.identity
        if identity is None or not self.armed:
            self._counts["set_points_refused"] += 1
            return
        shares = [
            current / scale
            for current, scale in zip(currents, identity.full_scale_currents, strict=True)
            if scale
        ]
        finite, largest = all(map(math.isfinite, shares)), max(map(abs, shares))
        if not (finite and largest <= 1):
            self._counts["set_points_limited"] += 1
            shares = [share / largest if finite else 0.0 for share in shares]
        counts = tuple([round(share * protocol.FULL_SCALE) for share in shares])
        if self.aligned and due > time.monotonic():
            clock = round(self._clock.device_time(due - self._lead))
            self._send(protocol.ScheduleCurrent(counts, clock % protocol.CLOCKS))
        else:
            self._send(protocol.SetCurrent(counts))

    def arm(self) -> bool:
        """Request permission for a current, also after a fault; return False without a board."""
        if not self.connected:
            return False
        if self._state is protocol.State.FAULT:
            self._send(protocol.DisarmRequest())
        return self._send(protocol.ArmRequest())

    @property
    def armed(self) -> bool:
        """True while the board reports that it allows a current."""
        return self.connected and self._state in ARMED

    @property
    def refusal(self) -> str:
        """One-line reason for missing samples or current; empty if none."""
        state = self._state
        if not self.connected or state is None or not self._required.coils or self.armed:
            return self.problem
        return f"{self._path}: {REFUSALS[state]}"

    @property
    def _state(self) -> protocol.State | None:
        """State in the board's last status; None before the first."""
        board = self._board
        return board.state if board else None

    def counters(self) -> dict[str, int]:
        """Return counts of both sides, by name."""
        decoder, board = self._decoder, self._board
        counts = {
            "connected": int(self.connected),
            "armed": int(self.armed),
            "frames_received": decoder.received,
            "frames_damaged": decoder.damaged,
            "frames_lost": decoder.lost,
            "reconnects": self.reconnects,
            "aligned": int(self.aligned),
            "sample_offset_us": round(self._offset / MICROSECOND),
            "set_points_late": self.late,
            **self._counts,
        }
        for name in BOARD_COUNTERS if board is not None else ():
            counts[f"board_{name}"] = int(getattr(board, name))
        return counts

    # Connecting

    def _forget(self) -> None:
        """Reset all data received from a board."""
        self._decoder.restart()
        self._answered: protocol.Identity | None = None
        self._configuration: protocol.Configuration | None = None
        self._board: protocol.Status | None = None
        self._clock = DeviceClock()
        self._next_align = 0.0
        self._offset = 0.0
        self.aligned = False
        self._next_index: int | None = None
        self._last_clock = 0

    def _connect(self) -> None:
        """Open the port, identify the board, start sampling; arm when first opened."""
        self._forget()
        required = self._required
        self._path = find_port(required.port, required.usb_serial)
        self._port = Port(self._path)
        # Bytes before the first delimiter do not form a frame.
        self._write(protocol.DELIMITER)
        self._send(protocol.DisarmRequest())
        self._ask(protocol.Identify(), lambda: self._answered is not None, NO_ANSWER)
        assert self._answered
        self._check(self._answered)
        self.identity = self._answered
        requested = required.configuration
        request = protocol.Configure(requested.rate, requested.axes, requested.samples_per_frame)
        self._ask(request, lambda: self._configuration == requested, f"refuses {requested}")
        self._last_frame = time.monotonic()
        self.connected = True
        if required.coils and self._thread is None:
            refusal = "does not arm; is the amplifier at fault?"
            self._ask(protocol.ArmRequest(), lambda: self.armed, refusal)
            # No set-point has been sent: a board without the timeout of 5 ms would stay armed.
            if not self._listen_until(lambda: self._state is protocol.State.TIMED_OUT, ANSWER):
                raise DeviceError(
                    f"{self._path}: stays armed without set-points: flash firmware {FIRMWARE}"
                    " (firmware/README.md)"
                )

    def _ask(self, request: protocol.Message, answered: Callable[[], bool], problem: str) -> None:
        """Repeat a request until it is answered; raise `DeviceError` with a problem otherwise."""
        deadline = time.monotonic() + ANSWER
        while time.monotonic() < deadline and not self._closing.is_set():
            self._send(request)
            if self._listen_until(answered, ASK_AGAIN):
                return
        raise DeviceError(f"{self._path}: {problem}")

    def _listen_until(self, answered: Callable[[], bool], seconds: float) -> bool:
        """Process frames until an answer or a timeout; return whether an answer arrived."""
        deadline = time.monotonic() + seconds
        while not answered() and time.monotonic() < deadline:
            self._listen()
        return answered()

    def _check(self, identity: protocol.Identity) -> None:
        """Raise `DeviceError` if a board does not meet the requirements."""
        required, requested = self._required, self._required.configuration
        number, highest = identity.serial_number, identity.highest_rate
        first = self.identity.serial_number if self.identity else number
        if required.serial_number not in ("", number):
            lacking = f"must be {required.serial_number}, to which the calibration belongs"
        elif number != first:
            lacking = f"must be {first}, which was there at the start"
        elif required.coils and not identity.coils:
            lacking = "has no actuator"
        elif not set(required.coils).issubset(identity.coils):
            lacking = (
                f"has a coil along {', '.join(identity.coils)}, must along"
                f" {', '.join(required.coils)}: set serial.axes, or flash firmware for three coils"
                " (firmware/README.md)"
            )
        elif requested.axes & ~identity.axes:
            lacking = "does not have the requested axis of the accelerometer"
        elif requested.rate > highest:
            lacking = f"takes {highest} samples per second at most, not {requested.rate}"
        else:
            return
        raise DeviceError(f"{self._path}: board {number} {lacking}")

    def _release(self) -> None:
        """Stop current and samples; wait up to `ENDING` for the board to confirm."""
        self._configuration = None
        self._send(protocol.DisarmRequest())
        # The answer follows the disarming and, unlike a status, is only sent on request.
        self._send(protocol.Configure(0, 0, 0))
        with suppress(DeviceError):
            self._listen_until(lambda: self._configuration is not None, ENDING)

    def _disconnect(self) -> None:
        with self._writing:
            port, self._port = self._port, None
            self.connected, self._board = False, None
        if port is not None:
            port.close()

    # Called by the link's thread

    def _receive(self) -> None:
        self._listen()
        if time.monotonic() - self._last_frame > SILENCE:
            raise DeviceError(f"{self._path}: silent for {SILENCE:g} s")

    def _listen(self) -> None:
        """Process the next frames, if any."""
        assert self._port is not None
        data = self._port.read()
        arrival = time.monotonic()
        for frame in self._decoder.feed(data):
            self._last_frame = arrival
            self._process(frame, arrival)

    def _process(self, frame: protocol.Frame, arrival: float) -> None:
        if frame.version != self._encoder.version and not self.connected:
            self._speak(frame.version)
        try:
            message = protocol.read_message(frame)
        except protocol.PayloadError:
            self._counts["frames_wrong"] += 1
            if frame.version not in protocol.VERSIONS and not self.connected:
                raise DeviceError(
                    f"{self._path}: speaks version {frame.version} of the protocol, must be"
                    f" {protocol.VERSION}: flash firmware {FIRMWARE} (firmware/README.md)"
                ) from None
            return
        match message:
            case protocol.Samples():
                self._take_samples(frame.clock, message, arrival)
            case protocol.Status():
                before = self._board or message
                self.late += max(0, message.late - before.late)
                self._board = message
                rearms = self._required.rearm and self.connected
                if rearms and message.state is protocol.State.DISARMED:
                    self._send(protocol.ArmRequest())
            case protocol.Identity():
                self._answered = message
            case protocol.Configuration():
                self._configuration = message
            case protocol.Error():
                self._counts["refusals"] += 1

    def _speak(self, version: int) -> None:
        """Use the board's protocol version, and repeat the request to disarm in that version."""
        if version in protocol.VERSIONS:
            self._encoder.version = version
            self._send(protocol.DisarmRequest())

    def _take_samples(self, clock: int, samples: protocol.Samples, arrival: float) -> None:
        requested = self._required.configuration
        if self._configuration is None or samples.axes != requested.axes:
            return  # samples from an earlier configuration
        if self._next_index is None:
            self._next_index, self._last_clock = samples.index, clock
        index = unwrapped(samples.index, self._next_index)
        self._last_clock = unwrapped(clock, self._last_clock)
        self._counts["samples_lost"] += max(0, index - self._next_index)
        self._next_index = index + samples.number
        self._clock.add(self._last_clock, arrival)
        first = self._clock.time(self._last_clock) + self._lead
        self._take([first + index / requested.rate for index in range(samples.number)], samples)
        if self._clock.known:
            self._align(first, arrival)

    def _align(self, sampled: float, now: float) -> None:
        """Synchronize the board with the grid, and store a sample's time relative to it."""
        rate = self._required.grid_rate
        if not rate:
            self.aligned = True
            return
        self._offset = sampled - round(sampled * rate) / rate
        if self._next_align and abs(self._offset) * rate < ALIGNED:
            self.aligned = True
        if now >= self._next_align:
            self._next_align = now + ALIGN_PERIOD
            tick = round(self._clock.device_time(math.ceil(now * rate) / rate - self._lead))
            period = round(self._clock.device_duration(1 / rate) * NANOSECONDS)
            self._send(protocol.Align(tick % protocol.CLOCKS, period))

    # Called by any thread

    def _send(self, message: protocol.Message) -> bool:
        with self._writing:
            now = round(time.monotonic() / MICROSECOND)
            return self._write(self._encoder.encode(message, now))

    def _write(self, data: bytes) -> bool:
        if self._port is None:
            return False
        try:
            room = self._port.write(data)
        except DeviceError:
            return False  # the reader notices it as well, and reports it
        self._counts["frames_unsent"] += not room
        return room


WAIT = 0.1
"""Longest time for which a read waits for bytes, s."""

MOST_BYTES = 4096
"""Maximum number of bytes read at once."""

_EMPTY = "nothing is behind it; is it plugged in?"
_BUSY = "busy: another program has it open"
REASONS = {
    errno.ENOENT: "there is no such port; is it plugged in?",
    errno.ENXIO: _EMPTY,
    errno.EIO: _EMPTY,
    errno.EACCES: "no permission: join the group dialout (sudo usermod -aG dialout $USER), then"
    " log in again",
    errno.EAGAIN: _BUSY,
    errno.EBUSY: _BUSY,
}
"""Explanation of a system error, with a remedy."""


def find_port(path: str, usb_serial: str) -> str:
    """Return the path of a port.

    Parameters
    ----------
    path : str
        Path of the port, returned unchanged; empty to search by `usb_serial`.
    usb_serial : str
        USB serial number of the device, used if there is no path.

    Raises
    ------
    DeviceError
        No port or several ports match.
    """
    if path:
        return path
    ports = list_ports.comports()
    found = sorted(port.device for port in ports if port.serial_number == usb_serial)
    if not found:
        known = [f"{port.device} ({port.serial_number})" for port in ports if port.serial_number]
        there = f"there are {', '.join(known)}" if known else "no port has one"
        raise DeviceError(f"USB serial number {usb_serial}: not plugged in; {there}")
    if len(found) > 1:
        raise DeviceError(f"USB serial number {usb_serial}: {', '.join(found)} have it; name one")
    return found[0]


class Port:
    """Open port that no other program can open, and that never blocks a writer.

    Parameters
    ----------
    path : str

    Raises
    ------
    DeviceError
        The port cannot be opened.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            self._serial = serial.Serial(path, BAUD, timeout=0, exclusive=True)
        except (serial.SerialException, ValueError) as error:
            reason = explained(error, REASONS)
            reason = reason or f"cannot be opened as a serial port ({one_line(error)})"
            raise DeviceError(f"{path}: {reason}") from None
        with suppress(ValueError, NotImplementedError, AttributeError):
            # FTDI converters otherwise hold bytes for 16 ms; other converters lack this mode.
            self._serial.set_low_latency_mode(True)

    def read(self) -> bytes:
        """Return the bytes that are available or arrive within `WAIT`.

        Raises
        ------
        DeviceError
            The port was disconnected.
        """
        # pyserial would take four system calls per frame instead of two.
        try:
            if not select.select([self._serial], [], [], WAIT)[0]:
                return b""
            data = os.read(self._serial.fileno(), MOST_BYTES)
        except OSError as error:
            raise DeviceError(f"{self.path}: unplugged ({one_line(error)})") from None
        if not data:
            raise DeviceError(f"{self.path}: unplugged (no data)")
        return data

    def write(self, data: bytes) -> bool:
        """Write bytes; return False if the buffer had no space for all of them.

        Raises
        ------
        DeviceError
            The port was disconnected.
        """
        try:
            # pyserial without a time-out would busy-wait for room.
            return os.write(self._serial.fileno(), data) == len(data)
        except BlockingIOError:
            return False
        except OSError as error:
            raise DeviceError(f"{self.path}: unplugged ({one_line(error)})") from None

    def close(self) -> None:
        """Close the port."""
        with suppress(OSError):
            self._serial.close()

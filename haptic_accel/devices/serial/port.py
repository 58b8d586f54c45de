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

"""Find and open a serial port; errors are explained in one line."""

from __future__ import annotations

import errno
import os
import select
from contextlib import suppress

import serial
from serial.tools import list_ports

from haptic_accel.core.parameters import one_line
from haptic_accel.devices.connection import explained
from haptic_accel.devices.interface import DeviceError

WAIT = 0.1
"""Longest time that a read waits for bytes, s."""

MOST_BYTES = 4096
"""Most bytes read at once."""

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
        Returned unchanged unless it is empty.
    usb_serial : str
        USB serial number of the device to look for if there is no path.

    Raises
    ------
    DeviceError
        No port has that number, or more than one.
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
    baud : int
        Bit rate of a real serial line; USB has none.

    Raises
    ------
    DeviceError
        The port cannot be opened.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.path = path
        try:
            self._serial = serial.Serial(path, baud, timeout=0, exclusive=True)
        except (serial.SerialException, ValueError) as error:
            reason = explained(error, REASONS)
            reason = reason or f"cannot be opened as a serial port ({one_line(error)})"
            raise DeviceError(f"{path}: {reason}") from None
        with suppress(ValueError, NotImplementedError, AttributeError):
            # Converters of FTDI keep bytes for 16 ms otherwise; others know no such mode.
            self._serial.set_low_latency_mode(True)

    def read(self) -> bytes:
        """Return the bytes that are there, or that come within `WAIT`.

        Raises
        ------
        DeviceError
            The port is gone.
        """
        # Not by pyserial, which takes four system calls for a frame instead of two.
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
        """Write bytes; return False if there was no room for all of them.

        Raises
        ------
        DeviceError
            The port is gone.
        """
        try:
            # Not by pyserial, which without a time-out spins until there is room.
            return os.write(self._serial.fileno(), data) == len(data)
        except BlockingIOError:
            return False
        except OSError as error:
            raise DeviceError(f"{self.path}: unplugged ({one_line(error)})") from None

    def close(self) -> None:
        """Close the port."""
        with suppress(OSError):
            self._serial.close()

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

"""Connection of an arm to its bus: send its commands, receive the reports of its drives."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from haptic_accel.core.parameters import one_line
from haptic_accel.devices.can.arm import DrivenArm
from haptic_accel.devices.can.bus import bus_configuration, frame_of, message_of, open_bus
from haptic_accel.devices.can.load import frame_bits
from haptic_accel.devices.can.parameters import CanParameters
from haptic_accel.devices.can.protocol import Frame
from haptic_accel.devices.connection import Connection
from haptic_accel.devices.interface import DeviceError

if TYPE_CHECKING:
    import can

RECEIVE_TIMEOUT = 2e-3
"""Longest time between two periodic updates of the arm, s."""

LONGEST_QUEUE = 100
"""Most frames received between two periodic updates of the arm."""

SEND_TIMEOUT = 50e-3
"""Longest time that a full transmit buffer may delay a command, s. Not 0: serial interfaces would
then send half frames; nor shorter than a process may be delayed by others, which counts too."""


COUNTED = "frames_received", "frames_sent", "frames_garbled", "send_failures"
"""Names of a link's own counts."""


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
        Number of frames that were received, sent, unreadable, could not be sent.
    bits : int
        Most bits of all frames received and sent.
    """

    def __init__(self, parameters: CanParameters) -> None:
        super().__init__()
        self._parameters = parameters
        self.arm = DrivenArm(parameters, self._send)
        self.configuration: dict[str, Any] = {}
        self._bus: can.BusABC | None = None
        self._sending = threading.Lock()
        self.counts = dict.fromkeys(COUNTED, 0)
        self.bits = 0

    def _connect(self) -> None:
        self.configuration = self.configuration or bus_configuration(self._parameters)
        self._bus = open_bus(self.configuration, self.arm.nodes)
        self.connected = True
        if self.losses:
            self.arm.release()

    def _receive(self) -> None:
        """Receive all frames: after a stall, those that are queued must not seem lost."""
        timeout = RECEIVE_TIMEOUT
        for _ in range(LONGEST_QUEUE):
            try:
                message = self._bus.recv(timeout) if self._bus else None
            # Drivers raise any kind of exception.
            except Exception as error:
                if not isinstance(error.__cause__ or error, (ValueError, IndexError)):
                    raise DeviceError(one_line(error)) from error
                self.counts["frames_garbled"] += 1
                # The driver would keep what it could not read, and fail again: slcan reads lines
                # of text, of which bytes may be lost.
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
            # A lost bus cannot be closed in order.
            with suppress(Exception):
                bus.shutdown()
            self.arm.lose()

    def _send(self, frames: Sequence[Frame]) -> bool:
        """Send frames one after the other; return False if one could not be sent."""
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

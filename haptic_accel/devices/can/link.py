"""A bus that is read by a thread of its own, and opened again when it was lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

from haptic_accel.devices.can.bus import frame_of, message_of
from haptic_accel.devices.can.load import frame_bits
from haptic_accel.devices.can.protocol import Frame
from haptic_accel.devices.interface import DeviceError

if TYPE_CHECKING:
    import can

RECEIVE_TIMEOUT = 2e-3
"""Longest time without a look at what is due, s."""

LONGEST_QUEUE = 100
"""Frames that are taken without a look at what is due."""

SEND_TIMEOUT = 50e-3
"""How long a full transmit buffer may hold a command up, s. Not 0: serial interfaces would then
send half frames; nor less than what a process may be held up by others, which counts too."""

REOPEN_PERIOD = 0.25
"""Between attempts to open a bus that was lost, s."""

JOIN_TIMEOUT = 5.0
"""How long a driver may take to come back from opening or reading, s."""


class Listener(Protocol):
    """Who is told what a bus says."""

    def take(self, frame: Frame, now: float) -> None:
        """Take a frame that came."""

    def look(self, now: float) -> None:
        """Do what is due."""

    def lose(self, now: float) -> None:
        """Note that the bus has gone."""

    def find(self, now: float) -> None:
        """Note that it is back."""


class Link:
    """Sends to a bus, and has a thread that reads it.

    Parameters
    ----------
    open_bus : callable
        Opens the bus or raises `DeviceError`.

    Attributes
    ----------
    received, sent, garbled, send_failures, losses : int
        Frames that came, went, made no sense to the driver, could not be sent; losses of the bus.
    bits : int
        Of all frames that came and went, at most.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = None
        self._sending = threading.Lock()
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.received = self.sent = self.garbled = self.send_failures = self.losses = 0
        self.bits = 0

    @property
    def connected(self) -> bool:
        """Whether there is a bus."""
        return self._bus is not None

    def start(self, listener: Listener) -> None:
        """Open the bus and begin to read it.

        Parameters
        ----------
        listener : Listener
            Called by the thread; times are those of `time.monotonic`.

        Raises
        ------
        DeviceError
            It cannot be opened.
        """
        self._bus = self._open_bus()
        self._closing.clear()
        self._thread = threading.Thread(
            target=self._run, args=(listener,), name="can", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Read no more, and close the bus."""
        self._closing.set()
        if self._thread:
            self._thread.join(JOIN_TIMEOUT)
            self._thread = None
        self._shut()

    def send(self, frames: Sequence[Frame]) -> bool:
        """Send frames one after the other; return whether all went."""
        with self._sending:
            bus = self._bus
            if bus is None:
                return False
            try:
                for frame in frames:
                    bus.send(message_of(frame), SEND_TIMEOUT)
                    self.sent += 1
                    self.bits += frame_bits(len(frame.data))
            # Drivers raise whatever they like; the thread finds out whether the bus has gone.
            except Exception:
                self.send_failures += 1
                return False
        return True

    def _run(self, listener: Listener) -> None:
        while not self._closing.is_set():
            if self._bus is None:
                self._reopen(listener)
            else:
                self._receive(self._bus, listener)
            listener.look(time.monotonic())

    def _receive(self, bus: can.BusABC, listener: Listener) -> None:
        """Take all that has come: after a stall, what waits must not look as if it were lost."""
        timeout = RECEIVE_TIMEOUT
        for _ in range(LONGEST_QUEUE):
            try:
                message = bus.recv(timeout)
            # Drivers raise whatever they like.
            except Exception as error:
                if isinstance(error.__cause__ or error, (ValueError, IndexError)):
                    self._skip(bus)
                    continue
                self.losses += 1
                self._shut()
                listener.lose(time.monotonic())
                return
            if message is None:
                return
            timeout = 0.0
            self._take(message, listener)

    def _take(self, message: can.Message, listener: Listener) -> None:
        frame = frame_of(message)
        if frame is None:
            self.garbled += 1
            return
        self.received += 1
        self.bits += frame_bits(len(frame.data))
        listener.take(frame, time.monotonic())

    def _skip(self, bus: can.BusABC) -> None:
        """Go on after what is no frame: slcan reads lines of text, of which bytes may be lost."""
        self.garbled += 1
        # It would keep what it could not read, and fail again.
        flush = getattr(bus, "flush", None)
        if flush:
            with suppress(Exception):
                flush()

    def _reopen(self, listener: Listener) -> None:
        if self._closing.wait(REOPEN_PERIOD):
            return
        try:
            self._bus = self._open_bus()
        except DeviceError:
            return
        listener.find(time.monotonic())

    def _shut(self) -> None:
        with self._sending:
            bus, self._bus = self._bus, None
        if bus is not None:
            # What has gone cannot be told to close.
            with suppress(Exception):
                bus.shutdown()

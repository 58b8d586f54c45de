"""Keeping in touch with a board: a thread that owns its port, and connects again."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.serial.clock import MICROSECOND, SampleClock, Unwrapped
from haptic_accel.devices.serial.port import Port, find_port
from haptic_accel.devices.serial.protocol import (
    DELIMITER,
    FULL_SCALE,
    VERSION,
    Arm,
    Configuration,
    Configure,
    Decoder,
    Disarm,
    Encoder,
    Error,
    Frame,
    Identify,
    Identity,
    Message,
    PayloadError,
    Samples,
    SetCurrent,
    State,
    Status,
    read_message,
)

ANSWER = 2.0
"""Longest time for a board to answer, s: some start anew when their port is opened."""

ASK_AGAIN = 0.2
"""Time without an answer after which a question is asked again, s."""

SILENCE = 1.0
"""Time without a frame after which a board counts as gone, s: a status comes every 0.1 s."""

RETRY = 0.2
"""Time between tries to connect again, s."""

ENDING = 0.1
"""Longest time for the last frames to leave, s."""

REFUSALS = {
    State.DISARMED: "not armed since the board was gone",
    State.FAULT: "the amplifier has or had a fault; arm again",
}
"""Why a board that is there allows no current."""

TakeSamples = Callable[[Sequence[float], Samples], None]
"""Gets when samples were taken, s of `time.monotonic`, and the samples."""


@dataclass(frozen=True)
class Wanted:
    """What a board must be and do.

    Attributes
    ----------
    configuration : Configuration
    actuator : bool
        Whether it must have an actuator, which is armed.
    rearm : bool
        Whether to arm again by oneself after the board was gone.
    serial_number : str
        The only board there may be; empty for any.
    """

    configuration: Configuration
    actuator: bool = False
    rearm: bool = False
    serial_number: str = ""


class Link:
    """A board on a port, for as long as it is open, plugged in or not.

    A board that was gone is looked for until it is back. Its current is zero then, and stays so
    until `arm` is called or the link is to arm by itself. What the board says of its state is
    the only record of it: set-points are sent while it says that it is armed.

    Parameters
    ----------
    port, usb_serial : str
        As of `find_port`.
    baud : int
    wanted : Wanted
    take : callable
        Called by the link's thread, or by `open`.

    Attributes
    ----------
    identity : Identity or None
        Of the board, from the first time on.
    problem : str
        Why there is no connection, in one line; empty while there is one.
    """

    def __init__(
        self, port: str, usb_serial: str, baud: int, wanted: Wanted, take: TakeSamples
    ) -> None:
        self._where = port, usb_serial
        self._baud = baud
        self._wanted = wanted
        self._take = take
        self._decoder = Decoder()
        self._encoder = Encoder()
        self._writing = threading.Lock()
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._port: Port | None = None
        self._counts: Counter[str] = Counter()
        self._last_frame = 0.0
        self._rearm = wanted.rearm
        self._answered: Identity | None = None
        self._configuration: Configuration | None = None
        self._board: Status | None = None
        self._version: int | None = None
        self._clock: SampleClock | None = None
        self._next_index: int | None = None
        self._ready = False
        self.identity: Identity | None = None
        self.problem = ""

    # What the caller's thread does

    def open(self) -> None:
        """Connect, configure and arm the board; keep in touch from now on.

        Raises
        ------
        DeviceError
            There is no such board.
        """
        self._closing.clear()
        self._connect()
        if self._wanted.actuator:
            try:
                self._ask(Arm(), lambda: self.armed, "does not arm; is the amplifier at fault?")
            except DeviceError:
                self._disconnect()
                raise
        self._thread = threading.Thread(target=self._run, name="serial", daemon=True)
        self._thread.start()

    def set_current(self, current: float) -> None:
        """Send a set-point in A: at most full scale, and zero for what is not finite."""
        identity = self.identity
        if identity is None or not self.armed:
            self._counts["set_points_refused"] += 1
            return
        share = current / identity.full_scale_current
        if not abs(share) <= 1:
            self._counts["set_points_limited"] += 1
            share = math.copysign(1.0, share) if math.isfinite(share) else 0.0
        self._send(SetCurrent(round(share * FULL_SCALE)))

    def arm(self) -> bool:
        """Ask the board to allow a current, also after a fault; whether there is one to ask."""
        if not self._ready:
            return False
        self._rearm = self._wanted.rearm
        if self._board is not None and self._board.state is State.FAULT:
            self._send(Disarm())
        return self._send(Arm())

    def disarm(self) -> bool:
        """Ask the board to take the current off; whether there is a board to ask."""
        self._rearm = False
        return self._send(Disarm())

    def close(self) -> None:
        """Leave the board without current and without samples; also when never opened."""
        self._closing.set()
        if self._thread is not None:
            port = self._port
            if port is not None:
                port.wake()
            self._thread.join()
            self._thread = None
        if self._port is not None:
            self._leave()
        self._disconnect()

    @property
    def connected(self) -> bool:
        """Whether the board is there, and the one wanted."""
        return self._ready

    @property
    def delay(self) -> float:
        """Age at which samples are there for almost every tick, s."""
        clock = self._clock
        return clock.delay if clock is not None else 0.0

    @property
    def armed(self) -> bool:
        """Whether the board says that it allows a current."""
        board = self._board
        allows = board is not None and board.state in (State.ARMED, State.TIMED_OUT)
        return self._ready and allows

    @property
    def refusal(self) -> str:
        """Why there are no samples or no current, in one line; empty where there may be."""
        board = self._board
        if not self._ready or board is None or not self._wanted.actuator or self.armed:
            return self.problem
        return f"{self._name}: {REFUSALS[board.state]}"

    def status(self) -> dict[str, int]:
        """Return counts of both sides, by name."""
        decoder, board = self._decoder, self._board
        counts = {
            "connected": int(self.connected),
            "armed": int(self.armed),
            "frames_received": decoder.received,
            "frames_damaged": decoder.damaged,
            "frames_lost": decoder.lost,
            **{name: self._counts[name] for name in COUNTED},
        }
        if board is not None:
            counts["board_state"] = int(board.state)
            for name in ("damaged", "lost", "refused", "timeouts", "unsent"):
                counts[f"board_{name}"] = getattr(board, name)
        return counts

    # Connecting

    def _connect(self) -> None:
        """Open the port, see who is there, and let it sample.

        Raises
        ------
        DeviceError
            There is no such board.
        """
        self._forget()
        port = Port(find_port(*self._where), self._baud)
        try:
            self._port = port
            self._greet()
        except DeviceError:
            self._disconnect()
            raise
        self._last_frame = time.monotonic()
        self.problem = ""
        self._ready = True

    def _greet(self) -> None:
        # What came before the first delimiter is no frame.
        self._write(DELIMITER)
        self._send(Disarm())
        self._ask(Identify(), lambda: self._answered is not None, "")
        assert self._answered
        self._check(self._answered)
        self.identity = self._answered
        wanted = self._wanted.configuration
        self._clock = SampleClock(wanted.rate, wanted.samples_per_frame)
        ask = Configure(wanted.rate, wanted.axes, wanted.samples_per_frame)
        self._ask(ask, lambda: self._configuration == wanted, f"refuses {wanted}")

    def _ask(self, question: Message, answered: Callable[[], bool], otherwise: str) -> None:
        """Ask until there is an answer."""
        deadline = time.monotonic() + ANSWER
        again = 0.0
        while not answered():
            now = time.monotonic()
            if now > deadline or self._closing.is_set():
                raise DeviceError(f"{self._name}: {self._silence() or otherwise}")
            if now > again:
                self._send(question)
                again = now + ASK_AGAIN
            self._listen()

    def _silence(self) -> str:
        """Say why whoever is there does not answer, if it can be told."""
        if self._version is not None:
            return (
                f"speaks version {self._version} of the protocol, must be {VERSION}: load the"
                " firmware that came with this driver"
            )
        if self._answered is None:
            return "no answer; is there a board with this firmware, and the right baud rate?"
        return ""

    def _leave(self) -> None:
        """Take current and samples off, and wait a little for the board to say so."""
        self._configuration = None
        self._send(Disarm())
        # Answered after the other, and unlike a status never sent unasked.
        self._send(Configure(0, 0, 0))
        deadline = time.monotonic() + ENDING
        with suppress(DeviceError):
            while self._configuration is None and time.monotonic() < deadline:
                self._listen()

    def _check(self, identity: Identity) -> None:
        """Refuse a board that is not the one wanted.

        Raises
        ------
        DeviceError
            Saying what it lacks.
        """
        wanted = self._wanted
        number = identity.serial_number
        first = self.identity.serial_number if self.identity else number
        if wanted.serial_number not in ("", number):
            lacking = f"must be {wanted.serial_number}, of which the calibration is"
        elif number != first:
            lacking = f"must be {first}, which was there at the start"
        elif wanted.actuator and not identity.full_scale_current:
            lacking = "has no actuator"
        elif wanted.configuration.axes & ~identity.axes:
            lacking = "has not the accelerometer's axis that is asked for"
        elif wanted.configuration.rate > identity.highest_rate:
            rate = wanted.configuration.rate
            lacking = f"takes {identity.highest_rate} samples per second at most, not {rate}"
        else:
            return
        raise DeviceError(f"{self._name}: board {number} {lacking}")

    @property
    def _name(self) -> str:
        return self._port.path if self._port else ""

    def _forget(self) -> None:
        """Know nothing of a board."""
        self._decoder.restart()
        self._answered = self._configuration = self._board = self._version = None
        self._clock = self._next_index = None
        self._whole_clock, self._whole_index = Unwrapped(), Unwrapped()

    def _disconnect(self) -> None:
        with self._writing:
            port, self._port = self._port, None
            self._ready, self._board = False, None
        if port is not None:
            port.close()

    # The thread

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                if self._port is None:
                    self._connect()
                    self._counts["reconnects"] += 1
                self._listen()
                if time.monotonic() - self._last_frame > SILENCE:
                    raise DeviceError(f"{self._name}: silent for {SILENCE:g} s")
            except DeviceError as error:
                self.problem = str(error)
                self._disconnect()
                self._closing.wait(RETRY)

    def _listen(self) -> None:
        """Take what comes next, if anything does."""
        port = self._port
        assert port is not None
        data = port.read()
        arrival = time.monotonic()
        for frame in self._decoder.feed(data):
            self._last_frame = arrival
            self._understand(frame, arrival)

    def _understand(self, frame: Frame, arrival: float) -> None:
        try:
            message = read_message(frame)
        except PayloadError:
            self._counts["frames_wrong"] += 1
            self._version = None if frame.version == VERSION else frame.version
            return
        match message:
            case Samples():
                self._take_samples(frame.clock, message, arrival)
            case Status():
                self._board = message
                if self._rearm and self._ready and message.state is State.DISARMED:
                    self._send(Arm())
            case Identity():
                self._answered = message
            case Configuration():
                self._configuration = message
            case Error():
                self._counts["refusals"] += 1

    def _take_samples(self, clock: int, samples: Samples, arrival: float) -> None:
        wanted = self._wanted.configuration
        if self._clock is None or self._configuration is None or samples.axes != wanted.axes:
            return  # of a configuration before
        index = self._whole_index.add(samples.index)
        number = len(samples.counts) // samples.axes.bit_count()
        if self._next_index is not None:
            self._counts["samples_lost"] += max(0, index - self._next_index)
        self._next_index = index + number
        self._clock.add(index, self._whole_clock.add(clock), arrival)
        self._take([self._clock.time(index + place) for place in range(number)], samples)

    # Writing, by any thread

    def _send(self, message: Message) -> bool:
        with self._writing:
            now = round(time.monotonic() / MICROSECOND)
            return self._write(self._encoder.encode(message, now))

    def _write(self, data: bytes) -> bool:
        if self._port is None:
            return False
        try:
            room = self._port.write(data)
        except DeviceError:
            return False  # the reader finds it gone as well, and says so
        if not room:
            self._counts["frames_unsent"] += 1
        return room


COUNTED = (
    "frames_wrong",
    "frames_unsent",
    "refusals",
    "reconnects",
    "samples_lost",
    "set_points_refused",
    "set_points_limited",
)
"""What a link counts besides its decoder."""

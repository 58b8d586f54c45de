"""State machine of the firmware, the same as `firmware/haptic_handle/board.cpp`.

Time and port are given from outside. Times are us of the device's clock, modulo 2**32.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from haptic_accel.devices.serial import protocol
from haptic_accel.devices.serial.protocol import CLOCKS, Configuration, ErrorCode, Frame, State

TIMEOUT = 5_000
"""Longest time without a set-point while a current may flow, us."""

STATUS_PERIOD = 100_000
"""Period of statuses that are sent without a request, us."""

LOWEST_RATE = 50
"""Lowest sampling rate, Hz."""

SILENT = Configuration(0, 0, 0)
"""Configuration before the host sends one."""


class Board:
    """Board: bytes from the host and samples of its accelerometer in, frames and a current out.

    It sends nothing before it has received an intact frame.

    Parameters
    ----------
    identity : Identity
        Identity of the board; without a full-scale current it has no actuator.
    send : callable
        Sends a frame's bytes; returns False if there was no room for them.

    Attributes
    ----------
    configuration : Configuration
    state : State
    current : int
        Set-point of the current, counts of `FULL_SCALE`; 0 unless armed.
    """

    def __init__(self, identity: protocol.Identity, send: Callable[[bytes], bool]) -> None:
        self._identity = identity
        self._has_actuator = identity.full_scale_current > 0
        self._send_bytes = send
        self._decoder = protocol.Decoder()
        self._encoder = protocol.Encoder()
        self.configuration = SILENT
        self.state = State.DISARMED
        self.current = 0
        self._index = 0
        self._pending: list[int] = []
        self._pending_clock = 0
        self._last_set = 0
        self._last_status = 0
        self._contacted = False
        self._faulty = False
        self._refused = self._timeouts = self._unsent = 0

    def receive(self, data: bytes, now: int) -> None:
        """Process bytes from the host."""
        for frame in self._decoder.feed(data):
            if not self._contacted:
                self._contacted = True
                self._last_status = now
            self._execute(frame, now)

    def sample(self, values: Sequence[int], now: int) -> None:
        """Process a sample, counts by axis x, y, z, taken at a time."""
        configuration = self.configuration
        if not configuration.rate:
            return
        if not self._pending:
            self._pending_clock = now
        self._pending += [v for axis, v in enumerate(values) if configuration.axes >> axis & 1]
        taken = len(self._pending) // configuration.axes.bit_count()
        if taken == configuration.samples_per_frame:
            frame = protocol.Samples(self._index, configuration.axes, tuple(self._pending))
            self._send(frame, self._pending_clock)
            self._index = (self._index + taken) % CLOCKS
            self._pending.clear()

    def tick(self, now: int) -> None:
        """Check time-outs and periods; called at least every ms."""
        if self.state is State.ARMED and (now - self._last_set) % CLOCKS > TIMEOUT:
            self._timeouts += 1
            self._enter(State.TIMED_OUT, now)
        if self._contacted and (now - self._last_status) % CLOCKS >= STATUS_PERIOD:
            self._report(now)

    def fault(self, present: bool, now: int) -> None:
        """Process the amplifier's fault signal; a fault stays until the host disarms."""
        appeared = present and not self._faulty
        self._faulty = present
        if appeared:
            self._enter(State.FAULT, now)

    def disconnect(self) -> None:
        """Forget a host that has closed the port; counts stay."""
        self._decoder.restart()
        self.configuration = SILENT
        self._pending.clear()
        self._contacted = False
        self.current = 0
        if self.state is not State.FAULT:
            self.state = State.DISARMED

    def _execute(self, frame: Frame, now: int) -> None:
        refusal = self._refusal(frame)
        if refusal:
            self._send(protocol.Error(refusal, frame.type, frame.sequence), now)
            return
        match protocol.read_message(frame):
            case protocol.Identify():
                self._send(self._identity, now)
            case protocol.Configure() as asked:
                # Sampling restarts; with a rate of 0, axes and number have no meaning.
                self.configuration = Configuration(**vars(asked)) if asked.rate else SILENT
                self._index = 0
                self._pending.clear()
                self._send(self.configuration, now)
            case protocol.ArmRequest():
                if self.state is State.ARMED:
                    self._report(now)
                else:
                    self._last_set = now
                    self._enter(State.ARMED, now)
            case protocol.DisarmRequest():
                self._enter(State.DISARMED, now)
            case protocol.SetCurrent(counts):
                self._set_current(counts, now)

    def _refusal(self, frame: Frame) -> ErrorCode | None:
        """Return the reason for refusing a frame; None to accept it."""
        if frame.version != protocol.VERSION:
            return ErrorCode.VERSION
        if frame.type not in protocol.REQUESTS:
            return ErrorCode.TYPE
        if len(frame.payload) != protocol.REQUESTS[frame.type].LAYOUT.size:
            return ErrorCode.LENGTH
        match protocol.read_message(frame):
            case protocol.ArmRequest() | protocol.SetCurrent() if not self._has_actuator:
                return ErrorCode.NO_ACTUATOR
            case protocol.ArmRequest() if self.state is State.FAULT:
                return ErrorCode.FAULT
            case protocol.DisarmRequest() if self._faulty:
                return ErrorCode.FAULT
            case protocol.Configure() as asked if asked.rate and not self._can(asked):
                return ErrorCode.VALUE
        return None

    def _can(self, asked: protocol.Configure) -> bool:
        return (
            LOWEST_RATE <= asked.rate <= self._identity.highest_rate
            and asked.axes != 0
            and asked.axes & ~self._identity.axes == 0
            and 1 <= asked.samples_per_frame <= protocol.most_samples(asked.axes)
        )

    def _set_current(self, counts: int, now: int) -> None:
        if self.state not in (State.ARMED, State.TIMED_OUT):
            self._refused += 1
            return
        self.state = State.ARMED
        self._last_set = now
        self.current = max(-protocol.FULL_SCALE, counts)

    def _enter(self, state: State, now: int) -> None:
        """Change the state; no current flows until the next set-point."""
        self.state = state
        self.current = 0
        self._report(now)

    def _report(self, now: int) -> None:
        self._last_status = now
        decoder = self._decoder
        counts = (
            *(decoder.received, decoder.damaged, decoder.lost),
            *(self._refused, self._timeouts, self._unsent),
        )
        self._send(protocol.Status(self.state, self.current, *(n % CLOCKS for n in counts)), now)

    def _send(self, message: protocol.Message, now: int) -> None:
        if self._contacted and not self._send_bytes(self._encoder.encode(message, now)):
            self._unsent += 1

"""The device's side of the protocol, for the emulator; `firmware/haptic_handle/board.cpp` in C++.

Nothing here knows the time or a port: both are given. Times are us of the device's clock,
modulo 2**32.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from haptic_accel.devices.serial.protocol import (
    AXES,
    FULL_SCALE,
    REQUESTS,
    VERSION,
    ArmRequest,
    Configuration,
    Configure,
    Decoder,
    DisarmRequest,
    Encoder,
    Error,
    ErrorCode,
    Frame,
    FrameType,
    Identify,
    Identity,
    Message,
    Samples,
    SetCurrent,
    State,
    Status,
    most_samples,
    read_message,
)

TIMEOUT = 5_000
"""Longest time without a set-point while a current may flow, us."""

STATUS_PERIOD = 100_000
"""A status is sent as often unasked, us."""

LOWEST_RATE = 50
"""Samples per second."""

CLOCKS = 1 << 32
"""A clock, and a count of samples, begins anew after as many."""

SILENT = Configuration(0, 0, 0)
"""Before the host has configured it."""


class Board:
    """Takes bytes of the host and samples of its accelerometer, gives frames and a current.

    It says nothing before it has heard an intact frame.

    Parameters
    ----------
    identity : Identity
        What it is; without a full-scale current it has no actuator.
    send : callable
        Takes a frame's bytes; says whether there was room for them.

    Attributes
    ----------
    configuration : Configuration
    state : State
    current : int
        That is to flow, counts of `FULL_SCALE`; 0 unless armed.
    """

    def __init__(self, identity: Identity, send: Callable[[bytes], bool]) -> None:
        self._identity = identity
        self._send_bytes = send
        self._decoder = Decoder()
        self._encoder = Encoder()
        self.configuration = SILENT
        self.state = State.DISARMED
        self.current = 0
        self._index = 0
        self._pending: list[int] = []
        self._pending_clock = 0
        self._last_set = 0
        self._last_status = 0
        self._heard = False
        self._faulty = False
        self._refused = self._timeouts = self._unsent = 0

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes of the host."""
        for frame in self._decoder.feed(data):
            if not self._heard:
                self._heard = True
                self._last_status = now
            self._obey(frame, now)

    def sample(self, values: Sequence[int], now: int) -> None:
        """Take a sample, counts by axis x, y, z, and the moment it was taken at."""
        configuration = self.configuration
        if not configuration.rate:
            return
        if not self._pending:
            self._pending_clock = now
        self._pending += [
            values[axis] for axis in range(len(AXES)) if configuration.axes >> axis & 1
        ]
        taken = len(self._pending) // configuration.axes.bit_count()
        if taken == configuration.samples_per_frame:
            frame = Samples(self._index, configuration.axes, tuple(self._pending))
            self._send(frame, self._pending_clock)
            self._index = (self._index + taken) % CLOCKS
            self._pending.clear()

    def tick(self, now: int) -> None:
        """Look at the time: called at least every ms."""
        if self.state is State.ARMED and (now - self._last_set) % CLOCKS > TIMEOUT:
            self._timeouts += 1
            self._enter(State.TIMED_OUT, now)
        if self._heard and (now - self._last_status) % CLOCKS >= STATUS_PERIOD:
            self._report(now)

    def fault(self, present: bool, now: int) -> None:
        """Take what the amplifier says of itself; a fault stays until the host disarms."""
        appeared = present and not self._faulty
        self._faulty = present
        if appeared:
            self._enter(State.FAULT, now)

    def disconnect(self) -> None:
        """Let go of a host that has closed the port; counts stay."""
        self._decoder.restart()
        self.configuration = SILENT
        self._pending.clear()
        self._heard = False
        self.current = 0
        if self.state is not State.FAULT:
            self.state = State.DISARMED

    def _obey(self, frame: Frame, now: int) -> None:
        refusal = self._refusal(frame)
        if refusal:
            self._send(Error(refusal, frame.type, frame.sequence), now)
            return
        match read_message(frame):
            case Identify():
                self._send(self._identity, now)
            case Configure() as asked:
                self._configure(asked, now)
            case ArmRequest():
                if self.state is State.ARMED:
                    self._report(now)
                else:
                    self._last_set = now
                    self._enter(State.ARMED, now)
            case DisarmRequest():
                self._enter(State.DISARMED, now)
            case SetCurrent(counts):
                self._set_current(counts, now)

    def _refusal(self, frame: Frame) -> ErrorCode | None:
        """Return why a frame is not obeyed; None if it is."""
        if frame.version != VERSION:
            return ErrorCode.VERSION
        if frame.type not in REQUESTS:
            return ErrorCode.TYPE
        if len(frame.payload) != REQUESTS[frame.type].LAYOUT.size:
            return ErrorCode.LENGTH
        if frame.type in (FrameType.ARM, FrameType.SET_CURRENT) and not self._has_actuator:
            return ErrorCode.NO_ACTUATOR
        if frame.type == FrameType.ARM and self.state is State.FAULT:
            return ErrorCode.FAULT
        if frame.type == FrameType.DISARM and self._faulty:
            return ErrorCode.FAULT
        if frame.type == FrameType.CONFIGURE and not self._can(frame):
            return ErrorCode.VALUE
        return None

    @property
    def _has_actuator(self) -> bool:
        return self._identity.full_scale_current > 0

    def _can(self, frame: Frame) -> bool:
        asked = read_message(frame)
        assert isinstance(asked, Configure)
        if asked.rate == 0:
            return True
        return (
            LOWEST_RATE <= asked.rate <= self._identity.highest_rate
            and asked.axes != 0
            and asked.axes & ~self._identity.axes == 0
            and 1 <= asked.samples_per_frame <= most_samples(asked.axes)
        )

    def _configure(self, asked: Configure, now: int) -> None:
        """Begin to sample anew; without samples, axes and number mean nothing."""
        self.configuration = (
            Configuration(asked.rate, asked.axes, asked.samples_per_frame)
            if asked.rate
            else SILENT
        )
        self._index = 0
        self._pending.clear()
        self._send(self.configuration, now)

    def _set_current(self, counts: int, now: int) -> None:
        if self.state not in (State.ARMED, State.TIMED_OUT):
            self._refused += 1
            return
        self.state = State.ARMED
        self._last_set = now
        self.current = max(-FULL_SCALE, counts)

    def _enter(self, state: State, now: int) -> None:
        """Change the state; whatever the change, no current flows until a set-point comes."""
        self.state = state
        self.current = 0
        self._report(now)

    def _report(self, now: int) -> None:
        self._last_status = now
        status = Status(
            self.state,
            self.current,
            self._decoder.received % CLOCKS,
            self._decoder.damaged % CLOCKS,
            self._decoder.lost % CLOCKS,
            self._refused % CLOCKS,
            self._timeouts % CLOCKS,
            self._unsent % CLOCKS,
        )
        self._send(status, now)

    def _send(self, message: Message, now: int) -> None:
        if not self._heard:
            return
        if not self._send_bytes(self._encoder.encode(message, now)):
            self._unsent += 1

# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated boards on pseudo-terminals, and the coupling of their arms.

Bytes are exchanged when the emulator wakes. Samples and forces are then processed in order, each
with its own time, so that a late wake-up loses none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path

from haptic_accel import Vector
from haptic_accel.core import ZERO, Engagement, EngagementParameters, SafetyParameters, tick
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import SimulatedDevice
from haptic_accel.devices.serial import protocol
from haptic_accel.devices.serial.protocol import CLOCKS, FULL_SCALE, ErrorCode, FrameType, State
from haptic_accel.kits.emulators import ports

TIMEOUT = 5_000
"""Maximum time without a set-point while a current may flow, us."""

STATUS_PERIOD = 100_000
"""Interval of unrequested status messages, us."""

LOWEST_RATE = 50
"""Minimum sampling rate, Hz."""

ROOM = 32
"""Maximum number of scheduled set-points; the maximum latency is 20 samples."""

LONGEST_LEAD = 500_000
"""Maximum time from a scheduled set-point's arrival to its due time, us: slightly more than 20
samples at the minimum rate."""

SECOND, MICROSECOND = 1_000_000_000, 1_000
"""Nanoseconds in a second and in a microsecond."""

TOLERANCE = 64
"""Inverse of the maximum relative deviation of a grid's period from the nominal."""

LARGEST_STEP = 32
"""Inverse of the maximum relative deviation of a sampling interval from the grid's period."""

SMOOTHING = 4
"""Number of ticks in which a distance from the grid is removed. As a timer uses a new interval one
tick later, a quarter per tick is the fastest correction without overshoot."""

DRIVING = FrameType.ARM, FrameType.SET_CURRENT, FrameType.SCHEDULE_CURRENT
"""Types of frames for an actuator."""

SILENT = protocol.Configuration(0, 0, 0)
"""Configuration before the host has sent one."""


class Board:
    """Board with input of bytes and accelerometer samples, and output of frames and currents.

    The board sends nothing until an intact frame arrives.

    Parameters
    ----------
    identity : Identity
        Identity of the board; without a full-scale current it has no actuator.
    send : callable
        Function that sends a frame's bytes; returns False if there was no room.

    Attributes
    ----------
    configuration : Configuration
    state : State
    currents : tuple of int
        Set-points of the coils' currents, counts of `FULL_SCALE`; 0 unless armed.
    period : int
        Time from this sampling tick to the next, ns; 0 without samples.
    """

    def __init__(self, identity: protocol.Identity, send: Callable[[bytes], bool]) -> None:
        self._identity = identity
        self._coils = len(identity.coils)
        self._send_bytes = send
        self._decoder = protocol.Decoder()
        self._encoder = protocol.Encoder()
        self.state = State.DISARMED
        self._switch_off()
        self._scheduled: list[protocol.ScheduleCurrent] = []
        self._last_tick: int | None = None
        self._index = 0
        self._pending: list[int] = []
        self._pending_clock = 0
        self._last_set = 0
        self._last_status = 0
        self._contacted = False
        self._faulty = False
        self._refused = self._timeouts = self._unsent = self._late = self._overflowed = 0
        self._configure(SILENT)

    def receive(self, data: bytes, now: int) -> None:
        """Process bytes from the host."""
        for frame in self._decoder.feed(data):
            if not self._contacted:
                self._contacted = True
                self._last_status = now
            self._execute(frame, now)

    def send_sample(self, values: Sequence[int], now: int) -> None:
        """Process a tick's sample, counts by axis x, y, z, then apply set-points that are due."""
        configuration = self.configuration
        if not configuration.rate:
            return
        self._follow_grid(now)
        self._last_tick = now
        while self._scheduled and self._passed(self._scheduled[0].due):
            self._apply(self._scheduled.pop(0))
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
        """Check timeouts and periods; call it at least every ms."""
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
        """Forget a host that has closed the port; counts remain."""
        self._decoder.restart()
        self._configure(SILENT)
        self._contacted = False
        self._switch_off()
        if self.state is not State.FAULT:
            self.state = State.DISARMED

    def _execute(self, frame: protocol.Frame, now: int) -> None:
        refusal = self._refusal(frame)
        if refusal:
            self._send(protocol.Error(refusal, frame.type, frame.sequence), now)
            return
        match protocol.read_message(frame):
            case protocol.Identify():
                self._send(self._identity, now)
            case protocol.Configure() as asked:
                # At a rate of 0, the other fields have no meaning.
                self._configure(protocol.Configuration(**vars(asked)) if asked.rate else SILENT)
                self._send(self.configuration, now)
            case protocol.Align(tick, period):
                self._grid, self._grid_fraction, self._grid_period = tick, 0, period
            case protocol.ArmRequest():
                if self.state is State.ARMED:
                    self._report(now)
                else:
                    self._last_set = now
                    self._enter(State.ARMED, now)
            case protocol.DisarmRequest():
                self._enter(State.DISARMED, now)
            case protocol.SetCurrent() | protocol.ScheduleCurrent() as set_point:
                self._receive_set_point(set_point, now)

    def _refusal(self, frame: protocol.Frame) -> ErrorCode | None:
        """Return the reason for rejecting a frame; None to accept it."""
        if frame.version != protocol.VERSION:
            return ErrorCode.VERSION
        if frame.type not in protocol.REQUESTS:
            return ErrorCode.TYPE
        if frame.type in DRIVING and not self._coils:
            return ErrorCode.NO_ACTUATOR
        if len(frame.payload) != protocol.REQUESTS[frame.type].size(self._coils):
            return ErrorCode.LENGTH
        match protocol.read_message(frame):
            case protocol.ArmRequest() if self.state is State.FAULT:
                return ErrorCode.FAULT
            case protocol.DisarmRequest() if self._faulty:
                return ErrorCode.FAULT
            case protocol.Configure() as asked if asked.rate and not self._can(asked):
                return ErrorCode.VALUE
            case protocol.Align(_, period) if not self._can_follow(period):
                return ErrorCode.VALUE
        return None

    def _can(self, asked: protocol.Configure) -> bool:
        return (
            LOWEST_RATE <= asked.rate <= self._identity.highest_rate
            and asked.axes != 0
            and asked.axes & ~self._identity.axes == 0
            and 1 <= asked.samples_per_frame <= protocol.most_samples(asked.axes)
        )

    def _can_follow(self, period: int) -> bool:
        rate = self.configuration.rate
        return rate > 0 and abs(period * rate - SECOND) <= SECOND // TOLERANCE

    def _configure(self, configuration: protocol.Configuration) -> None:
        """Restart sampling, with ticks that do not follow a grid yet."""
        rate = configuration.rate
        self.configuration = configuration
        self.period = (SECOND + rate // 2) // rate if rate else 0
        self._grid = self._grid_fraction = self._grid_period = 0
        self._last_tick = None
        self._index = 0
        self._pending.clear()
        self._scheduled.clear()

    def _follow_grid(self, now: int) -> None:
        """Move to the grid point nearest to a tick, and schedule the next tick at the next point.

        A point is stored as whole us and the remaining ns.
        """
        period = self._grid_period
        if not period:
            return
        distance = difference(now, self._grid) * MICROSECOND - self._grid_fraction
        points = (distance + period // 2) // period
        fraction = self._grid_fraction + points * period
        self._grid = (self._grid + fraction // MICROSECOND) % CLOCKS
        self._grid_fraction = fraction % MICROSECOND
        step = math.trunc((distance - points * period) / SMOOTHING)
        largest = period // LARGEST_STEP
        self.period = period - min(max(step, -largest), largest)

    def _passed(self, due: int) -> bool:
        """Return True if a set-point is due at the last tick or earlier."""
        assert self._last_tick is not None
        return 2 * MICROSECOND * difference(due, self._last_tick) <= self.period

    def _receive_set_point(
        self, set_point: protocol.SetCurrent | protocol.ScheduleCurrent, now: int
    ) -> None:
        scheduled = set_point if isinstance(set_point, protocol.ScheduleCurrent) else None
        too_early = scheduled and difference(scheduled.due, now) > LONGEST_LEAD
        if too_early or self.state not in (State.ARMED, State.TIMED_OUT):
            self._refused += 1
            return
        self.state = State.ARMED
        self._last_set = now
        if scheduled and self._last_tick is not None:
            self._schedule(scheduled)
        else:
            self._scheduled.clear()
            self._apply(set_point)

    def _schedule(self, set_point: protocol.ScheduleCurrent) -> None:
        """Store a set-point until its tick, in order of due times."""
        if self._passed(set_point.due):
            self._late += 1
            self._apply(set_point)
        elif len(self._scheduled) == ROOM:
            self._overflowed += 1
        else:
            index = len(self._scheduled)
            while index and difference(self._scheduled[index - 1].due, set_point.due) > 0:
                index -= 1
            self._scheduled.insert(index, set_point)

    def _apply(self, set_point: protocol.SetCurrent | protocol.ScheduleCurrent) -> None:
        self.currents = tuple(max(-protocol.FULL_SCALE, counts) for counts in set_point.counts)

    def _switch_off(self) -> None:
        self.currents = (0,) * self._coils

    def _enter(self, state: State, now: int) -> None:
        """Change the state; no current flows until the next set-point."""
        self.state = state
        self._switch_off()
        self._scheduled.clear()
        self._report(now)

    def _report(self, now: int) -> None:
        self._last_status = now
        decoder = self._decoder
        counts = (
            *(decoder.received, decoder.damaged, decoder.lost),
            *(self._refused, self._timeouts, self._unsent, self._late, self._overflowed),
        )
        self._send(protocol.Status(self.state, self.currents, *(n % CLOCKS for n in counts)), now)

    def _send(self, message: protocol.Message, now: int) -> None:
        if self._contacted and not self._send_bytes(self._encoder.encode(message, now)):
            self._unsent += 1


def difference(later: int, earlier: int) -> int:
    """Return the signed difference of two times, us, modulo the clock's range."""
    return (later - earlier + CLOCKS // 2) % CLOCKS - CLOCKS // 2


STEP = 1e-3
"""Period of the coupling and of the boards' timeouts, s (paper's servo loop)."""

LONGEST_DELAY = 0.1
"""Delay after which overdue samples and forces are skipped, s."""

MOST_GARBAGE, MOST_DROPPED = 40, 8
"""Maximum number of bytes added and removed at once."""

CLOCK_START = CLOCKS - 20_000_000
"""Start of a board's clock, us: it wraps around 20 s later."""


class EmulatedBoard:
    """Board on a pseudo-terminal, on a line with faults; times are s since the start.

    Parameters
    ----------
    identity : Identity
    path : Path
        Symbolic link to make to the terminal.
    measure : callable
        Function from a time to the acceleration along the sensor's axes, m/s^2.
    drive : callable, optional
        Function called with a time and the coils' currents from then on, A.
    faults : Faults, optional
    drift : float
        Relative error of the clock rate.

    Attributes
    ----------
    board : Board
        State of the firmware; an unplugged board loses its power, and thus its state.
    faults : Faults
    open : bool
        True while a host has the port open.
    due : float
        Time of the next sample; infinite without samples.
    """

    def __init__(
        self,
        identity: protocol.Identity,
        path: Path,
        measure: Callable[[float], Vector],
        drive: Callable[[float, Vector], None] | None = None,
        faults: ports.Faults | None = None,
        drift: float = 0.0,
    ) -> None:
        self._identity = identity
        self._port = ports.PseudoTerminal(path)
        self._measure = measure
        self._drive = drive
        self._driven = ZERO
        self._held_out = self._held_in = b""
        self._clock_rate = 1e6 * (1 + drift)
        self.board = Board(identity, self._send)
        self.faults = faults or ports.Faults()
        self.open = False
        self.due = math.inf

    @property
    def terminal(self) -> ports.PseudoTerminal | None:
        """Port to wait for; None while no host has it open."""
        return self._port if self.open and self._port.plugged else None

    @property
    def currents(self) -> Vector:
        """Currents of the coils along x, y and z, A."""
        scales = self._identity.full_scale_currents
        counts = iter(self.board.currents)
        x, y, z = (next(counts) / FULL_SCALE * scale if scale else 0.0 for scale in scales)
        return x, y, z

    @property
    def rate(self) -> int:
        """Sampling rate configured by the host, Hz; 0 for none."""
        return self.board.configuration.rate

    def exchange(self, now: float) -> None:
        """Exchange bytes with the host, and apply immediate commands."""
        self.faults.advance(now)
        if not self.faults.active(ports.UNPLUG):
            self._port.plug()
        elif self._port.plugged:
            self._port.unplug()
            self.board = Board(self._identity, self._send)
        self._receive(now)
        self.board.tick(self._clock(now))
        stalled = self.faults.active(ports.STALL)
        if self._held_out and not stalled and self._port.write(self._held_out):
            self._held_out = b""
        if not self.rate:
            self.due = math.inf
        elif self.due == math.inf:
            # The next whole multiple of the period, so that both boards sample together.
            self.due = math.ceil(now * self.rate) / self.rate
        self._apply_current(min(now, self.due))

    def step(self) -> None:
        """Take the sample that is due, and apply the currents from then on."""
        tick = self.due
        full_scale = self._identity.full_scale_acceleration
        shares = (acceleration / full_scale for acceleration in self._measure(tick))
        counts = [round(min(1.0, max(-1.0, share)) * FULL_SCALE) for share in shares]
        self.board.send_sample(counts, self._clock(tick))
        self._apply_current(tick)
        self.due += self._period

    def skip(self, before: float) -> None:
        """Skip the samples that were due before a time."""
        if self.due < before:
            self.due += math.ceil((before - self.due) / self._period) * self._period

    def close(self) -> None:
        """Remove the port."""
        self._port.unplug()

    @property
    def _period(self) -> float:
        """Time from one sample to the next, s."""
        return self.board.period / 1e3 / self._clock_rate

    def _clock(self, time: float) -> int:
        """Return the board's clock at a time in s, us."""
        return (CLOCK_START + round(time * self._clock_rate)) % CLOCKS

    def _apply_current(self, time: float) -> None:
        if self._drive and self.currents != self._driven:
            self._driven = self.currents
            self._drive(time, self._driven)

    def _receive(self, now: float) -> None:
        data = self._port.read()
        was_open, self.open = self.open, data is not None
        if data is None:
            if was_open:
                self.board.disconnect()
                self._held_out = self._held_in = b""
            return
        data = self._held_in + data
        stalled = self.faults.active(ports.STALL)
        self._held_in = data[-ports.BUFFER :] if stalled else b""
        if data and not stalled:
            self.board.receive(self._spoiled(data), self._clock(now))

    def _send(self, data: bytes) -> bool:
        if not (self.faults.active(ports.STALL) or self._held_out):
            return self._port.write(self._spoiled(data))
        room = len(self._held_out) + len(data) <= ports.BUFFER
        self._held_out += data if room else b""
        return room

    def _spoiled(self, data: bytes) -> bytes:
        """Return bytes as delivered by a line with faults."""
        random = self.faults.random
        if self.faults.strikes(ports.DROP):
            start = random.randrange(len(data))
            data = data[:start] + data[start + random.randint(1, MOST_DROPPED) :]
        if self.faults.strikes(ports.GARBAGE):
            start = random.randrange(len(data) + 1)
            garbage = random.randbytes(random.randint(1, MOST_GARBAGE))
            data = data[:start] + garbage + data[start:]
        return data


class CoupledArms:
    """Arms of both devices, coupled while both boards are sampling.

    At the first force, the hand starts to explore and the clock of planned faults starts. A force
    acts from its sample on, as the emulated robot has no latency.

    Parameters
    ----------
    boards : sequence of EmulatedBoard
    devices : sequence of SimulatedDevice
        Master and slave.
    coupling : PositionPositionCoupling

    Attributes
    ----------
    coupled : bool
        True while both boards are sampled.
    """

    def __init__(
        self,
        boards: Sequence[EmulatedBoard],
        devices: Sequence[SimulatedDevice],
        coupling: tick.PositionPositionCoupling,
    ) -> None:
        self._boards, self._devices, self._coupling = boards, devices, coupling
        self._tick = 0
        self._build()

    def _build(self) -> None:
        """Start with free arms."""
        self._sides = dict(zip(ARMS, map(_side, self._devices), strict=True))
        engagement = Engagement(EngagementParameters(), now=self.due)
        for arm in ARMS:
            engagement.arm_stopped(arm, False)
        self._part = tick.CouplingPart(self._coupling, engagement, 1 / STEP)
        self._loop = tick.HostLoop(self._sides, self._part, decide=self._couple)
        self.coupled = False

    @property
    def due(self) -> float:
        """Time of the next step, s."""
        return self._tick * STEP

    def skip(self, before: float) -> None:
        """Skip the forces that were due before a time."""
        self._tick = max(self._tick, math.ceil(before / STEP))

    def step(self) -> None:
        """Exchange the forces of the arms, which are free unless both boards are sampling."""
        if self.coupled and not self._sampled:
            for side in self._sides.values():
                side.device.write(self.due, arm_force=ZERO)
            self._coupling.disengage()
            self._build()
        self._loop.step(self._tick)
        self._tick += 1

    @property
    def _sampled(self) -> bool:
        return all(board.rate for board in self._boards)

    def _couple(self, now: float) -> None:
        """Couple the arms once, as soon as both boards are sampling."""
        if not self.coupled and self._sampled:
            self.coupled = self._part.poll(now, listeners=1).engage
            for board in self._boards if self.coupled else ():
                board.faults.begin()


def _side(device: SimulatedDevice) -> tick.DeviceSide:
    """Return a device's arm behind a safety layer that allows forces."""
    safety = tick.SafetyLayer(SafetyParameters(), 1 / STEP)
    safety.enable(0.0, True)
    return tick.DeviceSide(device, safety, 1 / STEP, latency=0, kinds=[tick.ARM])


class SerialLines:
    """Boards and their arms, processed in order of time.

    Parameters
    ----------
    boards : sequence of EmulatedBoard
    arms : CoupledArms, optional

    Attributes
    ----------
    due : float
        Time of the next step, s.
    """

    def __init__(self, boards: Sequence[EmulatedBoard], arms: CoupledArms | None = None) -> None:
        self._boards = boards
        self._events: list[EmulatedBoard | CoupledArms] = [*boards]
        if arms:
            self._events.append(arms)
        self.due = 0.0

    @property
    def terminals(self) -> list[ports.PseudoTerminal]:
        """Ports opened by hosts."""
        return [board.terminal for board in self._boards if board.terminal]

    def step(self, now: float) -> None:
        """Exchange bytes, then process all samples and forces that are due."""
        for board in self._boards:
            board.exchange(now)
        for event in self._events:
            event.skip(now - LONGEST_DELAY)
        while (event := min(self._events, key=attrgetter("due"))).due <= now:
            event.step()
        # The arms' forces are processed with the next sample, and need no separate wake-up.
        self.due = min(now + STEP, *(board.due for board in self._boards))

    def close(self) -> None:
        """Remove the ports."""
        for board in self._boards:
            board.close()
